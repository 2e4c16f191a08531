"""Volumes of tetrahedra and an enclosed volume that is held: both programs solve one problem."""

import subprocess

import numpy as np
import pytest

from analysis.paths import PROGRAMS
from analysis.runs import load_run

SCENE = """
name = "held"
gravity = [0, -2, 0] # m/s2
material.E = 2e4 # Pa

[surface]
shape = "ball"
n_vertices = 162

[[supports]]
region = { box = { low = [0, 0, 0], high = [1, 0.2, 1] }, relative = true }

[volume]
exact = true
target = [[0, 1], [0.5, 1], [1, 1.3]]

[time]
load_steps = 4
integrator = "minimising_euler"
step = 0.02 # s
end = 1 # s

[reference]
integrator = "minimising_euler"
"""
HELD = 1e-9  # of a volume: as exactly as it is held
CURVED = 1e-2  # quadratic faces hold theirs, and curves.csv tells that of their corners


def run(tmp_path, program, *overrides):
    (tmp_path / "scene.toml").write_text(SCENE)
    out = tmp_path / "_".join([program, *overrides]).replace("/", "")
    settings = [word for override in overrides for word in ("--set", override)]
    subprocess.run(
        [PROGRAMS / program, tmp_path / "scene.toml", "--quiet", "--out", out, *settings], check=True
    )
    return load_run(out)


@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_a_held_volume_is_the_target_in_both_programs(mode, tmp_path):
    pressures = []
    for program, degree in (("massspring", 1), ("fem_reference", 1), ("fem_reference", 2)):
        words = f"time.mode={mode}", f"reference.degree={degree}"
        curves = run(tmp_path, program, *words).curves
        target = np.interp(curves["time"], [0, 0.5, 1], [1, 1, 1.3])
        assert curves["volume"] / curves["volume"][0] == pytest.approx(
            target, rel=HELD if degree == 1 else CURVED
        )
        pressures.append(curves["volume_pressure"])
        if mode == "dynamic":
            assert np.abs(curves["volume_energy"]).max() == 0
    springs, linear, quadratic = (p[-1] for p in pressures)
    assert springs == pytest.approx(quadratic, rel=0.1) and linear == pytest.approx(quadratic, rel=0.1)
    assert pressures[0][0] == 0 and quadratic > 1000


# A body that nothing else loads is strained evenly, its cavity or not: the bulk modulus times the change of volume.
@pytest.mark.parametrize("shape", ["ball", "hollow_ball"])
def test_a_free_ball_takes_the_pressure_of_its_bulk_modulus(shape, tmp_path):
    growth, nu = 1e-3, 0.3
    words = "supports=[]", "gravity=[0, 0, 0]", f"surface.shape={shape}", f"material.nu={nu}"
    for program in ("massspring", "fem_reference"):
        target = f"volume.target=[[0, 1], [1, {1 + growth}]]"
        pressure = run(tmp_path, program, *words, target).curves["volume_pressure"]
        assert pressure[-1] == pytest.approx(2e4 / (3 * (1 - 2 * nu)) * growth, rel=0.005)
        assert pressure == pytest.approx(np.linspace(0, pressure[-1], 5), rel=0.005)


def test_what_cannot_hold_a_volume_says_so(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)

    def end_of(program, *overrides):
        settings = [word for override in overrides for word in ("--set", override)]
        command = [PROGRAMS / program, tmp_path / "scene.toml", "--quiet", "--out", tmp_path / "out"]
        return subprocess.run(
            [*command, "--set", "time.mode=dynamic", *settings], capture_output=True, text=True
        )

    for integrator in ("implicit_euler", "rk4", "tr_bdf2"):
        refused = end_of("massspring", f"time.integrator={integrator}")
        assert refused.returncode == 1
        assert (
            f"time.integrator = {integrator}, expected minimising_euler or bdf2 with volume.exact"
            in refused.stderr
        )
    assert end_of("fem_reference", "reference.integrator=generalised_alpha").returncode == 3
    both = end_of("fem_reference", "volume.coefficient=5")
    assert both.returncode == 1
    assert "volume.coefficient = 5, expected 0 with volume.exact" in both.stderr


def test_volumes_of_tetrahedra_resist_alike_in_both_programs(tmp_path):
    """What a ball loses of its volume under its weight, where its tetrahedra resist besides."""
    ends = []
    for kappa in (0, 2e4):
        lost = {}
        for program, degree in (("massspring", 1), ("fem_reference", 1), ("fem_reference", 2)):
            words = f"volume={{ local = {kappa} }}", f"reference.degree={degree}"
            curves = run(tmp_path, program, *words).curves
            lost[program, degree] = 1 - curves["volume"][-1] / curves["volume"][0]
        springs, linear, quadratic = lost.values()
        assert springs == pytest.approx(linear, rel=0.05)
        assert springs == pytest.approx(quadratic, rel=0.2)
        ends.append(quadratic)
    assert ends[1] < 0.6 * ends[0]


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_a_light_load_ends_on_a_stiff_volume(program, tmp_path):
    """Where the rounding of the enclosed volume is more of the load than time.residual."""
    words = "volume={ coefficient = 2e6 }", "time.load_steps=1"
    light, heavy = (
        run(tmp_path, program, *words, f"gravity=[0, {g}, 0]").curves["max_displacement"][-1]
        for g in (-1e-5, -1e-3)
    )
    assert 0 < light < 1e-6
    assert heavy / light == pytest.approx(100, rel=1e-4)
