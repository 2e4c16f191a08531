"""Scenes with obstacles, which both programs solve: the reference judges them."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

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


def test_ball_bounces_alike_in_both_programs(tmp_path):
    experiment, comparison = compared("ball_drop", tmp_path)
    assert comparison["models"]["node_averaged"]["displacement_error_l2"] < 0.1
    for folder in (experiment.reference_folder, experiment.massspring_folder("node_averaged")):
        run = load_run(folder)

        def velocity(k, run=run):
            return (run.frame(k + 1).u - run.frame(k).u).mean(axis=0) / (run.times[k + 1] - run.times[k])

        first, last = velocity(0), velocity(-2)
        assert first[1] < -1 < 0.2 < last[1], folder
        assert last[0] == pytest.approx(0.5, rel=0.02), folder
