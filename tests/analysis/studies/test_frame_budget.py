"""Frame budgets: which rung of a method is the most accurate within one."""

from types import SimpleNamespace

import pytest
from races import measurement, timed

from analysis.studies.frame_budget import best_within, frame_budget, meets
from analysis.studies.race import Rung

SCENE = {"time": {"step": 0.01, "end": 1.0}}  # 100 steps


def rung(solve, error, method="node_averaged", step=1.0):
    outcome = timed(solve=solve, mesh=1000, n_steps=100)
    return measurement(outcome, method=method, rung=Rung(1, step), errors=[error])


@pytest.mark.parametrize(
    "solve, within",
    [
        (0.99, ["60 frames/s", "30 frames/s", "5 frames/s", "real time"]),
        (1.5, ["60 frames/s", "30 frames/s", "5 frames/s"]),
        (3, ["30 frames/s", "5 frames/s"]),
        (19, ["5 frames/s"]),
        (21, []),
    ],
)
def test_a_step_is_a_frame_and_meshing_comes_before(solve, within):
    m = rung(solve, 0.01)
    budgets = ("60 frames/s", "30 frames/s", "5 frames/s", "real time")
    assert [budget for budget in budgets if meets(m, budget, end=1.0)] == within


def test_the_smallest_error_within_the_budget_counts():
    rungs = [
        rung(0.5, 0.1),
        rung(1.2, 0.02),
        rung(40, 0.001),
        rung(0.1, 0.4, "uniform"),
        rung(0.9, 0.05, "fem_p2", 2),
    ]
    scene = SimpleNamespace(measurements=rungs, name="bar", scene=SCENE)
    assert best_within(scene, "60 frames/s").error == 0.02
    assert best_within(scene, "real time").error == 0.05
    assert best_within(scene, "real time", "node_averaged").error == 0.1
    assert best_within(scene, "60 frames/s", "uniform") is None  # it is off by more than a third
    section = frame_budget([scene])
    cells = {row[1]: row[2:] for row in section.tables["frame_budget"][1]}
    assert cells["springs, uniform"] == ["-"] * 4
    assert cells["finite elements, quadratic"][0] == "5 % (6 nodes, 20 ms)"
    use = {row[0]: row[3:] for row in section.tables["use_when"][1]}
    assert use["a game"] == ["springs, node_averaged", "2 % (6 nodes, 10 ms)"]
    assert use["a surgery trainer"] == ["finite elements, quadratic", "5 % (6 nodes, 20 ms)"]


def test_errors_below_the_references_own_count_as_that():
    vague, better = rung(0.5, 0.001), rung(0.6, 0.01)
    vague.reference_error, better.reference_error = 0.04, 0.002
    scene = SimpleNamespace(measurements=[vague], name="bar", scene=SCENE)
    assert frame_budget([scene]).tables["use_when"][1][0][-1] == "4 % (6 nodes, 10 ms)"
    scene.measurements.append(better)
    assert best_within(scene, "60 frames/s") is better
    vague.reference_error = 0.4
    scene.measurements.remove(better)
    assert best_within(scene, "60 frames/s") is None
