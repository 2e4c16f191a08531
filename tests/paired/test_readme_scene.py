"""The scene that the README shows, as it stands there: what it says of it is what both programs find."""

import re

import pytest
from programs import ended, words_of

from analysis.comparison import compare
from analysis.experiment import run_solvers
from analysis.paths import ROOT

SCENE = re.search(r"```toml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]


def test_the_scene_bends_a_bar_by_a_thousandth_of_its_length(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    experiment = run_solvers(tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True)
    comparison = compare(experiment).as_json()
    assert comparison["status"] == "ok" and not experiment.notes
    reference = comparison["reference"]
    # Timoshenko's cantilever under its own weight.
    length, height, E, nu, weight = 0.4, 0.1, 1e8, experiment.scene["material"]["nu"], 9.81 * 1000
    shear = E / (2 * (1 + nu)) * 10 * (1 + nu) / (12 + 11 * nu)
    sag = weight * length**4 * 1.5 / (E * height**2) + weight * length**2 / (2 * shear)
    assert reference["largest_displacement"] == pytest.approx(sag, rel=0.03)
    assert sag == pytest.approx(1e-3 * length, rel=0.1)
    assert 1e-4 < reference["largest_strain"] < 1e-2
    assert comparison["displacement_error_l2"] < 0.05


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
@pytest.mark.parametrize(
    "wrong, words",
    [
        (SCENE.replace("-9.81", "0"), "scene.toml:1: nothing moves the body, expected gravity"),
        (re.sub("gravity.*", "", SCENE), "scene.toml:8: nothing moves the body, expected gravity"),
        (
            re.sub("(shape|size).*", "", SCENE),
            "scene.toml:4: surface.file and surface.shape are both missing",
        ),
        (SCENE.replace("1e8", "-1"), "scene.toml:2: material.E = -1, expected from 1e-9 to 1e20"),
        (SCENE.replace("material.E", "material.e"), "scene.toml:2: material.e = 1e+08: unknown key"),
        (
            SCENE.replace("low = [0, 0, 0], high = [0,", "low = [2, 0, 0], high = [2,"),
            "scene.toml:9: supports.0.region: no node",
        ),
        (SCENE.replace("[0, -9.81", "[0, -9,81"), "scene.toml:1: gravity"),
    ],
)
def test_what_is_wrong_in_it_is_refused_with_file_and_line(wrong, words, program, tmp_path):
    done = ended(words_of(tmp_path, program, wrong))
    assert done.returncode == 1 and words in done.stderr
    assert not (tmp_path / "out" / "run.json").exists()
