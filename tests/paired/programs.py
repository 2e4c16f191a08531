"""Runs of a program on a scene that a test writes."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from analysis.execute import solver
from analysis.paths import PROGRAMS


def words_of(
    folder: Path,
    program: str,
    scene: str,
    overrides: Sequence[str] = (),
    out: str = "out",
    words: Sequence = (),
) -> list[str]:
    """Words that run a program quietly on the text of a scene, which is written into the folder."""
    (folder / "scene.toml").write_text(scene)
    options = ("--quiet", *map(str, words))
    return solver(PROGRAMS / program, folder / "scene.toml", folder / out, tuple(overrides), options)


def ended(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Of a command, whatever its status."""
    return subprocess.run(words, capture_output=True, text=True, check=False)
