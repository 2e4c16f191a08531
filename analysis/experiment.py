"""A paired experiment: the reference and every spring model run on one scene, side by side in one folder."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from . import load_scale
from .execute import Ended, execute, solver
from .experiment_folder import Experiment
from .methods import REFERENCE, label_of
from .paths import PROGRAMS, ROOT
from .progress import say
from .references import halve_step, refine
from .run_store import Outcome, RunRequest, Store, value_of
from .runs import (
    LATE,
    NOT_MODELLED,
    NOT_OK,
    REFUSED,
    SOLVED,
    STOPPED_EARLY,
    RunError,
    StoppedEarlyError,
    built,
    outcome_of,
    read_toml,
    record_of,
)
from .time_warp import warp_of
from .wording import significant

#: s, that a further solve of the reference for its error may take, as foreseen
TIME_LIMIT = 60.0
_LEAST = 0.001  # s, that a run gets of a budget that is spent


def _scaling(checked: str) -> tuple[str, ...]:
    """A sentence on a body that is not of its own size, by what `massspring --check` prints."""
    factor = json.loads(checked).get("normalised_unit")
    if factor is None:
        return ()
    return (
        f"surface.normalise has scaled the body's coordinates by {significant(factor)}, so that its smallest side measures 1 m: "
        "lengths here are not its own. own_body.toml keeps them.",
    )


def default_folder(scene: Path, surface: Path | None) -> Path:
    """out/NAME, or out/NAME-SURFACE where a surface is given, NAME being the scene's.

    Raises RunError for a name that names no folder in out.
    """
    name = scene.stem
    with suppress(RunError):  # the solver says what is wrong with it
        name = read_toml(scene).get("name", name)
    if not isinstance(name, str) or name in ("", ".", "..") or re.search(r"[/\x00\ud800-\udfff]", name):
        raise RunError(f"{scene}: name = {name!r}, expected the name of a folder: without / and NUL")
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


def _run(command: list[str], is_quiet: bool, limit: float | None = None) -> Ended:
    """Runs a program. What it says besides errors goes to sys.stderr; limit: seconds after which it is stopped."""
    ended = execute(command, is_quiet, limit)
    sys.stderr.write(ended.remarks)
    return ended


@contextmanager
def _no_report_of_a_failure(folder: Path) -> Iterator[None]:
    """What fails within it leaves no report of other values."""
    try:
        yield
    except RunError:
        for name in ("comparison.json", "report.html"):
            (folder / name).unlink(missing_ok=True)
        raise


def check_playback(scene: Path, overrides: list[str]) -> None:
    """Raises RunError for a time warp of the scene that is none, before anything is solved for it."""
    settings = dict(read_toml(scene).get("playback", {}))
    for override in overrides:
        key, _, text = override.partition("=")
        if key.startswith("playback."):
            settings[key.removeprefix("playback.")] = value_of(text)
    if settings.get("warp"):
        warp_of(settings["warp"], settings.get("points"), settings.get("expression", ""))


def _expect_end(folder: Path) -> None:
    """Raises StoppedEarlyError where a run's budget was spent."""
    record = record_of(folder)
    if record.get("status") == STOPPED_EARLY:
        raise StoppedEarlyError(f"{folder}: {outcome_of(record)}")


def _placed(outcome: Outcome, out: Path) -> tuple[int, str]:
    """Exit status and errors of a stored run, whose files then lie in a folder, too."""
    if outcome.folder == Path():  # its makers have died
        return REFUSED, outcome.message
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(outcome.folder, out, copy_function=os.link)
    if outcome.status == "failed" and (out / "run.json").exists():
        return NOT_MODELLED, ""
    status = {"ok": SOLVED, "time limit": LATE, "failed": REFUSED}.get(outcome.status, NOT_OK)
    return status, outcome.message if status in (LATE, REFUSED) else ""


def run_solvers(
    scene_file: Path,
    folder: Path,
    surface: Path | None,
    overrides: list[str],
    is_quiet: bool,
    time_limit: float = TIME_LIMIT,
    is_refined_once: bool = False,
    budget: float | None = None,
    store: Store | None = None,
) -> Experiment:
    """Checks the scene, then runs the reference and every spring model; each skips itself where its last result still holds.

    The reference is refined as references.refine does, which gives time_limit and is_refined_once their meaning. Where the
    scene has a part that the reference does not model, the springs run alone. budget: s of wall-clock time for all runs; what
    is not solved by then is not compared, and goes on in another call. store: of the same file system, has all runs made by
    its engine, without a budget. Raises RunError when a spring model refuses the scene, and when the reference fails or
    carries no part of the load, StoppedEarlyError where that is for its budget.
    """
    end = None if budget is None else time.monotonic() + budget
    walls = []  # s, of the runs
    command = _command(scene_file, surface, overrides)
    if surface:
        overrides = [*overrides, 'surface.shape=""', f"surface.file={surface.resolve()}"]

    def run(
        program: str, out: Path, *more: str, options: tuple[str, ...] = (), limit: float | None = None
    ) -> tuple[int, str]:
        if store:
            request = RunRequest(program, scene_file, (*overrides, *more), options, is_of_pair=True)
            within = Store(store.folder, limit or store.time_limit, store.programs)
            outcome = within.run(request)
            walls.append(outcome.wall)
            return _placed(outcome, out)
        ended = _run(command_of(program, out, *more, options=options), is_quiet, limit)
        walls.append(ended.wall)
        return LATE if ended.is_late else ended.status, ended.errors

    def command_of(program: str, out: Path, *more: str, options: tuple[str, ...] = ()) -> list[str]:
        left = () if end is None else ("--budget", f"{max(_LEAST, end - time.monotonic()):.3f}")
        return solver(built(PROGRAMS, program), scene_file, out, (*overrides, *more), (*options, *left))

    checked = _run(command_of("massspring", folder, options=("--check",)), is_quiet=True)
    if checked.status != SOLVED:
        raise RunError(checked.errors or "massspring refuses the scene: nothing has been solved")
    check_playback(scene_file, overrides)
    with _no_report_of_a_failure(folder):
        wanted = load_scale.wanted_strain(read_toml(scene_file), overrides)
        if wanted is not None:
            folder_of_trial = folder / "load_scale_trial"
            failed = f"load_scale.strain = {wanted}: the trial solve that finds a factor for it failed, see {folder_of_trial}"
            say(f"a trial for a strain of {wanted:g}", is_quiet)

            def trial(words: tuple[str, ...]) -> tuple[str, Path]:
                status, errors = run("massspring", folder_of_trial, *words, options=load_scale.OPTIONS)
                if status not in (SOLVED, NOT_OK):
                    raise RunError(errors or f"{failed} (exit status {status})")
                _expect_end(folder_of_trial)
                return record_of(folder_of_trial)["status"], folder_of_trial

            factor = load_scale.factor_override(wanted, trial)
            if not factor:
                raise RunError(failed)
            overrides = [*overrides, factor]
        say(label_of(REFERENCE), is_quiet)
        status, errors = run("fem_reference", folder / "fem_reference", options=("--checked",))
        if status not in (SOLVED, NOT_OK, NOT_MODELLED):
            is_told = status == REFUSED and not errors
            raise RunError(errors or f"fem_reference gave no result (exit status {status})", is_told)
        shutil.copyfile(folder / "fem_reference" / "scene.toml", folder / "scene.toml")
        scene = read_toml(folder / "scene.toml")
        # The springs' program names the models: where the scene is the paper's, those that the scene names do not count.
        scene["network"]["calibration"], *scene["comparison"]["calibrations"] = json.loads(checked.output)[
            "models"
        ]
        record = record_of(folder / "fem_reference")
        # A static one that came some way is compared there.
        if status == NOT_OK and not record.get("load_factor_reached"):
            _expect_end(folder / "fem_reference")
            raise RunError(
                f"fem_reference did not converge: {outcome_of(record)}, see {folder / 'fem_reference'}"
            )
        unsolved = record["reason"] if status == NOT_MODELLED else ""

        notes = (*(f"{warning}." for warning in checked.warnings), *_scaling(checked.output))
        experiment = Experiment(folder, scene, {}, unsolved, notes, command)
        for calibration in experiment.calibrations:
            out = experiment.massspring_folder(calibration)
            say(label_of(calibration), is_quiet)
            status, errors = run(
                "massspring", out, f"network.calibration={calibration}", options=("--checked",)
            )
            outcome = errors or f"exit status {status}"
            if status in (SOLVED, NOT_OK):
                outcome = outcome_of(record_of(out))
            if outcome != "ok":
                experiment.failed[calibration] = outcome
            if errors and calibration != experiment.calibration:
                experiment = replace(
                    experiment, notes=(*experiment.notes, f"{label_of(calibration)}: {errors}.")
                )

        def solve_by(program: str, *more: str) -> Callable[[Path, list[str], float], tuple[int, str]]:
            def solve(out: Path, words: list[str], limit: float) -> tuple[int, str]:
                return run(program, out, *more, *words, options=("--checked",), limit=limit)

            return solve

        if unsolved:
            own = solve_by("massspring", f"network.calibration={experiment.calibration}")
            experiment = halve_step(experiment, own, time_limit, is_quiet)
        else:
            solve = solve_by("fem_reference")
            experiment = refine(experiment, solve, time_limit, is_quiet, is_refined_once)
        return replace(experiment, seconds=sum(walls))


def _command(scene: Path, surface: Path | None, overrides: list[str]) -> str:
    """The words of a user for these runs."""
    scene = scene.relative_to(ROOT) if scene.is_relative_to(ROOT) else scene  # where ./testbed lies
    words = ["./testbed", "run", str(scene), *(["--surface", str(surface)] if surface else [])]
    for override in overrides:
        words += ["--set", override]
    return shlex.join(words)
