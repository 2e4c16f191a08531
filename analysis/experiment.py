"""A paired experiment: the reference and every spring model run on one scene, side by side in one folder."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from . import load_scale
from .extent import available_memory, extent_of
from .methods import REFERENCE, label_of
from .paths import PROGRAMS, ROOT
from .points import read_toml, say
from .runs import LATE, NOT_MODELLED, NOT_OK, REFUSED, SOLVED, RunError, built, outcome_of
from .wording import significant

if TYPE_CHECKING:
    import pandas as pd

    from .comparison import Comparison
    from .tables import Plots

#: s, that a further solve of the reference for its error may take, as foreseen
TIME_LIMIT = 60.0


@dataclass(frozen=True)
class Experiment:
    """A finished pair of solver runs, side by side in one folder."""

    folder: Path
    scene: dict[str, Any]  #: filled in, as the solvers read it
    failed: dict[str, str]  #: spring models that gave no result, and why
    unsolved: str = ""  #: the part of the scene that the reference does not model; "": it solved the scene
    notes: tuple[
        str, ...
    ] = ()  #: sentences for the report: what was probably not meant, what was done to the surface
    command: str = ""  #: that repeats it, without an output folder
    n_refinements: int = 0  #: of the reference, for its error
    next_reference_seconds: float | None = None  #: of the next refinement, as foreseen; None: none is needed
    unrefined: str = ""  #: why the next refinement gave nothing; "": it was not tried

    def __repr__(self) -> str:
        return f"Experiment({self.name}, {self.surface}, {', '.join(self.calibrations)}: {self.folder})"

    def __str__(self) -> str:
        """Finding and conclusion. Raises RunError as comparison."""
        from .verdict import conclusion, finding

        values = self.comparison.as_json()
        return "\n".join([finding(values), *conclusion(values)])

    @property
    def name(self) -> str:
        return self.scene["name"]

    @property
    def surface(self) -> str:
        """Name of the surface's file or shape."""
        return Path(self.scene["surface"].get("file", "")).name or self.scene["surface"]["shape"]

    @property
    def calibration(self) -> str:
        return self.scene["network"]["calibration"]

    @property
    def calibrations(self) -> list[str]:
        """Every spring model of the comparison, the scene's own first."""
        return list(dict.fromkeys([self.calibration, *self.scene["comparison"]["calibrations"]]))

    @property
    def law(self) -> str:
        """Of both solvers."""
        return self.scene["material"]["law"]

    @property
    def is_free(self) -> bool:
        return not self.scene.get("supports")

    @property
    def is_static(self) -> bool:
        return self.scene["time"]["mode"] == "static"

    def massspring_folder(self, calibration: str) -> Path:
        return self.folder / "massspring" / calibration

    @property
    def reference_folder(self) -> Path:
        return self.folder / "fem_reference"

    def refined_folder(self, n: int) -> Path:
        """Of the reference refined n times for its error."""
        return self.folder / "reference_refined" / str(n)

    @property
    def reference_folders(self) -> list[Path]:
        """Of the reference as the scene has it, and refined."""
        return [self.reference_folder, *(self.refined_folder(n + 1) for n in range(self.n_refinements))]

    @property
    def target_error(self) -> float:
        """What adaptive springs are to reach; 0: they are not adapted."""
        return float(self.scene["network"].get("target_error", 0))

    # What solves loads nothing that compares or draws: that is imported where it is asked for.

    @cached_property
    def comparison(self) -> Comparison:
        """All runs and their figures. Raises RunError as comparison.compare does."""
        from .comparison import compare

        return compare(self)

    def report(self) -> Path:
        """Its report.html, which is drawn anew where anything has changed. Raises RunError as comparison."""
        from .results import results_of

        results_of(self)
        return self.folder / "report.html"

    def to_dataframe(self) -> pd.DataFrame:
        """As tables.table_of: a row for every model."""
        from .tables import table_of

        return table_of(self.comparison)

    def per_node(self, model: str | None = None) -> pd.DataFrame:
        """As tables.nodes_of: a row for every vertex of the surface."""
        from .tables import nodes_of

        return nodes_of(self.comparison, model)

    def plot(self) -> Plots:
        """The plots of the report, which a notebook shows: caption -> SVG."""
        from .tables import plots_of

        return plots_of(self.comparison)

    def show(self, model: str | None = None, **options: Any) -> Any:
        """Shows reference and model side by side; options are those of pyvista's Plotter.show, whose result this returns."""
        from .tables import scene_of_bodies

        return scene_of_bodies(self.comparison, model).show(**options)


_WARNING = "warning: "


def _sentence(warning: str) -> str:
    return warning.removeprefix(_WARNING) + "."


def _scaling(factor: float | None) -> tuple[str, ...]:
    """A sentence on a body that is not of its own size."""
    if factor is None:
        return ()
    return (
        f"surface.normalise has scaled the body's coordinates by {significant(factor)}, so that its smallest side measures 1 m: "
        "lengths here are not its own. own_body.toml keeps them.",
    )


def default_folder(scene: Path, surface: Path | None) -> Path:
    """out/NAME, or out/NAME-SURFACE where a surface is given, NAME being the scene's."""
    name = scene.stem
    with suppress(
        OSError, UnicodeDecodeError, tomllib.TOMLDecodeError
    ):  # the solver says what is wrong with it
        name = tomllib.loads(scene.read_text()).get("name", name)
    return ROOT / "out" / (f"{name}-{surface.stem}" if surface else name)


def surface_file(scene: Path) -> Path:
    """The file that a scene takes its surface from. Raises RunError where it names none."""
    file = read_toml(scene).get("surface", {}).get("file")
    if not file:
        raise RunError(f"{scene}: no surface.file, expected one with --remesh, or --surface FILE")
    return scene.parent / file


def surface_overrides(arguments: Any) -> list[str]:
    """KEY=VALUE of the options --up and --units."""
    given = {"surface.up": arguments.up, "surface.unit": arguments.units}
    return [f'{key}="{value}"' for key, value in given.items() if value]


class _Said(NamedTuple):
    """What a program ended with and, of one that is quiet, what it printed."""

    status: int
    errors: str = ""
    warnings: tuple[str, ...] = ()
    output: str = ""


def _run(command: list[str], is_quiet: bool, limit: float | None = None) -> _Said:
    """Runs a program. What it says besides errors goes to sys.stderr; limit: seconds after which it is stopped."""
    try:
        if not is_quiet:
            return _Said(subprocess.run(command, check=False, timeout=limit).returncode)
        done = subprocess.run(
            [*command, "--quiet"],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return _Said(LATE)
    lines = done.stderr.splitlines(keepends=True)
    sys.stderr.writelines(line for line in lines if not line.startswith("error: "))
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    warnings = tuple(line.strip() for line in lines if line.startswith(_WARNING))
    return _Said(done.returncode, "".join(errors).strip(), warnings, done.stdout)


def run_solvers(
    scene_file: Path,
    folder: Path,
    surface: Path | None,
    overrides: list[str],
    is_quiet: bool,
    time_limit: float = TIME_LIMIT,
    is_refined_once: bool = False,
) -> Experiment:
    """Checks the scene, then runs the reference and every spring model; each skips itself where its last result still holds.

    The reference is refined as references.refine does, which gives the last two options their meaning. Where the scene has a part
    that the reference does not model, the springs run alone. Raises RunError when a spring model refuses the scene, and when
    the reference fails or carries no part of the load.
    """
    command = _command(scene_file, surface, overrides)
    if surface:
        overrides = [*overrides, 'surface.shape=""', f"surface.file={surface.resolve()}"]

    def run(program: str, out: Path, *more: str, options: Sequence[str] = ()) -> tuple[int, str]:
        return _run(command_of(program, out, *more, options=options), is_quiet)[:2]  # status, errors

    def command_of(program: str, out: Path, *more: str, options: Sequence[str] = ()) -> list[str]:
        command = [str(built(PROGRAMS, program)), str(scene_file), "--out", str(out), *options]
        for override in [*overrides, *more]:
            command += ["--set", override]
        return command

    checked = _run(command_of("massspring", folder, options=["--check"]), is_quiet=True)
    if checked.status != SOLVED:
        raise RunError(checked.errors or "massspring refuses the scene: nothing has been solved")
    extent = extent_of(checked.output)
    say(extent.text, is_quiet)
    if advice := extent.advice(available_memory()):
        print(f"warning: {advice}", file=sys.stderr)

    wanted = load_scale.wanted_strain(read_toml(scene_file), overrides)
    if wanted is not None:
        trial = folder / "load_scale_trial"
        say(f"a trial for a strain of {wanted:g}", is_quiet)
        status, errors = run("massspring", trial, *load_scale.TRIAL, options=load_scale.OPTIONS)
        if status != SOLVED:
            raise RunError(
                errors
                or f"load_scale.strain = {wanted}: the trial solve that finds a factor for it failed, see {trial}"
            )
        overrides = [*overrides, load_scale.factor_override(wanted, trial)]
    say(label_of(REFERENCE), is_quiet)
    status, errors = run("fem_reference", folder / "fem_reference", options=["--checked"])
    if status not in (SOLVED, NOT_OK, NOT_MODELLED):
        is_told = status == REFUSED and not errors
        raise RunError(errors or f"fem_reference gave no result (exit status {status})", is_told)
    shutil.copyfile(folder / "fem_reference" / "scene.toml", folder / "scene.toml")
    scene = tomllib.loads((folder / "scene.toml").read_text())
    # The springs' program names the models: where the scene is the paper's, those that the scene names do not count.
    scene["network"]["calibration"], *scene["comparison"]["calibrations"] = json.loads(checked.output)["models"]
    record = json.loads((folder / "fem_reference" / "run.json").read_text())
    # A static one that came some way is compared there.
    if status == NOT_OK and not record.get("load_factor_reached"):
        raise RunError(
            f"fem_reference did not converge: {outcome_of(record)}, see {folder / 'fem_reference'}"
        )
    unsolved = record["reason"] if status == NOT_MODELLED else ""

    notes = (*map(_sentence, checked.warnings), *_scaling(json.loads(checked.output).get("normalised_unit")))
    experiment = Experiment(folder, scene, {}, unsolved, notes, command)
    for calibration in experiment.calibrations:
        out = experiment.massspring_folder(calibration)
        say(label_of(calibration), is_quiet)
        status, errors = run("massspring", out, f"network.calibration={calibration}", options=["--checked"])
        outcome = errors or f"exit status {status}"
        if status in (SOLVED, NOT_OK):
            outcome = outcome_of(json.loads((out / "run.json").read_text()))
        if outcome != "ok":
            experiment.failed[calibration] = outcome
    if unsolved:
        return experiment

    def solve_refined(out: Path, more: list[str], limit: float) -> tuple[int, str]:
        return _run(command_of("fem_reference", out, *more, options=["--checked"]), is_quiet, limit)[:2]

    from .references import refine

    return refine(experiment, solve_refined, time_limit, is_quiet, is_refined_once)


def _command(scene: Path, surface: Path | None, overrides: list[str]) -> str:
    """The words of a user for these runs."""
    words = ["./testbed", "run", str(scene), *(["--surface", str(surface)] if surface else [])]
    for override in overrides:
        words += ["--set", override]
    return shlex.join(words)
