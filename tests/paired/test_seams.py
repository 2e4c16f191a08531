"""A part of a body that no support holds hangs on its seam alike in both programs, or is refused."""

import subprocess

import numpy as np
import pytest
import pyvista as pv
from scipy.spatial import KDTree

from analysis.paths import PROGRAMS
from analysis.runs import load_run

GAP, STITCH, RHO, G = 0.05, 1e6, 1000, 30  # m, N/m, kg/m3, m/s2
SCENE = f"""
gravity = [{G}, 0, 0]
material = {{ E = 1e6, nu = 0.3, rho = {RHO}, law = "neo_hookean" }}
surface = {{ file = "cubes.ply" }}
[[supports]]
region = {{ box = {{ low = [0, -9, -9], high = [0, 9, 9] }} }}
[[seams]]
from = {{ box = {{ low = [1, -9, -9], high = [1, 9, 9] }} }}
to = {{ box = {{ low = [{1 + GAP / 2}, -9, -9], high = [{1 + 3 * GAP / 2}, 9, 9] }} }}
stiffness = {STITCH}
"""


def run(folder, program, text):
    cubes = [pv.Cube(center=(0.5 + at, 0, 0)).triangulate().subdivide(2).clean() for at in (0, 1 + GAP)]
    cubes[0].append_polydata(cubes[1]).save(folder / "cubes.ply")
    (folder / "scene.toml").write_text(text)
    command = [PROGRAMS / program, folder / "scene.toml", "--quiet", "--out", folder / program]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_stitches_carry_the_weight_of_the_part_that_hangs_on_them(program, tmp_path):
    done = run(tmp_path, program, SCENE)
    assert done.returncode == 0, done.stderr
    end = load_run(tmp_path / program).last
    x = end.X + end.u
    (upper,), (lower,) = (np.nonzero(np.abs(end.X[:, 0] - at) < 1e-6) for at in (1, 1 + GAP))
    nearest = lower[KDTree(end.X[lower]).query(end.X[upper])[1]]
    force = STITCH * (x[nearest] - x[upper]).sum(axis=0)
    assert force == pytest.approx([RHO * G, 0, 0], abs=1e-4 * RHO * G)


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
@pytest.mark.parametrize("relief", ["", "reference.inertia_relief = true\n"])
def test_parts_that_nothing_ties_need_a_support_each(program, relief, tmp_path):
    done = run(
        tmp_path, program, relief + SCENE.partition("[[seams]]")[0].replace("neo_hookean", "small_strain")
    )
    assert done.returncode == 1 and "1 of the surface's 2 parts meet no support" in done.stderr
    assert "expected a support for each in statics, or seams that tie it to others" in done.stderr
