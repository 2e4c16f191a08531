"""Handles pull the surface alike in both programs, and events are the springs' alone."""

import subprocess

import numpy as np
import pytest

from analysis.paths import PROGRAMS
from analysis.runs import load_run

LENGTH, SIDE = 0.4, 0.1  # m
E, NU, PULL, WAY = 1e5, 0.3, 40, 1e-3  # Pa, 1, N/m, m
SCENE = f"""
material = {{ E = {E}, nu = {NU}, rho = 1000 }}
[surface]
shape = "bar"
n_vertices = 200
size = [{LENGTH}, {SIDE}, {SIDE}]
[[supports]]
region = {{ box = {{ low = [0, 0, 0], high = [0, 1, 1] }}, relative = true }}
[[handles]]
region = {{ box = {{ low = [1, 0, 0], high = [1, 1, 1] }}, relative = true }}
stiffness = {PULL}
motion = [[0, 0, 0, 0], [1, 0, {WAY}, 0]]
[time]
load_steps = 2
integrator = "minimising_euler"
step = 0.01
end = 1
[reference]
integrator = "minimising_euler"
"""


def run(tmp_path, program, *overrides):
    (tmp_path / "scene.toml").write_text(SCENE)
    settings = [word for override in overrides for word in ("--set", override)]
    command = [PROGRAMS / program, tmp_path / "scene.toml", "--quiet", "--out", tmp_path / program, *settings]
    return subprocess.run(command, capture_output=True, text=True)


def tip(tmp_path, program, *overrides):
    """Mean displacement of the pulled end in y (m), and the run's curves."""
    done = run(tmp_path, program, *overrides)
    assert done.returncode == 0, done.stderr
    found = load_run(tmp_path / program)
    end = found.last.X[:, 0] > found.last.X[:, 0].max() - 1e-9
    return found.last.u[end, 1].mean(), found.curves


def stiffness_of_beam():
    """At its end, clamped at the other one (N/m): Timoshenko's beam."""
    bends = LENGTH**3 / (3 * E * SIDE**4 / 12)
    shears = LENGTH / (5 / 6 * E / (2 * (1 + NU)) * SIDE**2)
    return 1 / (bends + shears)


@pytest.mark.parametrize("program, bound", [("massspring", 0.1), ("fem_reference", 0.05)])
def test_a_beam_and_the_spring_that_pulls_it_share_the_way(program, bound, tmp_path):
    expected = WAY * PULL / (PULL + stiffness_of_beam())
    assert tip(tmp_path, program)[0] == pytest.approx(expected, rel=bound)


def test_both_programs_are_pulled_alike_in_motion_and_their_energies_balance(tmp_path):
    ways = []
    for program in ("massspring", "fem_reference"):
        way, curves = tip(tmp_path, program, "time.mode=dynamic", "handles.0.end=0.9")
        ways.append(way)
        put_in, held = curves["work_of_targets"], curves["handle_energy"]
        assert held[-20] > 0 and held[-1] == 0 and put_in[-20] > put_in[-1] > 0
        inside = curves["kinetic_energy"] + curves["elastic_energy"] + held
        np.testing.assert_allclose(inside + curves["lost_to_scheme"], put_in, atol=1e-9 * put_in.max())
    assert ways[0] == pytest.approx(ways[1], rel=0.1)


def test_a_body_that_nothing_else_holds_goes_along_without_strain(tmp_path):
    for program in ("massspring", "fem_reference"):
        words = "supports=[]", "handles.0.region={}", "handles.0.motion=[[0, 0, 0, 0], [1, 0.02, 0.3, -0.1]]"
        done = run(tmp_path, program, *words)
        assert done.returncode == 0, done.stderr
        u = load_run(tmp_path / program).last.u
        np.testing.assert_allclose(u, np.tile([0.02, 0.3, -0.1], (len(u), 1)), atol=1e-7)


def test_events_are_the_springs_alone(tmp_path):
    event = "events=[{ time = 0.5, key = 'material.E', value = '5e4' }]"
    assert run(tmp_path, "massspring", event).returncode == 0
    refused = run(tmp_path, "fem_reference", event)
    assert refused.returncode == 3 and "events" in refused.stdout + refused.stderr
