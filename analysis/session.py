"""What a Python session starts with: run a scene, or sweep one, and go on with what that gave."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import pandas as pd
from matplotlib.figure import Figure

from . import experiment_folder, grid, tables
from .comparison import Comparison, compare
from .experiment import default_folder, run_solvers
from .folder_lock import locked
from .paths import ROOT
from .results import results_of
from .runs import RunError
from .scene import Scene, toml_of
from .verdict import conclusion, finding

P = ParamSpec("P")
R = TypeVar("R")


def _told(call: Callable[P, R]) -> Callable[P, R]:
    """The same, whose arguments that are no scene, file or value are told as a RunError, too."""

    @wraps(call)
    def told(*arguments: P.args, **options: P.kwargs) -> R:
        try:
            return call(*arguments, **options)
        except (OSError, ValueError, TypeError, RecursionError) as error:
            raise RunError(f"{call.__name__}: {' '.join(str(error).split())}") from error

    return told


Settings = Mapping[str, Any]  #: key of a scene, as in material.nu -> value


class Experiment(experiment_folder.Experiment):
    """A finished pair of solver runs, and what a session asks of it."""

    def __repr__(self) -> str:
        return f"Experiment({self.name}, {self.surface}, {', '.join(self.calibrations)}: {self.folder})"

    def __str__(self) -> str:
        """Finding and conclusion. Raises RunError as comparison."""
        values = self.comparison.as_json()
        return "\n".join([finding(values), *conclusion(values)])

    @cached_property
    def comparison(self) -> Comparison:
        """All runs and their figures. Raises RunError as comparison.compare does."""
        return compare(self)

    def report(self) -> Path:
        """Its report.html, which is drawn anew where anything has changed. Raises RunError as comparison."""
        with locked(self.folder):
            results_of(self)
        return self.folder / "report.html"

    def to_dataframe(self) -> pd.DataFrame:
        """As tables.table_of: a row for every model."""
        return tables.table_of(self.comparison)

    def per_node(self, model: str | None = None) -> pd.DataFrame:
        """As tables.nodes_of: a row for every vertex of the surface."""
        return tables.nodes_of(self.comparison, model)

    def plot(self) -> Figure:
        """The plots of the report as a figure of matplotlib, which a notebook shows."""
        return tables.figure_of_plots(self.comparison)

    def show(self, model: str | None = None, **options: Any) -> Any:
        """Shows reference and model side by side; options are those of pyvista's Plotter.show, whose result this returns."""
        return tables.scene_of_bodies(self.comparison, model).show(**options)


@_told
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
    surface. Raises RunError with the words of the program that refuses the scene, and for arguments of other kinds.
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
    with locked(Path(folder)):
        return Experiment(**vars(run_solvers(file, Path(folder), surface, overrides, is_quiet)))


@_told
def sweep(
    scene: Scene | Path | str,
    values: Mapping[str, Sequence[Any]],
    *,
    folder: Path | str | None = None,
    is_quiet: bool = True,
) -> pd.DataFrame:
    """Runs both solvers for every combination of values (key -> values) and returns a row for each, the last key fastest.

    Columns are the keys, status, message and the figures of the scene's own model; a run that fails has a message instead
    of figures. folder: of the results, by default under out/sweep; runs that it holds are not made again. Raises RunError
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
