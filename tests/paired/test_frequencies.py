"""Natural frequencies of both programs count all that is stiff: handles and the enclosed volume, too."""

import json
import subprocess

import numpy as np
import pytest

from analysis.paths import PROGRAMS

RHO, SIZE, PULL = 1000, (4, 1, 1), 1e3  # kg/m3, m, N/m
SCENE = f"""
material = {{ E = 1e5, nu = 0.3, rho = {RHO} }}
loads = [{{ pressure = 100 }}]
[surface]
shape = "bar"
n_vertices = 200
size = {list(SIZE)}
"""
BOTH = ("massspring", "fem_reference")


def ended(tmp_path, program, n, *overrides):
    (tmp_path / "scene.toml").write_text(SCENE)
    words = [PROGRAMS / program, tmp_path / "scene.toml", "--quiet", "--out", tmp_path / program]
    settings = [word for override in overrides for word in ("--set", override)]
    return subprocess.run([*words, "--frequencies", str(n), *settings], capture_output=True, text=True)


def frequencies(tmp_path, program, n, *overrides):
    done = ended(tmp_path, program, n, *overrides)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / program / "run.json").read_text())
    return np.array(record["natural_frequencies"]), record["n_zero_frequencies"]


def test_stiff_volume_raises_the_bars_stretching_alone(tmp_path):
    found = {}
    for program in BOTH:
        free, n_zero = frequencies(tmp_path, program, 9)
        stiff, also = frequencies(tmp_path, program, 9, "volume.coefficient=1e6")
        assert n_zero == also == 6
        found[program] = stiff
        ratio = stiff / free
        stretching = int(np.argmax(ratio))
        assert ratio[stretching] > 1.03
        assert np.delete(ratio, stretching) == pytest.approx(1, abs=1e-3)
    assert found["massspring"] == pytest.approx(found["fem_reference"], rel=0.02)


@pytest.mark.parametrize("program", BOTH)
def test_handles_on_the_whole_surface_are_springs_under_the_body(tmp_path, program):
    handle = f"handles=[{{region={{sphere={{center=[0,0,0],radius=9}}}},stiffness={PULL}}}]"
    found, n_zero = frequencies(tmp_path, program, 3, handle, "loads.0.pressure=1")
    assert n_zero == 0
    assert found == pytest.approx(np.sqrt(PULL / (RHO * np.prod(SIZE))) / (2 * np.pi), rel=0.01)


@pytest.mark.parametrize("program", BOTH)
def test_a_volume_that_is_held_exactly_is_refused(tmp_path, program):
    done = ended(tmp_path, program, 3, "volume.exact=true", "volume.target=[[0, 1], [1, 1]]")
    assert done.returncode == 1
    assert "scene.toml: volume.exact = true with --frequencies, expected volume.coefficient" in done.stderr
