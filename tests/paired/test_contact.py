"""Scenes with obstacles, which both programs solve: the reference judges them."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from analysis.compare import displacement_error
from analysis.experiment import run_solvers
from analysis.paths import PROGRAMS, SCENES
from analysis.results import write_results
from analysis.runs import load_run


def compared(name: str, folder: Path, *overrides: str):
    experiment = run_solvers(SCENES / f"{name}.toml", folder, None, list(overrides), is_quiet=True)
    comparison = write_results(experiment)
    assert comparison["status"] == "ok"
    assert "no_reference" not in comparison
    return experiment, comparison


@pytest.mark.parametrize("degree", [1, 2])
def test_pressed_cube_has_one_stress_by_every_method(degree, tmp_path):
    experiment, comparison = compared("cube_pressed", tmp_path, f"reference.degree={degree}")
    reference = load_run(experiment.reference_folder).last
    for name, model in comparison["models"].items():
        assert model["displacement_error_l2"] < 0.01, (
            name
        )  # plates without friction let it shift and turn a little
        springs = load_run(experiment.massspring_folder(name)).last
        assert displacement_error(reference.X, reference.F, springs.u, reference.u, is_free=True).l2 < 1e-4, (
            name
        )


def test_block_on_a_slope_is_held_by_friction(tmp_path):
    _, comparison = compared("slope", tmp_path)
    assert comparison["models"]["node_averaged"]["displacement_error_l2"] < 0.05


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_block_slides_where_the_slope_is_a_hundredth_too_steep(program, tmp_path):
    for part, status in ((0.99, 0), (1.01, 2)):
        angle = np.arctan(part * 0.5)
        gravity = f"gravity=[{9.81 * np.sin(angle)}, {-9.81 * np.cos(angle)}, 0]"
        command = [PROGRAMS / program, SCENES / "slope.toml", "--quiet", "--out", tmp_path / str(part)]
        assert subprocess.run([*command, "--set", gravity]).returncode == status, part


@pytest.mark.parametrize("scene", ["bar_pressed", "ball_pressed"])
def test_body_is_pressed_far_between_plates_by_one_force_in_both_programs(scene, tmp_path):
    experiment, _ = compared(scene, tmp_path, "reference.degree=1", "output.frames_every=0")
    folders = [
        experiment.reference_folder,
        *map(experiment.massspring_folder, ("node_averaged", "edge_coupled")),
    ]
    force = {}
    for folder in folders:
        curves = load_run(folder).curves
        below, above = (np.array([curves[f"obstacle_{k}_force_{c}"] for c in "xyz"])[:, -1] for k in (0, 1))
        assert np.abs(below + above).max() < 1e-6 * below[1], folder
        force[folder] = below[1]
    assert max(force.values()) < 1.1 * min(force.values())


def momentum(run, k: int) -> np.ndarray:
    """Of the k-th frame over the density, in m4/s: shape functions integrated over straight tetrahedra at rest."""
    grid = pv.read(run.file(k))
    cells = next(cells for cells in grid.cells_dict.values() if cells.shape[1] in (4, 10))
    corners = np.asarray(grid["rest_position"], dtype=float)[cells[:, :4]]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    weights = np.array([-1 / 20] * 4 + [1 / 5] * 6) if cells.shape[1] == 10 else np.full(4, 1 / 4)
    return np.einsum("t,n,tnc->c", volumes, weights, np.asarray(grid["velocity"], dtype=float)[cells])


def test_ball_bounces_alike_in_both_programs_and_keeps_its_momentum_along_the_floor(tmp_path):
    experiment, comparison = compared("ball_drop", tmp_path)
    assert comparison["models"]["node_averaged"]["displacement_error_l2"] < 0.1
    for folder in (experiment.reference_folder, experiment.massspring_folder("node_averaged")):
        run = load_run(folder)
        p = np.array([momentum(run, k) for k in range(len(run.times))])
        assert p[0, 1] < -1 < 0.2 < p[-1, 1], folder
        assert np.abs(p[:, 0] / p[0, 0] - 1).max() < 1e-9, folder
