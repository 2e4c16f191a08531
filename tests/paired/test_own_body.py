"""A body of one's own: at its true size by own_body.toml, and what is said where a scene scales it."""

import json
import subprocess

import numpy as np
import pytest
import pyvista as pv

from analysis.comparison import compare
from analysis.drawing.gltf import file_surface
from analysis.experiment import run_solvers
from analysis.paths import PROGRAMS, SCENES
from analysis.report import text_of
from analysis.runs import load_run

IN_MM = 'surface.unit="mm"'


@pytest.fixture
def beam(tmp_path):
    """A file of a beam of 10 x 40 x 10 mm, upright."""
    file = tmp_path / "beam.ply"
    pv.Box((0, 10, 0, 40, 0, 10)).triangulate().clean().save(file)
    return file


def test_it_bends_as_a_beam_of_its_true_size(beam, tmp_path):
    values = [IN_MM, "material.E=2e6", "material.nu=0.25", "gravity=[0, 0, 0]", "comparison.calibrations=[]"]
    experiment = run_solvers(SCENES / "own_body.toml", tmp_path / "out", beam, values, is_quiet=True)
    comparison = compare(experiment).as_json()
    assert comparison["status"] == "ok" and not experiment.notes
    X = compare(experiment).reference.last.X
    assert X.max(axis=0) - X.min(axis=0) == pytest.approx([0.01, 0.04, 0.01], rel=1e-6)
    # 100 Pa on the top, whose triangles alone lie in the highest fifth: F L^3 / 3 EI + F L / G kA.
    F, L, h, E, nu = 100 * 1e-4, 0.04, 0.01, 2e6, 0.25
    shear = E / (2 * (1 + nu)) * 10 * (1 + nu) / (12 + 11 * nu) * h**2
    tip = F * L**3 / (3 * E * h**4 / 12) + F * L / shear
    assert comparison["reference"]["largest_displacement"] == pytest.approx(tip, rel=0.03)
    assert comparison["displacement_error_l2"] < 0.03


@pytest.mark.parametrize(
    "program, words", [("massspring", ()), ("massspring", ("--check",)), ("fem_reference", ())]
)
def test_a_unit_that_has_no_effect_is_warned_of_once(beam, program, words, tmp_path):
    command = [PROGRAMS / program, SCENES / "sag.toml", "--quiet", "--out", tmp_path / program]
    for override in (IN_MM, f"surface.file={beam}", "surface.shape=", "load_scale.factor=1"):
        command += ["--set", override]
    done = subprocess.run([*command, *words], capture_output=True, text=True, check=True)
    assert (
        done.stderr.count(f"warning: --set {IN_MM}: surface.unit has no effect with surface.normalise") == 1
    )
    again = subprocess.run([*command, "--checked"], capture_output=True, text=True, check=True)
    assert "warning" not in again.stderr


def test_the_unit_of_a_scaled_body_is_that_of_its_file(beam):
    command = [PROGRAMS / "massspring", SCENES / "sag.toml", "--check", "--checked"]
    for override in (f"surface.file={beam}", "surface.shape=", "load_scale.factor=1", "surface.scale=5"):
        command += ["--set", override]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert json.loads(told)["normalised_unit"] == pytest.approx(0.1)


def test_the_report_says_by_what_a_body_was_scaled(beam, tmp_path, capfd):
    values = [IN_MM, "comparison.calibrations=[]"]
    experiment = run_solvers(SCENES / "sag.toml", tmp_path / "out", beam, values, is_quiet=True)
    said = text_of(compare(experiment).as_json())
    assert (
        "surface.normalise has scaled the body's coordinates by 0.1, so that its smallest side measures 1 m"
        in said
    )
    assert said.count("surface.unit has no effect") == 1
    assert capfd.readouterr().err.count("surface.unit has no effect") == 1


def test_a_run_keeps_the_way_back_to_its_file(tmp_path):
    """Of a cube of quadrilaterals in mm, z upwards, one of whose corners stands in the file twice."""
    corners = 10.0 * np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    points = np.vstack([corners, corners[7:]])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 8, 5)]
    lines = [f"v {x} {y} {z}" for x, y, z in points] + ["f " + " ".join(str(v + 1) for v in f) for f in faces]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    values = [
        IN_MM,
        'surface.up="z"',
        f"surface.file={tmp_path / 'cube.obj'}",
        "network.calibration=edge_coupled",
        "surface.shape=",
    ]
    command = [PROGRAMS / "massspring", SCENES / "own_body.toml", "--quiet", "--out", tmp_path / "run"]
    subprocess.run([*command, *(word for value in values for word in ("--set", value))], check=True)
    run = load_run(tmp_path / "run")
    surface = file_surface(run)
    np.testing.assert_array_equal(surface.points, points)
    np.testing.assert_array_equal(surface.vertices, [*range(8), 7])
    of_faces = [sorted(set(np.ravel(pair))) for pair in surface.triangles.reshape(6, 2, 3)]
    assert of_faces == [sorted(face) for face in faces]
    np.testing.assert_allclose(
        surface.to_body[:3, :3], 1e-3 * np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), atol=1e-15
    )
    up = np.array([[0, 0, 0.001]])
    np.testing.assert_allclose(
        surface.displacement(np.repeat(up, len(run.last.X), axis=0))[0], [0, -1, 0], atol=1e-9
    )
