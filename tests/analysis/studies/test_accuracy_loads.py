"""The accuracy study's loads: balance against closed forms, and the study over stand-ins for the solvers."""

import random
import signal
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from solvers import ERRORS, calls, make_solvers, wait_for_calls
from synthetic import write_run

from analysis.paths import ROOT
from analysis.points import Store
from analysis.studies import accuracy_loads
from analysis.studies.accuracy_loads import (
    LOADS,
    MODELS,
    Loads,
    balancing,
    cases,
    eighths,
    resultant,
    scene_of,
    weight,
)

# 3 x 2 x 1 m, a corner at (1, 1, 1), outward.
BOX = np.array([[1 + 3 * (i & 1), 1 + (i & 2), 1 + (i >> 2)] for i in range(8)], dtype=float)
SIDES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6],
     [1, 3, 5], [3, 7, 5]]
)  # fmt: skip


def test_weight_is_that_of_a_box():
    g = np.array([0, 0, -2.0])
    force, centre = 6 * 10 * g, np.array([2.5, 2, 1.5])
    np.testing.assert_allclose(weight(BOX, SIDES, g, 10), [*force, *np.cross(centre, force)], rtol=1e-13)


def test_resultant_is_that_of_a_pulled_side():
    top = SIDES[2:4]  # 6 m2 at z = 2
    load = resultant(BOX, top, np.tile([0, 5.0, 0], (2, 1)))
    np.testing.assert_allclose(load, [0, 30, 0, *np.cross([2.5, 2, 2], [0, 30, 0])], rtol=1e-13)


def balance_of(scene, X, F):
    """Force and torque left of all loads of a scene, over their sum, by adding up triangle by triangle."""
    relative = (X - X.min(axis=0)) / (X.max(axis=0) - X.min(axis=0))
    total, size = np.zeros(6), 0.0
    if "gravity" in scene:
        total += weight(X, F, np.array(scene["gravity"]), 1000)
        size += np.abs(total).sum()
    for load in scene["loads"]:
        (kind, region), n_triangles = next(iter(load["region"].items())), 0
        for a, b, c in F:
            if kind == "sphere":
                inside = all(np.linalg.norm(X[i] - region["center"]) <= region["radius"] for i in (a, b, c))
            else:
                inside = all(
                    (relative[i] >= region["low"]).all() and (relative[i] <= region["high"]).all()
                    for i in (a, b, c)
                )
            if not inside:
                continue
            n_triangles += 1
            normal = np.cross(X[b] - X[a], X[c] - X[a]) / 2
            force = (
                np.array(load.get("traction", [0, 0, 0])) * np.linalg.norm(normal)
                - load.get("pressure", 0) * normal
            )
            total += [*force, *np.cross((X[a] + X[b] + X[c]) / 3, force)]
            size += np.abs(force).sum()
        assert n_triangles > 0
    return np.abs(total).max() / size


@pytest.mark.parametrize("load", ["gravity", "end_shear", "patch"])
def test_free_bodies_are_in_balance(load, ball):
    X, F = ball[0] * [1.3, 1, 0.5] + [0.1, 0.2, 0.3], ball[1]
    scene = tomllib.loads(scene_of(load, "", X, F))
    assert "supports" not in scene
    assert balance_of(scene, X, F) < 1e-12
    del scene["loads"][-1]  # one eighth less
    assert balance_of(scene, X, F) > 1e-3


def test_balance_is_the_least(ball):
    """The least mean square is orthogonal, over the area, to all tractions that balance nothing."""
    X, F = ball[0] * [1.3, 1, 0.5], ball[1]
    load = np.array([1.0, 2, 3, 4, 5, 6])
    parts = [part for _, _, part in eighths(X, F)]
    resultants = np.array(
        [resultant(X, p, np.tile(axis, (len(p), 1))) for p in parts for axis in np.eye(3)]
    ).T
    least = balancing(X, F, load).ravel()
    np.testing.assert_allclose(resultants @ least, -load, rtol=1e-9)
    areas = np.repeat(
        [np.linalg.norm(resultant(X, p, np.tile([1, 0, 0], (len(p), 1)))[:3]) for p in parts], 3
    )
    nothing = np.linalg.svd(resultants)[2][6:]
    assert len(nothing) == 3 * len(parts) - 6
    scale = np.abs(areas * least).max()
    np.testing.assert_allclose(nothing @ (areas * least), 0, atol=1e-9 * scale)
    assert np.abs(nothing @ least).max() > 1e-3 * np.abs(least).max()  # eighths differ in area


def test_every_case_is_measured_once():
    assert len(set(cases(False))) == len(cases(False))
    assert {load for _, _, load in cases(False)} == set(LOADS)
    assert {nu for nu, _, _ in cases(False)} == {"0", "0.25", "0.3", "0.45", "0.49"}


@pytest.fixture
def stand_ins(ball, tmp_path):
    """Springs off by a tenth of the reference without a refinement, which is off by 0.02 of the refined."""
    programs = make_solvers(tmp_path / "home", ball)
    refined = tmp_path / "home" / "fem_reference_refine_1"
    write_run(
        refined, *ball, lambda X: 0.01 / 1.02 * X, np.linspace(0, 1, 2),
        program="fem_reference", is_free=False, n_tetrahedra=10**6,
    )  # fmt: skip
    return programs


def study_of(folder, programs):
    return Loads(folder, folder, is_quiet=True, store=Store(folder / "points", programs=programs))


def test_error_is_to_the_refined_reference_whose_own_is_stated(stand_ins, tmp_path):
    rows = study_of(tmp_path / "study", stand_ins).measure("0.25", "ball:162", "end_shear")
    assert [row["model"] for row in rows] == list(MODELS)
    error = (1 + ERRORS["0.25"]) * 1.02 - 1
    assert [float(row["error_l2"]) for row in rows] == pytest.approx([error] * len(MODELS), rel=1e-5)
    assert [float(row["reference_error"]) for row in rows] == pytest.approx([0.02] * len(MODELS), rel=1e-5)
    assert {row["status"] for row in rows} == {"ok"}


@pytest.mark.parametrize(
    "load, n_tetrahedra, own", [("clamp", 31250, 0.01), ("clamp", 31251, 0.02), ("gravity", 31250, 0.02)]
)
def test_references_of_clamped_bodies_are_refined_twice_while_they_are_small(
    load, n_tetrahedra, own, ball, stand_ins, tmp_path
):
    """Each refinement makes eight of a tetrahedron. The second takes a hundredth off the displacement."""
    record = tmp_path / "home" / "fem_reference_refine_1" / "run.json"
    record.write_text(record.read_text().replace("1000000", str(n_tetrahedra)))
    twice = tmp_path / "home" / "fem_reference_refine_2"
    more = {"program": "fem_reference", "is_free": False}
    write_run(twice, *ball, lambda X: 0.01 / 1.02 / 1.01 * X, np.linspace(0, 1, 2), **more)
    rows = study_of(tmp_path / "study", stand_ins).measure("0.25", "ball:162", load)
    assert [float(row["reference_error"]) for row in rows] == pytest.approx([own] * len(MODELS), rel=1e-4)


def test_error_near_the_references_own_is_undecided(stand_ins, tmp_path, monkeypatch):
    monkeypatch.setattr(accuracy_loads, "DECIDED", 7)  # 0.122 < 7 x 0.02
    rows = study_of(tmp_path / "study", stand_ins).measure("0.25", "ball:162", "end_shear")
    assert {row["status"] for row in rows} == {"undecided"}


def test_references_of_other_surfaces_are_refused(ball, stand_ins, tmp_path):
    refined = tmp_path / "home" / "fem_reference_refine_1"
    refined.rename(tmp_path / "home" / "away")
    write_run(refined, ball[0] * 1.01, ball[1], lambda X: 0.01 * X, program="fem_reference", is_free=False)
    rows = study_of(tmp_path / "study", stand_ins).measure("0.25", "ball:162", "end_shear")
    assert len(rows) == len(MODELS)
    assert all("different surfaces" in row["status"] and "error_l2" not in row for row in rows)


def test_model_that_fails_is_a_row_that_says_why(stand_ins, tmp_path):
    rows = study_of(tmp_path / "study", stand_ins).measure("diverge", "ball:162", "end_shear")
    assert {row["status"] for row in rows} == {"massspring: diverged"}
    (stand_ins / "massspring").write_text("#!/bin/sh\necho 'error: floppy' >&2\nexit 1\n")
    rows = study_of(tmp_path / "other", stand_ins).measure("0.25", "ball:162", "end_shear")
    assert {row["status"] for row in rows} == {"massspring: failed: floppy"}


_STUDY = """
import sys
from pathlib import Path
from analysis.points import Store
from analysis.studies.accuracy_loads import Loads
folder, programs = map(Path, sys.argv[1:])
Loads(folder, folder, True, Store(folder / "points", programs=programs)).run(quick=True)
"""


def test_study_killed_at_random_points_continues_to_the_same_table(stand_ins, tmp_path):
    def start(folder):
        return subprocess.Popen([sys.executable, "-c", _STUDY, str(folder), str(stand_ins)], cwd=ROOT)

    assert start(tmp_path / "whole").wait() == 0
    n_points = len(calls(stand_ins))
    moments = random.Random(3)
    for _ in range(2):
        process = start(tmp_path / "killed")
        wait_for_calls(stand_ins, len(calls(stand_ins)) + moments.randint(3, 12), moments.uniform(0, 0.05))
        process.kill()
        assert process.wait() == -signal.SIGKILL
    finished = sum(
        ".part" not in f.parent.name for f in (tmp_path / "killed" / "points").glob("*/outcome.json")
    )
    n_calls = len(calls(stand_ins))
    assert 0 < finished < n_points
    assert start(tmp_path / "killed").wait() == 0
    assert (tmp_path / "killed" / "loads.csv").read_text() == (tmp_path / "whole" / "loads.csv").read_text()
    assert len(calls(stand_ins)) - n_calls - (n_points - finished) in (0, 1)
