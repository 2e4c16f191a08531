"""The figures of an experiment: every spring model against the reference, as they stand in comparison.json."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from .compare import (
    Free,
    ModelComparison,
    ModelSummary,
    ReferenceSummary,
    compare_runs,
    describe_alone,
    describe_reference,
    displacement_at,
    on_same_problem,
    root_mean_square,
    vertex_areas,
)
from .experiment_folder import Experiment
from .methods import REFERENCE
from .runs import Run, RunError, load_run
from .shape_measures import Surface, surface_distance
from .verdict import SERVES, needs_finer_reference

# Of the scene's own model, which stand at the top of comparison.json, too.
_MAIN = (
    "displacement_error_l2", "displacement_error_max", "volume_change_error", "area_change_error", "n_nodes", "n_springs",
    "n_patches",
)  # fmt: skip

# By which a change of quadratic elements falls with a refinement: slower than the first tells nothing of a limit, faster than
# the second is chance.
_SLOWEST, _FASTEST = 1.3, 8.0


@dataclass(frozen=True)
class Comparison:
    """The runs of an experiment that gave a result, be it of a part of the load, and the figures of each."""

    experiment: Experiment
    runs: dict[str, Run]  #: of the spring models, the scene's own first
    models: dict[str, ModelComparison | ModelSummary]  #: of the same
    reference: Run | None  #: None: the reference does not model the scene
    of_reference: ReferenceSummary | None  #: there where the reference is
    half_step_volume_change: float | None = None  #: of the scene's own springs, where they have no reference

    @property
    def methods(self) -> dict[str, Run]:
        """All runs, the reference first."""
        return ({REFERENCE: self.reference} if self.reference else {}) | self.runs

    def as_json(self) -> dict[str, Any]:
        """What comparison.json holds; a model that gave no result has its status alone."""
        experiment, failed = self.experiment, self.experiment.failed
        models = {
            name: asdict(self.models[name]) if name in self.models else {"status": failed[name]}
            for name in experiment.calibrations
        }
        main = models[experiment.calibration]
        stopped = self.reference.stopped if self.reference else ""
        comparison = {
            "scene": experiment.name,
            "surface": experiment.surface,
            "status": f"fem_reference: {stopped}" if stopped and main["status"] == "ok" else main["status"],
            "calibration": experiment.calibration,
            "law": experiment.law,
            "notes": [*experiment.notes, *self._node_limits()],
            "nu": experiment.scene["material"].get("nu", 0.25),
            "command": experiment.command,
            "target_error": experiment.target_error,
            "is_static": experiment.is_static,
            "across": experiment.scene["surface"].get("across", 1),
            "is_coarse_at_supports": bool(experiment.scene.get("supports"))
            and not experiment.scene["surface"].get("at_supports"),
            "is_too_thin": any(run.record.get("is_cut_bounded") for run in self.methods.values()),
        }
        if self.of_reference:
            reference = asdict(self.of_reference)
            comparison |= {
                "rigid_motion_removed": experiment.is_free is not False,
                **{key: main.get(key) for key in _MAIN},
                "n_dofs_reference": reference["n_dofs"],
                "smaller_steps": self._smaller_steps(),
                "seconds": {"massspring": main.get("seconds"), REFERENCE: reference["seconds"]},
                "reference": reference
                | {"next_seconds": experiment.next_reference_seconds, "unrefined": experiment.unrefined},
            }
        else:
            comparison["no_reference"] = experiment.unsolved
            comparison["half_step_volume_change"] = self.half_step_volume_change
        return comparison | {"models": models}

    def _node_limits(self) -> list[str]:
        """Sentences on what surface and networks have fewer nodes than the scene asks for."""
        records = [run.record for run in self.methods.values()]
        limits = []
        if cut := [record["n_surface"] for record in records if record.get("is_cut_bounded")]:
            limits.append(
                f"The surface is too thin in parts for surface.across: it was cut to {max(cut)} vertices and no further."
            )
        bounds = [record.get("internal_nodes", {}).get("bounded_by") for record in records]
        if most := max(filter(None, bounds), default=0):
            limits.append(
                f"Networks of links have at most {most} nodes inside, three for each of the surface: network.k asks for more."
            )
        return limits

    def _smaller_steps(self) -> str:
        """KEY=VALUE that halves the steps of load or time."""
        assert self.reference
        if self.experiment.is_static:
            return f"time.load_steps={2 * self.experiment.scene['time'].get('load_steps', 10)}"
        return f"time.step={self.reference.record['step'] / 2:g}"


def compare(experiment: Experiment, is_as_in_scene: bool = False) -> Comparison:
    """Loads and compares all runs, with the reference as the scene has it or, where that cannot decide, with its finest.

    is_as_in_scene: with the first in any case, so that rows of a table are of one kind of elements. Raises RunError for a
    run that is damaged or of another problem than the reference.
    """
    if experiment.unsolved:
        runs = {
            name: run
            for name in experiment.calibrations
            if (run := _springs(experiment, name)) and not run.stopped
        }
        alone: dict[str, ModelComparison | ModelSummary] = {
            name: describe_alone(run) for name, run in runs.items()
        }
        half = (
            describe_alone(load_run(experiment.half_step_folder)).volume_change
            if experiment.has_half_step
            else None
        )
        return Comparison(experiment, runs, alone, None, None, half)
    levels = [load_run(folder, may_stop=True) for folder in experiment.reference_folders]
    errors = errors_of_references(levels, experiment.is_free)
    runs = {name: run for name in experiment.calibrations if (run := _springs(experiment, name))}
    comparison = _judged_by(experiment, runs, levels, errors, 0)
    if len(levels) > 1 and not is_as_in_scene and needs_finer_reference(comparison.as_json()):
        return _judged_by(experiment, runs, levels, errors, len(levels) - 1)
    return comparison


def _judged_by(
    experiment: Experiment, runs: dict[str, Run], levels: list[Run], errors: list[float | None], n: int
) -> Comparison:
    """levels: references, each refined once more than the one before, and what they are off by; n: that which judges."""
    is_free, reference, finest = experiment.is_free, levels[n], levels[-1]
    seen = {name: on_same_problem(run, reference) for name, run in runs.items()}
    models: dict[str, ModelComparison | ModelSummary] = {}
    for name, run in seen.items():
        figures = compare_runs(run, reference, is_free)
        if len(levels) > 1:
            of_finest = figures if finest is reference else compare_runs(run, finest, is_free)
            figures = replace(figures, displacement_error_finest=of_finest.displacement_error_l2)
        if figures.displacement_error_l2 > SERVES and reference.record.get("law") != "small_strain":
            apart = relative_distance(run, reference, is_free, figures.reached)
            figures = replace(figures, surface_distance=apart)
        models[name] = figures
    described = replace(
        describe_reference(reference, is_free, errors[n]),
        n_refinements=n,
        unrefined_seconds=levels[0].record["seconds"],
        unrefined_has_waited=levels[0].has_waited,
        unrefined_error=compare_runs(levels[0], finest, is_free).displacement_error_l2
        if len(levels) > 1
        else None,
    )
    return Comparison(experiment, seen, models, reference, described)


def relative_distance(run: Run, reference: Run, is_free: Free, time: float) -> float:
    """Mean distance of two surfaces, whose vertices need not correspond, over the length that displacement errors are relative
    to. Of a body that nothing holds, with both centres of area in one point.
    """

    def surface(of: Run) -> Surface:
        x, F = of.last.X + displacement_at(of, time), of.last.F
        return (x - np.average(x, axis=0, weights=vertex_areas(x, F)) if is_free is True else x), F

    return surface_distance(surface(run), surface(reference)).mean / root_mean_square(
        reference, is_free, time
    )


def errors_of_references(levels: list[Run], is_free: Free) -> list[float | None]:
    """Estimated displacement errors of references, each refined once more than the one before; None of one alone.

    Each is as far from the finest as that is from the limit, which the last two changes tell: they fall by _FASTEST at most.
    Of a single change, errors are taken to halve with the edges.
    """
    if len(levels) == 1:
        return [None]
    changes = [compare_runs(a, b, is_free).displacement_error_l2 for a, b in pairwise(levels)]
    ratio = 2.0
    if len(changes) > 1 and changes[-1] > 0:
        ratio = min(max(changes[-2] / changes[-1], _SLOWEST), _FASTEST)
    own = changes[-1] / (ratio - 1)
    before = (compare_runs(level, levels[-1], is_free).displacement_error_l2 for level in levels[:-1])
    return [*(error + own for error in before), own]


def _springs(experiment: Experiment, name: str) -> Run | None:
    """A spring model's run; None where it gave nothing to compare."""
    folder, failed = experiment.massspring_folder(name), experiment.failed.get(name)
    if not failed:
        return load_run(folder)
    try:
        run = load_run(folder, may_stop=True)
    except RunError:
        return None
    return run if run.stopped == failed else None  # else it is of an earlier run


def without_nan(value: Any) -> Any:
    """JSON has no NaN: null stands for a figure that does not exist."""
    if isinstance(value, dict):
        return {key: without_nan(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
