"""What a Python session starts with: run a scene, or sweep one, and go on with what that gave."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from . import grid
from .experiment import Experiment, default_folder, run_solvers
from .paths import ROOT
from .runs import RunError
from .scene import Scene, toml_of

Settings = Mapping[str, Any]  #: key of a scene, as in material.nu -> value


def run(
    scene: Scene | Path | str,
    settings: Settings | None = None,
    *,
    surface: Path | str | None = None,
    folder: Path | str | None = None,
    is_quiet: bool = True,
) -> Experiment:
    """Runs both solvers on a scene, other values in place of its own; what has not changed is not run again.

    surface: file of another surface; folder: of the results, by default one under out/python for each scene, values and
    surface. Raises RunError with the words of the program that refuses the scene.
    """
    overrides = [f"{key}={toml_of(value, key)}" for key, value in (settings or {}).items()]
    surface = Path(surface) if surface else None
    if isinstance(scene, Scene):
        file = _written(scene)
    else:
        file = Path(scene)
        if not file.is_file():
            raise RunError(f"{file}: missing, expected the file of a scene")
    if not folder:
        digest = hashlib.sha256(repr((file.resolve(), file.read_bytes(), overrides)).encode()).hexdigest()[:8]
        folder = ROOT / "out" / "python" / f"{default_folder(file, surface).name}-{digest}"
    return run_solvers(file, Path(folder), surface, overrides, is_quiet)


def sweep(
    scene: Scene | Path | str,
    values: Mapping[str, Sequence[Any]],
    *,
    folder: Path | str | None = None,
    is_quiet: bool = True,
) -> pd.DataFrame:
    """Runs both solvers for every combination of values (key -> values) and returns a row for each, the last key fastest.

    Columns are the keys, status, message and the figures of the scene's own model; a point that fails has a message instead
    of figures. folder: of the results, by default under out/sweep; points that it holds are not run again. Raises RunError
    where the scene cannot be read.
    """
    file = (_written(scene) if isinstance(scene, Scene) else Path(scene)).resolve()
    texts = {key: [toml_of(value, key) for value in of_key] for key, of_key in values.items()}
    if not texts or not all(texts.values()):
        raise RunError("sweep: expected at least one key, and a value of each")
    folder = Path(folder or ROOT / "out" / "sweep" / default_folder(file, None).name)
    table = pd.DataFrame(grid.sweep(file, texts, folder, is_quiet=is_quiet))
    for key, of_key in values.items():
        table[key] = table[key].map(dict(zip(texts[key], of_key, strict=True)))
    return table


def _written(scene: Scene) -> Path:
    text = scene.to_toml()
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return scene.write(ROOT / "out" / "python" / "scenes" / digest / f"{scene.get('name', 'scene')}.toml")
