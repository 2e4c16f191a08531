"""A collapse in time: elements and coupled springs solve one problem."""

import subprocess
from pathlib import Path

import pytest

from analysis.compare import displacement_error, volume
from analysis.paths import PROGRAMS
from analysis.runs import load_run

SCENE = Path(__file__).with_name("ball_collapses_in_motion.toml")


# A guard against drift, and no more: errors as measured, to quadratic elements, with room of a half. Where the surface
# keeps its lengths, shrinkage changes over one element.
@pytest.mark.parametrize(
    "surface, volume_left, springs, linear", [("true", 0.345, 0.013, 0.007), ("false", 0.588, 0.046, 0.040)]
)
def test_ball_collapses_alike_in_both_programs(surface, volume_left, springs, linear, tmp_path):
    def run(program: str, degree: int):
        out = tmp_path / f"{program}_{degree}"
        words = [f"collapse.surface={surface}", f"reference.degree={degree}"]
        command = [PROGRAMS / program, SCENE, "--quiet", "--out", out]
        subprocess.run([*command, *(part for word in words for part in ("--set", word))], check=True)
        return load_run(out)

    quadratic = run("fem_reference", 2).last
    left = volume(quadratic.X + quadratic.u, quadratic.F) / volume(quadratic.X, quadratic.F)
    assert left == pytest.approx(volume_left, rel=0.02)
    for found, error in ((run("massspring", 2), springs), (run("fem_reference", 1), linear)):
        u = found.last.u[: len(quadratic.X)]
        assert displacement_error(quadratic.X, quadratic.F, u, quadratic.u, is_free=True).l2 < 1.5 * error
