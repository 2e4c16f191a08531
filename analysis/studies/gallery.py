"""Every shipped scene is run by both programs, and its bodies become a picture of the gallery page.

What has not changed is not run again. The page takes each scene's first sentence from the scene file. The head has fewer
vertices than the paper's, with which elements in contact take hours.
"""

from __future__ import annotations

import argparse
import re
import shutil
from pathlib import Path

from ..experiment import run_solvers
from ..paths import PACKAGE, SCENES, THUMBNAIL, write_text
from ..progress import Progress
from ..results import results_of
from ..run_store import Store, each
from ..runs import RunError
from .result import Result, Section

PAGE = PACKAGE / "GALLERY.md"
_PICTURES = "figures/gallery"
_OVERRIDES = {"head_crushes": ["surface.n_vertices=300"]}
_HEAD = """# Gallery

The bodies of every scene, and the command that repeats them. The first body is the finite elements'. Colours are errors:
blue up to 5 %, yellow to orange up to 20 %, red beyond. Springs alone are shown in time. `./testbed study gallery` draws this
page again.
"""


def sentence_of(scene: Path) -> str:
    """What a scene file says of itself first."""
    comment = re.match(r"(?:#.*\n)+", scene.read_text())
    words = " ".join(line.lstrip("# ") for line in (comment[0] if comment else "").splitlines())
    return re.split(r"(?<=[.:])\s+(?=[A-Z./])", words)[0].rstrip(":.") + "."


def write_page(scenes: list[Path]) -> None:
    parts = [_HEAD]
    for scene in scenes:
        sets = "".join(f" --set {override}" for override in _OVERRIDES.get(scene.stem, []))
        parts.append(
            f"## {scene.stem}\n\n![{scene.stem}]({_PICTURES}/{scene.stem}.jpg)\n\n{sentence_of(scene)}\n\n"
            f"```sh\n./testbed run analysis/scenes/{scene.name}{sets}\n```\n"
        )
    write_text(PAGE, "\n".join(parts))


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick takes the pictures that earlier runs have left in the folder. Raises RunError for one that is missing."""
    scenes = sorted(SCENES.glob("*.toml"))
    pictures = PACKAGE / _PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    if not arguments.quick:
        store, progress = Store(folder / "runs"), Progress(len(scenes), arguments.quiet)
        pairs = each(
            lambda scene: run_solvers(
                scene, folder / scene.stem, None, _OVERRIDES.get(scene.stem, []), is_quiet=True, store=store
            ),
            scenes,
        )
        for scene, pair in zip(scenes, pairs, strict=True):
            results_of(pair)
            progress.say(scene.stem)
    rows = []
    for scene in scenes:
        out = folder / scene.stem
        if not (out / THUMBNAIL).exists():
            raise RunError(f"{out / THUMBNAIL}: missing; leave out --quick to run {scene.name}")
        shutil.copyfile(out / THUMBNAIL, pictures / f"{scene.stem}.jpg")
        size = f"{(pictures / f'{scene.stem}.jpg').stat().st_size / 1000:.0f}"
        rows.append([scene.stem, size])
    write_page(scenes)
    tables = {"pictures": (["scene", "picture (kB)"], rows)}
    return Result(
        "Gallery", f"{len(scenes)} scenes are shown by {PAGE.name}.", [Section("Pictures", tables=tables)]
    )
