"""Tables of the reference by itself, from runs whose answer is known."""

from types import SimpleNamespace

import pytest

from analysis.run_store import Outcome
from analysis.runs import RunError
from analysis.studies import reference


class Known:
    """A store that knows every answer: records and energies by the keys of a point."""

    def __init__(self, monkeypatch, answer):
        self.answer, self.points = answer, []
        monkeypatch.setattr(
            reference,
            "load_run",
            lambda outcome: SimpleNamespace(**outcome) if isinstance(outcome, dict) else outcome,
        )

    def run(self, point):
        self.points.append(point)
        return self.answer(point, dict(word.split("=", 1) for word in point.overrides))


def test_locking_is_what_is_missing_beside_the_finest_mesh(monkeypatch):
    def answer(point, keys):
        degree, refine = int(keys["reference.degree"]), int(keys["reference.refine"])
        energy = 2 - float(keys["material.nu"]) * 2.0**-refine * (2 - degree)
        return Outcome(
            "ok", "", 1, 1, 0, {"curves": {"elastic_energy": [0, energy]}}, {"n_dofs": 10 * degree + refine}
        )

    head, rows = reference.locking(Known(monkeypatch, answer), 60)
    assert head == ["nu", "degree 1: 10", "degree 1: 11", "degree 1: 12", "degree 2: 20", "degree 2: 21"]
    assert rows[0] == ["0.25", "12 %", "6.2 %", "3.1 %", "0 %", "0 %"] and [row[0] for row in rows] == [
        *reference.RATIOS
    ]


def test_frequencies_are_those_above_rigid_motions_over_the_references(monkeypatch):
    def answer(point, keys):
        scale = {"node_averaged": 1.01, "edge_coupled": 0.9}.get(keys.get("network.calibration"), 1)
        scale -= 0.1 * ("network.mass" in keys)
        assert point.options == ("--frequencies", "6")
        found = [scale * n for n in range(1, 7)]
        return Outcome("ok", "", 1, 1, 0, record={"natural_frequencies": found, "n_zero_frequencies": 6})

    head, rows = reference.frequencies(Known(monkeypatch, answer))
    assert rows == [
        ["node_averaged", *["+1 %"] * 6],
        ["the same, lumped masses", *["-9 %"] * 6],
        ["edge_coupled", *["-10 %"] * 6],
    ]
    assert len(head) == 7


def test_a_ball_is_squashed_by_a_share_of_its_two_metres(monkeypatch):
    run = SimpleNamespace(times=[0.25, 0.5], curves={"min_J": [0.9, 0.4], "min_J_nodes": [0.8, 0.2]})
    monkeypatch.setattr(reference, "load_run", lambda folder, may_stop: run)
    store = SimpleNamespace(run=lambda point: Outcome("not_converged", "no way on was found here", 1, 1, 0))
    head, rows = reference.squashed(store)
    assert head[4:] == ["squashed by", "least det F", "at nodes", "ends with"]
    assert rows[0] == ["clamped", "2", "162", "8", "25 %", "0.4", "0.2", "no way on"]


def test_explicit_steps_have_seconds_of_the_stable_step_and_errors_of_a_short_one(monkeypatch):
    monkeypatch.setattr(reference, "trajectory_error", lambda run, exact: SimpleNamespace(l2=run - exact))

    def answer(point, keys):
        is_exact = keys.get("reference.refine") == "1"
        is_timed = keys["time.step"] == "0"
        record = {
            "step": 2e-6 if is_timed else -1,
            "n_nodes": 7,
            "seconds": {"solve": 0.5 if is_timed else -1},
        }
        return Outcome("ok", "", 1, 1, 0, 1.0 if is_exact else 1.25, record)

    store = Known(monkeypatch, answer)
    _, rows = reference.explicit(store)
    assert rows == [[name, "7", "2", "0.5", "25 %"] for name in reference._EXPLICIT]
    steps = [word for point in store.points for word in point.overrides if word.startswith("time.step")]
    assert steps[:4] == ["time.step=0.00025", "time.step=0", "time.step=1.5625e-05", "time.step=0"]
    every = {word for point in store.points for word in point.overrides if word.startswith("output.frames")}
    # A frame each 2 ms in all of them.
    assert every == {f"output.frames_every={n}" for n in (0, 8, 128, 256)}


def test_a_run_that_fails_ends_the_study(monkeypatch):
    store = Known(monkeypatch, lambda *_: Outcome("diverged", "at 0.1 s", 1, 1, 0))
    with pytest.raises(RunError, match="fem_reference: diverged: at"):
        reference.locking(store, 60)
