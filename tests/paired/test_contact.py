"""Scenes with obstacles, which both programs solve: the reference judges them."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from programs import ended, words_of

from analysis.compare import displacement_error
from analysis.experiment import run_solvers
from analysis.paths import PROGRAMS, SCENES
from analysis.results import write_results
from analysis.runs import load_run


def compared(name: str, folder: Path, *overrides: str):
    experiment = run_solvers(
        SCENES / f"{name}.toml", folder, None, list(overrides), is_quiet=True, time_limit=5
    )
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


OVERLAP = """
gravity = [0, -9.81, 0] # m/s2
material.E = 1e5 # Pa

[surface]
shape = "{shape}"
n_vertices = 60
size = [1, 1, 1] # m

[[obstacles]]
plane = {{ point = [0, {low}, 0], normal = [0, 1, 0] }}
initially = "{initially}"

[time]
mode = "dynamic"
step = 0.01 # s
end = 0.02 # s
integrator = "minimising_euler"

[reference]
degree = 1
integrator = "minimising_euler"
"""
CLAMP = """
[[supports]]
region = { box = { low = [0, 1, 0], high = [1, 1, 1] }, relative = true }
"""


def begun(program, folder, scene):
    return ended(words_of(folder, program, scene))


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_free_body_that_overlaps_a_floor_is_lifted_onto_it_and_keeps_its_velocity(program, tmp_path):
    scene = OVERLAP.format(shape="ball", low=-0.45, initially="resolve")
    scene += "[[initial]]\nregion = { sphere = { center = [0, 0, 0], radius = 2 } }\nvelocity = [0.5, 0, 0] # m/s\n"
    done = begun(program, tmp_path, scene)
    assert done.returncode == 0, done.stderr
    run = load_run(tmp_path / "out")
    first = run.frame(0)
    np.testing.assert_allclose(
        first.u, np.tile([0, -0.45 - first.X[:, 1].min(), 0], (len(first.X), 1)), atol=1e-6
    )
    assert run.curves["elastic_energy"][0] < 1e-6
    v = np.asarray(pv.read(run.file(0))["velocity"])
    np.testing.assert_allclose(v, np.tile([0.5, 0, 0], (len(v), 1)), atol=1e-12)
    refused = begun(program, tmp_path, scene.replace('"resolve"', '"refuse"'))
    assert refused.returncode == 1 and "obstacles[0]: " in refused.stderr


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_clamped_body_that_overlaps_a_floor_begins_pressed(program, tmp_path):
    scene = OVERLAP.format(shape="bar", low=0.03, initially="resolve") + CLAMP
    done = begun(program, tmp_path, scene)
    assert done.returncode == 0, done.stderr
    run = load_run(tmp_path / "out")
    first = run.frame(0)
    moved = first.X + first.u
    assert 0.03 < moved[:, 1].min() < 0.031
    top = first.X[:, 1] > 1 - 1e-9
    assert np.abs(first.u[top]).max() < 1e-12
    # A cube between plates at its ends: E/2 (0.03)^2 per volume, and more as its top cannot widen.
    assert 45 < run.curves["elastic_energy"][0] < 60
    assert abs(run.curves["lost_to_scheme"][0]) < 1e-6


ROLLERS = """
[[supports]]
region = { box = { low = [0, 1, 0], high = [1, 1, 1] }, relative = true }
components = "y"
"""


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_body_on_rollers_that_overlaps_a_floor_begins_under_one_stress(program, tmp_path):
    scene = OVERLAP.format(shape="bar", low=0.03, initially="resolve") + ROLLERS
    done = begun(program, tmp_path, scene)
    assert done.returncode == 0, done.stderr
    run = load_run(tmp_path / "out")
    first = run.frame(0)
    moved = first.X + first.u
    size = np.ptp(moved, axis=0)
    pressed = 1 - size[1]
    assert 0.03 < pressed < 0.031, "what the barrier's gap adds"
    # Between plates without friction there is no stress across: E/2 e^2 per volume, to second order in the strain e.
    assert run.curves["elastic_energy"][0] == pytest.approx(1e5 / 2 * pressed**2, rel=2 * pressed)
    np.testing.assert_allclose(size[[0, 2]] - 1, 0.25 * pressed, rtol=2 * pressed)
    np.testing.assert_allclose((moved - first.X)[:, [0, 2]].mean(axis=0), 0, atol=1e-3)
    assert abs(run.curves["lost_to_scheme"][0]) < 1e-6


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_obstacle_around_the_body_is_refused_at_once(program, tmp_path):
    scene = OVERLAP.format(shape="ball", low=0.45, initially="resolve")
    around = scene.replace(
        "plane = { point = [0, 0.45, 0], normal = [0, 1, 0] }", "sphere = { center = [0, 0, 0], radius = 3 }"
    )
    done = begun(program, tmp_path, around)
    assert done.returncode == 1
    assert "obstacles[0] begins around the body" in done.stderr
