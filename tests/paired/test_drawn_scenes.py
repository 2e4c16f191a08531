"""Scenes drawn at random: whatever parts they combine, both programs solve one problem.

A part that one program leaves out, or reads in another way, makes a difference that no mesh explains.
"""

import tomllib

import numpy as np
import pytest
from programs import ended, words_of

from analysis.compare import compare_runs, free_motions_of
from analysis.runs import load_run

N_SCENES = 16
E = 1e5  # Pa
LARGEST = 0.12  # error of node_averaged on surfaces of some 250 vertices


def end_of(axis, is_high, part=0.1):
    """The region of a part of the body."""
    low, high = [0.0] * 3, [1.0] * 3
    (low if is_high else high)[axis] = 1 - part if is_high else part
    return f"region = {{ box = {{ low = {low}, high = {high} }}, relative = true }}"


def drawn(seed):
    """A static scene: a body that is clamped, rolls or hangs on handles, and some of all that may act on it."""
    random = np.random.default_rng(seed)

    def vector(size):
        return (size * random.uniform(-1, 1, 3)).round(6).tolist()

    def happens(share=0.5):
        return random.random() < share

    held = random.choice(["clamped", "rolling", "handles"], p=[0.6, 0.25, 0.15])
    axis = int(random.integers(3))
    shape = random.choice(["bar", "ball", "torus", "head"])
    lines = [f"gravity = {vector(0.5)}"] if held != "rolling" and happens() else []
    lines += ["[surface]", f'shape = "{shape}"', f"n_vertices = {random.integers(200, 300)}"]
    lines += ["[material]", f"E = {E}", f"nu = {random.choice([0, 0.25, 0.4])}", "rho = 200"]
    if happens():
        lines.append('law = "neo_hookean"')
    if held == "handles":
        way = [[0, 0, 0, 0], [1, *vector(0.1)]]
        lines += ["[[handles]]", end_of(axis, False, 0.5), f"stiffness = {10 * E}", f"motion = {way}"]
    else:
        components = "xyz" if held == "clamped" else "xyz"[axis]
        lines += ["[[supports]]", end_of(axis, False), f'components = "{components}"']
        if happens():
            moved = f"displacement = {vector(0.02)}"
            lines += ["[[supports]]", end_of(axis, True), f'components = "{"xyz"[axis]}"', moved]
    lines += ["[[loads]]", f"pressure = {E * random.uniform(-0.005, 0.005)}"]
    if happens():
        lines.append("follower = true")
    if held != "rolling" and happens():
        lines += ["[[loads]]", end_of(axis, True), f"traction = {vector(0.002 * E)}"]
    if happens(0.4):
        lines += ["[collapse]", "coefficient = 0.05", "[[collapse.pivots]]", f"point = {vector(0.5)}"]
    if happens(0.3):
        target = [[0, 1], [1, random.uniform(0.97, 1.03)]]
        lines += ["[volume]", f"coefficient = {E}", f"target = {target}"]
    if happens(0.3):
        lines += ["[skin]", f"stiffness = {0.02 * E}", f"bending = {0.001 * E}"]
    return "\n".join([*lines, "[time]", "load_steps = 2", "[network]", "estimate = false"])


@pytest.mark.parametrize("seed", range(N_SCENES))
def test_springs_and_elements_solve_one_problem(seed, tmp_path):
    scene = drawn(seed)
    runs = []
    for program, words in (("massspring", ["--no-diagnostics"]), ("fem_reference", [])):
        done = ended(words_of(tmp_path, program, scene, out=program, words=words))
        assert done.returncode == 0, f"{program}: {done.stderr}\n{scene}"
        runs.append(load_run(tmp_path / program))
    free = free_motions_of(tomllib.loads(scene), (run.record for run in runs))
    assert compare_runs(*runs, free).displacement_error_l2 < LARGEST, scene
