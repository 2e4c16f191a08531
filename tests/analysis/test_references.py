"""What the reference is refined by, from one run to the next."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from analysis import references
from analysis.runs import LATE, NOT_OK, SOLVED


@dataclass(frozen=True)
class Experiment:
    """As much of one as refining asks for."""

    folder: Path
    scene: dict
    n_refinements: int = 0
    next_reference_seconds: float | None = None
    unrefined: str = ""

    is_static = False
    calibration = "affine"
    failed: frozenset = frozenset()
    has_half_step: bool = False

    def massspring_folder(self, name):
        return self.folder / "massspring" / name

    @property
    def half_step_folder(self):
        return self.folder / "half_step"

    @property
    def reference_folder(self):
        return self.folder / "fem_reference"

    def refined_folder(self, n):
        return self.folder / "reference_refined" / str(n)


@pytest.mark.parametrize(
    "time, expected",
    [
        ({"mode": "static"}, [["reference.refine=2"], ["reference.refine=3"]]),
        (
            {"mode": "dynamic"},
            [
                ["reference.refine=2", "time.step=0.05", "output.frames_every=6"],
                ["reference.refine=3", "time.step=0.025", "output.frames_every=12"],
            ],
        ),
    ],
)
def test_every_refinement_splits_and_halves_once_more(time, expected, tmp_path, monkeypatch):
    scene = {"time": time, "reference": {"refine": 1}, "output": {"frames_every": 3}}
    steps = {"fem_reference": 0.1, "1": 0.05, "2": 0.025}
    monkeypatch.setattr(
        references, "record_of", lambda folder: {"seconds": {"solve": 1e-3}, "step": steps[folder.name]}
    )
    monkeypatch.setattr(
        references, "compare", lambda experiment: SimpleNamespace(as_json=experiment.n_refinements.__int__)
    )
    monkeypatch.setattr(references, "needs_finer_reference", lambda n_refinements: n_refinements < 2)
    asked = []

    def solve(folder, overrides, _limit):
        asked.append((folder, overrides))
        return 0, ""

    found = references.refine(Experiment(tmp_path, scene), solve, 60, is_quiet=True)
    assert asked == [(found.refined_folder(n), overrides) for n, overrides in enumerate(expected, 1)]
    assert found.n_refinements == 2


@pytest.mark.parametrize("status, has_half_step", [(SOLVED, True), (NOT_OK, False), (LATE, False)])
def test_springs_that_fail_at_half_their_step_are_not_compared_with_it(
    status, has_half_step, tmp_path, monkeypatch
):
    asked = []

    def solve(folder, overrides, _limit):
        asked.append((folder, overrides))
        return status, ""

    monkeypatch.setattr(references, "record_of", lambda folder: {"seconds": {"solve": 1e-3}, "step": 0.1})
    found = references.halve_step(Experiment(tmp_path, {}), solve, 60, is_quiet=True)
    assert asked == [(found.half_step_folder, ["time.step=0.05", "output.frames_every=0"])]
    assert found.has_half_step is has_half_step
