"""References of one scene, each refined once more than the one before, until the comparison can be decided.

Springs that have no reference are run once more, at half their step.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from .comparison import compare
from .experiment_folder import Experiment
from .methods import REFERENCE, label_of
from .progress import say
from .runs import LATE, NOT_OK, SOLVED, STOPPED_EARLY, outcome_of, record_of
from .verdict import needs_finer_reference
from .wording import duration

# Seconds of a refined solve over those of the one before: eight times the unknowns, and of motions half the step.
_GROWTH = {"static": 10.0, "dynamic": 25.0}
_LATE = 3  # times the limit, after which a solve that was foreseen to be shorter is stopped

#: Runs a program into a folder with these overrides, for so many seconds at most: exit status, and what it said.
Solve = Callable[[Path, list[str], float], tuple[int, str]]


def refine(
    experiment: Experiment, solve: Solve, time_limit: float, is_quiet: bool, is_once: bool = False
) -> Experiment:
    """Refines the reference once for its error and, but for is_once, further while a statement on a model waits for it.

    time_limit: seconds that a further solve may take, as the last one foretells. The experiment that is returned says why
    the reference was not refined further, and what it would take.
    """
    record = record_of(experiment.reference_folder)
    while experiment.n_refinements == 0 or (
        not is_once and needs_finer_reference(compare(experiment).as_json())
    ):
        n = experiment.n_refinements + 1
        folder = experiment.refined_folder(n)
        seconds = _GROWTH[experiment.scene["time"]["mode"]] * _solution(record)
        experiment = replace(experiment, next_reference_seconds=seconds)
        if seconds > time_limit:
            break
        say(f"{label_of(REFERENCE)}, refined for their error: some {duration(seconds)}", is_quiet)
        status, message = solve(folder, _overrides(experiment, record, n), _LATE * time_limit)
        if status == LATE:
            experiment = replace(experiment, next_reference_seconds=2 * _LATE * time_limit)
            break
        if status not in (SOLVED, NOT_OK):
            experiment = replace(experiment, unrefined=message or f"exit status {status}")
            break
        record = record_of(folder)
        if status != SOLVED and not record.get("load_factor_reached"):
            experiment = replace(experiment, unrefined=outcome_of(record))
            break
        experiment = replace(experiment, n_refinements=n, next_reference_seconds=None)
    # One that was stopped early is to go on another time.
    later = experiment.n_refinements + 1 + (record.get("status") == STOPPED_EARLY)
    while (folder := experiment.refined_folder(later)).exists():
        shutil.rmtree(folder)  # of other values, or without a result
        later += 1
    return experiment


def halve_step(experiment: Experiment, solve: Solve, time_limit: float, is_quiet: bool) -> Experiment:
    """Runs the scene's own springs, which have no reference, at half their step, where that takes time_limit (s) at most.

    solve: as Solve, but of the springs.
    """
    shutil.rmtree(experiment.half_step_folder, ignore_errors=True)
    if experiment.is_static or experiment.calibration in experiment.failed:
        return experiment
    record = record_of(experiment.massspring_folder(experiment.calibration))
    seconds = 2 * _solution(record)
    if seconds > time_limit:
        unknown = (
            f"Whether this depends on the step is not known: half of it takes some {duration(seconds)} "
            f"(--time-limit {math.ceil(seconds)})."
        )
        return replace(experiment, notes=(*experiment.notes, unknown))
    say(f"{label_of(experiment.calibration)}, at half the step: some {duration(seconds)}", is_quiet)
    words = [f"time.step={record['step'] / 2!r}", "output.frames_every=0"]
    status, _ = solve(experiment.half_step_folder, words, _LATE * time_limit)
    return replace(experiment, has_half_step=status == SOLVED)


def _solution(record: dict[str, Any]) -> float:
    """Seconds that it had a core for, as far as that is known: a busy machine does not make a solve larger."""
    seconds = sum(record["seconds"].get(stage, 0.0) for stage in ("setup", "assemble", "solve"))
    return seconds * min(1.0, record["cpu"] / record["wall"]) if "cpu" in record else seconds


def _overrides(experiment: Experiment, last: dict[str, Any], n: int) -> list[str]:
    """KEY=VALUE of the n-th refinement, whose frames are at the same moments: it may stop on its way."""
    scene = experiment.scene
    words = [f"reference.refine={scene['reference']['refine'] + n}"]
    if scene["time"]["mode"] == "dynamic":
        every = scene["output"]["frames_every"] * 2**n
        words += [f"time.step={last['step'] / 2!r}", f"output.frames_every={every}"]
    return words
