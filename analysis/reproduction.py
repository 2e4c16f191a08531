"""How far tables and figures that are made again lie from the stored ones, and the page that lists them all."""

from __future__ import annotations

import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from .paths import write_bytes, write_text
from .report import Table, html_table, image_figure, page, svg_figure
from .wording import percent

_NUMBER = re.compile(r"[-+]?\d[\d ]*(?:\.\d+)?(?:e[-+]?\d+)?")
_FOUND = "found.json"


@dataclass(frozen=True)
class Compared:
    """A table, figure or page that was made again, beside the stored one."""

    name: str
    n: int  #: cells of a table, 1 of others
    largest: float  #: relative difference of two numbers of a table; of others the part of pixels or lines that differs
    differences: list[str] = field(default_factory=list)  #: those that count; none: it is as stored
    pictures: list[str] = field(
        default_factory=list
    )  #: files of figures that differ: the stored one, the new one


def _parts(cell: str) -> tuple[str, list[float]]:
    """The words of a cell and its numbers."""
    numbers = [float(number.replace(" ", "")) for number in _NUMBER.findall(cell)]
    return _NUMBER.sub("", cell).strip(" %"), numbers


def _distance(stored: str, fresh: str) -> float:
    """The largest relative difference of two cells' numbers; infinite where words differ."""
    (words, numbers), (new_words, new_numbers) = _parts(stored), _parts(fresh)
    if words != new_words or len(numbers) != len(new_numbers):
        return np.inf
    sizes = (max(abs(a), abs(b)) for a, b in zip(numbers, new_numbers, strict=True))
    return max(
        (abs(a - b) / size for a, b, size in zip(numbers, new_numbers, sizes, strict=True) if size),
        default=0.0,
    )


def differences(stored: list[str], fresh: list[str], tolerance: float) -> list[str]:
    """Cells whose words differ, or whose numbers do by more than a part of the larger."""
    return [
        f"{old or 'nothing'} -> {new or 'nothing'}"
        for old, new in zip(stored, fresh, strict=True)
        if _distance(old, new) > tolerance
    ]


def differences_of_tables(stored: Table, fresh: Table, tolerance: float) -> list[str]:
    """Of the cells, each with its row's label; of heads; of the number of rows."""
    if stored[0] != fresh[0]:
        return [f"columns {', '.join(stored[0])} -> {', '.join(fresh[0])}"]
    if len(stored[1]) != len(fresh[1]):
        return [f"{len(stored[1])} rows -> {len(fresh[1])}"]
    return [
        f"{fresh_row[0]}: {text}"
        for row, fresh_row in zip(stored[1], fresh[1], strict=True)
        for text in differences(row, fresh_row, tolerance)
    ]


def compare_tables(number: int, stored: Table, fresh: Table, tolerance: float) -> Compared:
    """A section's table of that number."""
    said = differences_of_tables(stored, fresh, tolerance)
    cells = [pair for rows in zip(stored[1], fresh[1], strict=False) for pair in zip(*rows, strict=False)]
    found = [distance for pair in cells if np.isfinite(distance := _distance(*pair))]
    return Compared(f"table {number}", len(cells), max(found, default=0.0), said)


def compare_files(name: str, stored: bytes | None, fresh: Path, kept: Path) -> Compared:
    """A figure or page. kept: folder for the stored one, where that is another."""
    new = fresh.read_bytes()
    if stored == new:
        return Compared(name, 1, 0.0)
    said = [f"{name} has changed"]
    if fresh.suffix == ".md":
        return Compared(name, 1, _part_of_lines(stored or b"", new), said)
    old = kept / f"stored_{Path(name).name}"
    write_bytes(old, stored or b"")
    part = _part_of_lines if fresh.suffix == ".svg" else _part_of_pixels
    return Compared(
        name, 1, part(stored, new) if stored else 1.0, said, [str(old)] * bool(stored) + [str(fresh)]
    )


def _part_of_lines(old: bytes, new: bytes) -> float:
    lines = [Counter(text.splitlines()) for text in (old, new)]
    return (lines[1] - lines[0]).total() / max(1, lines[1].total())


def _part_of_pixels(old: bytes, new: bytes) -> float:
    a, b = (np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=int) for data in (old, new))
    return float((a != b).any(axis=2).mean()) if a.shape == b.shape else 1.0


def keep(folder: Path, name: str, of: dict[str, Any], compared: Iterable[Compared]) -> None:
    """Adds what was found of an entry to what the folder holds of others. of: commit, error and note."""
    folder.mkdir(parents=True, exist_ok=True)
    found = kept_in(folder) | {name: of | {"compared": [asdict(item) for item in compared]}}
    write_text(folder / _FOUND, json.dumps(found, indent=2) + "\n")


def kept_in(folder: Path) -> dict[str, dict[str, Any]]:
    """Entry -> what was found of it, by this call and earlier ones."""
    file = folder / _FOUND
    found: dict[str, dict[str, Any]] = json.loads(file.read_text()) if file.exists() else {}
    return found


def write_report(folder: Path, listed: dict[str, tuple[str, list[str]]], stored: dict[str, Any]) -> Path:
    """Writes report.html over all that is published. Returns its file.

    listed: entry -> its page and section, and the names of its tables and figures; stored: entry -> of what commit it is.
    """
    found = kept_in(folder)
    rows, lines, pictures = [], [], []
    for name, (place, items) in listed.items():
        commit = stored.get(name, {}).get("commit", "unknown")
        of = found.get(name, {"commit": "-", "compared": [], "error": "", "note": ""})
        compared = [Compared(**item) for item in of["compared"]]
        for item in compared:
            rows.append([name, place, item.name, commit, of["commit"], *_figures(item), of["note"]])
            lines += [[name, item.name, line] for line in item.differences]
            pictures += list(_pictures(item))
        missing = [item for item in items if item not in {known.name for known in compared}]
        state = f"failed: {of['error']}" if of["error"] else "not made again"
        rows += [
            [name, place, item, commit, of["commit"], "-", "-", "-", state, of["note"]] for item in missing
        ]
    outcomes = Counter(row[8].partition(":")[0] for row in rows)
    counted = ", ".join(f"{outcomes[word]} {word}" for word in _OUTCOMES if outcomes[word])
    parts = [html_table(_HEAD, rows)]
    if lines:
        parts += ["<h2>What differs</h2>", html_table(["entry", "", "stored -> made again"], lines)]
    parts += pictures
    file = folder / "report.html"
    sentence = f"Of {len(rows)} published tables and figures: {counted}."
    write_text(file, page("What is published, made again", sentence, [*parts, _EXPLAINED], {}))
    return file


def _figures(item: Compared) -> list[str]:
    if item.differences:
        return [str(item.n), str(len(item.differences)), percent(item.largest), "differ"]
    return [str(item.n), "0", percent(item.largest) if item.largest else "0", "as stored"]


def _pictures(item: Compared) -> Iterator[str]:
    for file, what in zip(map(Path, item.pictures[::-1]), ("made again", "as stored"), strict=False):
        if file.exists():
            caption = f"{item.name}, {what}"
            yield (
                svg_figure(file.read_text(), caption)
                if file.suffix == ".svg"
                else image_figure(file, caption)
            )


_OUTCOMES = ("as stored", "differ", "failed", "not made again")
_HEAD = [
    "entry",
    "page",
    "table or figure",
    "stored of",
    "made of",
    "cells",
    "differ",
    "by at most",
    "",
    "left out",
]
_EXPLAINED = """<h2>How to read this</h2>
<p>A cell differs where its words do, or its numbers by more than the entry's tolerance (a tenth unless the manifest says
otherwise). <b>By at most</b>: the largest relative difference of two numbers of a table; of a figure or page the part of its
pixels or lines that are others. <b>Stored of</b>, <b>made of</b>: commits.</p>"""
