"""The figures of an experiment: every spring model against the reference, as they stand in comparison.json."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from .compare import Figures, FiguresAlone, ReferenceFigures, compare_runs, describe_alone, describe_reference
from .experiment import Experiment
from .methods import REFERENCE
from .runs import Run, RunError, load_run

# Of the scene's own model, which stand at the top of comparison.json, too.
_MAIN = (
    "displacement_error_l2", "displacement_error_max", "volume_change_error", "area_change_error", "n_nodes", "n_springs",
    "n_patches",
)  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """The runs of an experiment that gave a result, be it of a part of the load, and the figures of each."""

    experiment: Experiment
    runs: dict[str, Run]  #: of the spring models, the scene's own first
    models: dict[str, Figures | FiguresAlone]  #: of the same
    reference: Run | None  #: None: the reference does not model the scene
    of_reference: ReferenceFigures | None  #: there where the reference is

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
            "notes": list(experiment.notes),
        }
        if self.of_reference:
            reference = asdict(self.of_reference)
            comparison |= {
                "rigid_motion_removed": experiment.is_free,
                **{key: main.get(key) for key in _MAIN},
                "n_dofs_reference": reference["n_dofs"],
                "seconds": {"massspring": main.get("seconds"), REFERENCE: reference["seconds"]},
                "reference": reference,
            }
        else:
            comparison["no_reference"] = experiment.unsolved
        return comparison | {"models": models}


def compare(experiment: Experiment) -> Comparison:
    """Loads and compares all runs. Raises RunError for one that is damaged or of another problem than the reference."""
    is_free = experiment.is_free
    reference = None if experiment.unsolved else load_run(experiment.reference_folder, may_stop=True)
    runs = {
        name: run
        for name in experiment.calibrations
        if (run := _springs(experiment, name)) and (reference or not run.stopped)
    }
    models: dict[str, Figures | FiguresAlone] = {
        name: compare_runs(run, reference, is_free) if reference else describe_alone(run)
        for name, run in runs.items()
    }
    described = (
        describe_reference(reference, is_free, _estimated_error(experiment, reference)) if reference else None
    )
    return Comparison(experiment, runs, models, reference, described)


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


def _estimated_error(experiment: Experiment, reference: Run) -> float | None:
    """Of the reference, relative as the displacement error; None where no refinement gave one."""
    if reference.stopped or not (experiment.refined_folder / "run.json").exists():
        return None
    try:
        refined = load_run(experiment.refined_folder)
        if "convergence" in refined.record:
            return refined.record["convergence"].get("estimated_error_l2")
        # As if of first order: the refined run errs by half as much.
        return 2 * compare_runs(reference, refined, experiment.is_free).displacement_error_l2
    except RunError:  # what the coarse mesh carries the fine one may not
        return None


def without_nan(value: Any) -> Any:
    """JSON has no NaN: null stands for a figure that does not exist."""
    if isinstance(value, dict):
        return {key: without_nan(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
