"""What the reference solves its equations with, and how well."""

import shutil
import subprocess

import numpy as np
import pytest
import pyvista as pv
from scipy import sparse
from scipy.sparse.linalg import splu

from analysis.execute import solver
from analysis.paths import PROGRAMS, SCENES
from analysis.run_store import RunRequest, Store
from analysis.runs import load_run

_E, _NU, _RHO, _G = 1e8, 0.25, 1000, np.array([0, -1e-4, 0])
_EDGES = (
    (0, 1),
    (1, 2),
    (2, 0),
    (0, 3),
    (1, 3),
    (2, 3),
)  # whose middles nodes 4 to 9 of a quadratic tetrahedron are


def test_tolerances_near_rounding_need_no_factor_of_all(tmp_path):
    """Newton's last steps ask for residuals about as small as single precision leaves."""
    size = ("surface.n_vertices=162", "reference.refine=1", "output.frames_every=0")
    outcome = Store(tmp_path).run(RunRequest("fem_reference", SCENES / "ball_collapses_far.toml", size))
    assert outcome.status == "ok"
    assert "two levels" in outcome.record["solver"]
    assert outcome.record["newton_iterations"] <= 15


@pytest.mark.parametrize("n_along, angle", [(150, 0.0), (200, 1.0)])
def test_needles_are_solved_as_by_a_factor_of_the_whole_matrix(n_along, angle, tmp_path):
    """Fifty times as long as thick: what rounds in the matrix moves the end by some 1e-9."""
    surface, scene = tmp_path / "needle.ply", tmp_path / "needle.toml"
    _needle(n_along, 8, angle).save(surface)
    scene.write_text(
        f'gravity = {_G.tolist()}\nsurface = {{ file = "{surface.name}", across = 0 }}\n'
        f"material = {{ E = {_E}, nu = {_NU}, rho = {_RHO} }}\ntime.load_steps = 1\noutput.frames_every = 0\n"
        "[[supports]]\nregion = { box = { low = [0, 0, 0], high = [0.02, 1, 1] }, relative = true }\n"
    )
    outcome = Store(tmp_path / "runs").run(RunRequest("fem_reference", scene))
    assert outcome.status == "ok"
    run = load_run(outcome.folder)
    grid = pv.read(run.file(-1))
    u = np.asarray(grid["displacement"])
    exact = _by_factor(np.asarray(grid["rest_position"]), grid.cells_dict[pv.CellType.QUADRATIC_TETRA], u)
    assert np.abs(u - exact).max() < 1e-7 * np.abs(exact).max()


def _needle(n_along, n_around, angle):
    """A round needle of 1 m by 2 cm along an arc that turns by `angle`."""
    s, k = np.linspace(0, 1, n_along + 1), np.arange(n_along + 1)
    turn = np.maximum(angle, 1e-9) * s
    axis = np.column_stack([np.sin(turn), 1 - np.cos(turn), 0 * s]) / np.maximum(angle, 1e-9)
    across = np.column_stack([-np.sin(turn), np.cos(turn), 0 * s])
    around = 2 * np.pi * (np.arange(n_around) + 0.5 * (k[:, None] % 2)) / n_around
    rings = np.cos(around)[..., None] * across[:, None] + np.sin(around)[..., None] * np.array([0, 0, 1])
    X = np.vstack([(axis[:, None] + 0.01 * rings).reshape(-1, 3), axis[[0, -1]]])
    a = (n_around * k[:, None] + np.arange(n_around)).ravel()[:-n_around]
    b = a + 1 - n_around * ((a + 1) % n_around == 0)
    c, d, is_even = a + n_around, b + n_around, (a // n_around % 2 == 0)[:, None]
    left = np.where(is_even, np.column_stack([a, b, c]), np.column_stack([a, d, c]))
    right = np.where(is_even, np.column_stack([b, d, c]), np.column_stack([a, b, d]))
    first = np.column_stack([b, a, np.full_like(a, len(X) - 2)])[:n_around]
    last = np.column_stack([c, d, np.full_like(a, len(X) - 1)])[-n_around:]
    F = np.vstack([left, right, first, last])
    return pv.PolyData.from_regular_faces(X, F if np.linalg.det(X[F]).sum() > 0 else F[:, ::-1])


def _by_factor(X, tets, u):
    """Of quadratic tetrahedra (m, 10) under their weight, where u holds nothing at rest: displacement (n, 3) in m."""
    jacobian = X[tets[:, 1:4]] - X[tets[:, :1]]
    volume = np.linalg.det(jacobian)[:, None, None] / 6
    gradient = np.linalg.inv(jacobian).transpose(0, 2, 1)
    gradient = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    lame, mu = _E * _NU / (1 + _NU) / (1 - 2 * _NU), _E / 2 / (1 + _NU)
    stiffness = np.zeros((len(tets), 10, 3, 10, 3))
    for corner in range(4):
        L = np.full(4, (5 - np.sqrt(5)) / 20)
        L[corner] = 1 - 3 * L[0 if corner else 1]
        ends = [(4 * L[i] - 1) * gradient[:, i] for i in range(4)]
        middles = [4 * (L[i] * gradient[:, j] + L[j] * gradient[:, i]) for i, j in _EDGES]
        D = np.stack(ends + middles, axis=1)
        dots = np.einsum("tac,tbc->tab", D, D)
        stiffness += (volume / 4)[..., None, None] * (
            lame * np.einsum("tac,tbd->tacbd", D, D)
            + mu * np.einsum("tad,tbc->tacbd", D, D)
            + mu * np.einsum("tab,cd->tacbd", dots, np.eye(3))
        )
    unknown = (3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), 30)
    rows, columns = np.repeat(unknown, 30, axis=1).ravel(), np.tile(unknown, (1, 30)).ravel()
    K = sparse.csc_matrix((stiffness.ravel(), (rows, columns)), shape=(u.size, u.size))
    load = np.zeros_like(u)
    np.add.at(load, tets[:, :4], -volume / 20 * _RHO * _G)
    np.add.at(load, tets[:, 4:], volume / 5 * _RHO * _G)
    is_free = np.repeat(u.any(axis=1), 3)
    free = K[is_free][:, is_free]
    factor = splu(free, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    exact, rest = np.zeros(u.size), load.ravel()[is_free]
    x = factor.solve(rest)
    exact[is_free] = x + factor.solve(rest - free @ x)
    return exact.reshape(u.shape)


_FAILS_THREE_TIMES = """#!/bin/sh
# gmsh, tetgen and gmsh's HXT: nodes that these choose themselves.
echo call >> {folder}/calls
[ $(wc -l < {folder}/calls) -gt 3 ] || {{ echo "Error   : not recovered"; exit 1; }}
exec {real} "$@"
"""


def test_a_surface_that_no_mesher_fills_is_filled_around_points(tmp_path):
    program = tmp_path / "fem_reference"
    shutil.copy(PROGRAMS / program.name, program)
    for name in ("gmsh_worker", "tetgen_worker"):
        worker = tmp_path / name
        worker.write_text(_FAILS_THREE_TIMES.format(folder=tmp_path, real=PROGRAMS / "gmsh_worker"))
        worker.chmod(0o755)
    records = []
    for started in (program, PROGRAMS / "massspring"):
        out = tmp_path / f"out_of_{started.name}"
        overrides = ("surface.across=0", "surface.n_vertices=100", "reference.degree=1")
        words = solver(started, SCENES / "bar_sag.toml", out, overrides, ("--quiet",))
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        records.append(load_run(out).record)
    of_elements, of_springs = records
    assert of_elements["mesher"] == "gmsh, Delaunay, around points"
    assert len(of_elements["meshers_failed"]) == 3
    assert of_elements["n_nodes"] == of_springs["n_nodes"], "the same points inside"
