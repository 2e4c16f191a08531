"""A rigid sphere pressed into a half-space, whose force and contact radius are known [Hertz 1881]."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from half_space import write_octant

from analysis.paths import PROGRAMS
from analysis.runs import load_run

_SCENE = Path(__file__).parent / "hertz.toml"
_CONTACT = 0.03  #: m, its radius at full depth


def pressed(folder: Path, program: str, *overrides: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths (m) of the load steps, forces and contact radii over Hertz's."""
    shutil.copy(_SCENE, folder / "hertz.toml")
    write_octant(folder / "half_space.off", 200 * _CONTACT, 1.3 * _CONTACT, _CONTACT / 6)
    command = [PROGRAMS / program, folder / "hertz.toml", "--quiet", "--out", folder / "run"]
    for override in overrides:
        command += ["--set", override]
    subprocess.run(command, check=True)
    curves = load_run(folder / "run").curves
    depth = _CONTACT**2 * curves["load_factor"][1:]
    force = -4 * curves["obstacle_0_force_y"][1:]
    radius = np.sqrt(4 * curves["obstacle_0_area"][1:] / np.pi)
    stiffness = 1e6 / (1 - 0.3**2)
    return depth, force / (4 / 3 * stiffness * depth**1.5), radius / np.sqrt(depth)


def test_quadratic_elements_have_hertz_force_and_radius(tmp_path):
    depth, force, radius = pressed(tmp_path, "fem_reference")
    assert np.abs(force[1:] - 1).max() < 0.03
    assert np.abs(radius[1:] - 1).max() < 0.03
    slope = 1.5 + np.polyfit(np.log(depth[1:]), np.log(force[1:]), 1)[0]
    assert slope == pytest.approx(1.5, abs=0.03)


@pytest.mark.parametrize("model,error", [("node_averaged", 0.03), ("edge_coupled", 0.09)])
def test_springs_come_near_hertz_force(model, error, tmp_path):
    depth, force, _ = pressed(
        tmp_path, "massspring", f"network.calibration={model}", "network.sampling=mesher"
    )
    assert np.abs(force[1:] - 1).max() < error
    slope = 1.5 + np.polyfit(np.log(depth[1:]), np.log(force[1:]), 1)[0]
    assert slope == pytest.approx(1.5, abs=0.03)
