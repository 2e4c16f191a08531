"""Verdicts on the paper's claims, and figure 11 as published, from runs whose answer is known."""

import tomllib

import numpy as np
import pytest
from synthetic import write_run

from analysis.paths import SCENES
from analysis.runs import load_frames, load_run
from analysis.studies import claims, paper, published


def test_medians_decide_what_rises():
    assert claims.is_rising([[1, 9, 1], [2, 2, 0], [3]])
    assert not claims.is_rising([[1], [1]])
    assert not claims.is_rising([[1], []])


def test_range_has_two_digits_and_one_end_where_both_agree():
    assert claims.span([1.234, 5.678], " %") == "1.2 to 5.7 %"
    assert claims.span([2, 2.001]) == "2"
    assert claims.span([]) == "no run was solved"


def test_roughness_of_a_ball_is_one(ball, tmp_path):
    write_run(tmp_path / "run", *ball, lambda X: 0 * X, np.linspace(0, 1, 2), calibration="uniform")
    run = load_run(tmp_path / "run")
    run.curves["volume"][-1], run.curves["area"][-1] = 4 / 3 * np.pi * 8, 4 * np.pi * 4
    assert claims.roughness(run) == pytest.approx(1)


def test_depletion_of_a_second_is_that_of_the_steps_in_it():
    for name in paper.FIGURE_11:
        scene = SCENES / f"{name}.toml"
        own = tomllib.loads(scene.read_text())
        step = own["time"]["step"]
        for part in (1, 0.5):
            words = dict(w.split("=") for w in published.overrides_of(scene, "implicit_euler", part))
            assert words["paper"] == "true"
            assert float(words["time.step"]) == pytest.approx(step * part)
            if "collapse" in own:
                left = (1 - float(words["collapse.coefficient"])) ** (1 / step)
                assert left == pytest.approx(1 - own["collapse"]["coefficient"], rel=1e-6)


def test_frames_count_until_the_body_is_far_away(ball, tmp_path):
    """Moved by 0, 1.03, 2.07 and 3.1 of its diagonals; two are far."""
    size = np.linalg.norm(np.ptp(ball[0], axis=0))
    times = np.linspace(0, 1, 4)
    write_run(tmp_path / "run", *ball, lambda X: 0 * X + [3.1 * size, 0, 0], times, calibration="uniform")
    run = published.sound_part(load_frames(tmp_path / "run"))
    assert list(run.times) == pytest.approx(times[: len(run.times)])
    assert len(run.times) == len(run.curves["time"]) == 2
