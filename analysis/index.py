"""The page over the output folder: every run with its verdict, its finding, a small picture and a link to its report."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import NamedTuple

from .paths import THUMBNAIL, write_text
from .report import page

_DEPTH = 2  # folders below the page in which runs are looked for: out/NAME and out/KIND/NAME
_STYLE = """<style>
article { display: grid; grid-template-columns: minmax(8rem, 20rem) 1fr; gap: 1rem; align-items: center; margin: 1rem 0; }
article p { margin: .25rem 0; } .more { color: #555; font-size: .9rem; }
@media (max-width: 40rem) { article { grid-template-columns: 1fr; } }
</style>"""


class Entry(NamedTuple):
    """A run of the page."""

    folder: str  #: relative to the page
    verdict: list[str]  #: sentences, the first of which says what to use
    finding: str
    written: float  #: when, in seconds since 1970


def entries(folder: Path) -> list[Entry]:
    """Runs below a folder that have a report, the newest first; one that cannot be read is left out."""
    found = []
    for depth in range(1, _DEPTH + 1):
        for file in folder.glob("/".join(["*"] * depth + ["comparison.json"])):
            try:
                values = json.loads(file.read_text())
                of_run = values["conclusion"], values["finding"]
            except (OSError, ValueError, KeyError):  # half written, or by an earlier version
                continue
            if (file.parent / "report.html").exists():
                found.append(Entry(file.parent.relative_to(folder).as_posix(), *of_run, file.stat().st_mtime))
    return sorted(found, key=lambda entry: -entry.written)


def write_index(folder: Path) -> Path:
    """Writes index.html over the runs below a folder; returns its file."""
    parts = [_STYLE]
    for entry in entries(folder):
        name = html.escape(entry.folder, quote=True)
        has_picture = (folder / entry.folder / THUMBNAIL).exists()
        first, *rest = map(html.escape, entry.verdict)
        picture = f'<img src="{name}/{THUMBNAIL}" alt="" loading="lazy">' if has_picture else ""
        parts.append(
            f'<article><a href="{name}/report.html">{picture}</a>'
            f'<div><p><a href="{name}/report.html"><b>{name}</b></a></p><p><b>{first}</b></p>'
            f'<p class="more">{" ".join([html.escape(entry.finding), *rest])}</p></div></article>'
        )
    n = len(parts) - 1
    file = folder / "index.html"
    write_text(file, page("Runs", f"{n} run{'s' * (n != 1)}, the newest first.", parts, {}))
    return file
