"""A body of one's own: at its true size by own_body.toml, and what is said where a scene scales it."""

import subprocess

import pytest
import pyvista as pv

from analysis.comparison import compare
from analysis.experiment import run_solvers
from analysis.paths import PROGRAMS, SCENES
from analysis.report import text_of

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
