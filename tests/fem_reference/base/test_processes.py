"""The reference under mpirun: what several processes solve is what one solves."""

import os
import subprocess

import numpy as np
import pytest

from analysis.paths import PROGRAMS, ROOT
from analysis.runs import load_run

TOLERANCE = (
    1e-9  # linear solves stop at 1e-13 of the load, which a displacement multiplies by the matrix' condition
)
MPIRUN = ("mpirun", "--oversubscribe", "-np", "2")


def solve(scene, folder, overrides, launcher=()):
    sets = [word for override in overrides for word in ("--set", override)]
    return subprocess.run(
        [
            *launcher,
            PROGRAMS / "fem_reference",
            ROOT / "analysis" / "scenes" / scene,
            "--quiet",
            "--out",
            folder,
            *sets,
        ],
        env={**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    "scene, degree",
    [("bar_sag.toml", 1), ("bar_sag.toml", 2), ("ball_pressure.toml", 2), ("ball_collapse.toml", 1)],
)
def test_two_processes_solve_what_one_does(scene, degree, tmp_path):
    overrides = ["surface.n_vertices=300", f"reference.degree={degree}"]
    runs = []
    for folder, launcher in ((tmp_path / "one", ()), (tmp_path / "two", MPIRUN)):
        done = solve(scene, folder, overrides, launcher)
        assert done.returncode == 0, done.stderr
        runs.append(load_run(folder))
    one, two = runs
    assert (one.record["processes"], two.record["processes"]) == (1, 2)
    assert np.abs(two.last.u - one.last.u).max() < TOLERANCE * np.abs(one.last.u).max()
    for name, values in one.curves.items():
        np.testing.assert_allclose(
            two.curves[name], values, rtol=TOLERANCE, atol=TOLERANCE * np.abs(values).max()
        )


def test_what_is_not_divided_is_refused_once(tmp_path):
    done = solve("bar_swing.toml", tmp_path / "out", [], MPIRUN)
    assert done.returncode != 0
    errors = [line for line in done.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1 and "dynamic" in errors[0] and "expected linear statics" in errors[0]
