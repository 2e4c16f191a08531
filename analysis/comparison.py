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
    "displacement_error_l2", "displacement_error_max", "volume_change_error", "n_nodes", "n_springs", "n_patches",
)  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """The runs of an experiment that gave a result, and the figures of each."""

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
            name: {"status": failed[name]} if name in failed else asdict(self.models[name])
            for name in experiment.calibrations
        }
        main = models[experiment.calibration]
        comparison = {
            "scene": experiment.name,
            "surface": experiment.surface,
            "status": main["status"],
            "calibration": experiment.calibration,
            "law": experiment.law,
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
    reference = None if experiment.unsolved else load_run(experiment.reference_folder)
    runs = {
        name: load_run(experiment.massspring_folder(name))
        for name in experiment.calibrations
        if name not in experiment.failed
    }
    models: dict[str, Figures | FiguresAlone] = {
        name: compare_runs(run, reference, experiment.is_free) if reference else describe_alone(run)
        for name, run in runs.items()
    }
    described = describe_reference(reference, _estimated_error(experiment, reference)) if reference else None
    return Comparison(experiment, runs, models, reference, described)


def _estimated_error(experiment: Experiment, reference: Run) -> float | None:
    """Of the reference, relative as the displacement error; None where no refinement gave one."""
    if not (experiment.refined_folder / "run.json").exists():
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
