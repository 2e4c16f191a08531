"""Verdicts on the paper's claims, and figure 11 as published, from runs whose answer is known."""

import tomllib

import numpy as np
import pytest
from synthetic import write_run

from analysis.paths import SCENES
from analysis.runs import RunError, load_frames, load_run
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


def test_film_goes_there_and_back_by_every_warp(ball, tmp_path):
    """From the later start to the earlier end; the explosion has shown half of it after an eighth of its time."""
    runs = []
    for number, times in enumerate((np.linspace(0, 1, 5), np.linspace(0.5, 3, 5))):
        write_run(tmp_path / str(number), *ball, lambda X: 0 * X, times, calibration="uniform")
        runs.append(load_frames(tmp_path / str(number)))
    forwards, constant, elastic, explode = np.split(published.there_and_back(*runs), 4)
    assert forwards == pytest.approx(np.linspace(0.5, 1, len(forwards)))
    assert constant == pytest.approx(forwards[::-1])
    for back in (elastic, explode):
        assert (back[0], back[-1]) == (1, 0.5) and (np.diff(back) < 0).all()
    assert (elastic[1] > constant[1]) and (explode[len(explode) // 8 + 1] < 0.75)


def test_far_side_answers_when_it_has_lost_a_tenth_of_its_speed(ball, tmp_path):
    """A ball at 2 m/s stops as a whole at 0.1 s; another goes on, its nodes swinging to the left and right."""
    X, F = ball
    times = np.linspace(0, 0.2, 101)
    side = np.where(np.arange(len(X) + 3) % 2, 0.5, -0.5)
    fields = {
        "stops": (lambda X: 0 * X + [0, 1, 0], lambda time: -2 * min(time, 0.1)),
        "swings": (lambda X: 0 * X + [0, 1, 0] + side[: len(X), None] * [1, 0, 0], lambda time: -2 * time),
    }
    found = {}
    for name, (field, amplitude) in fields.items():
        write_run(tmp_path / name, X, F, field, times, amplitude, calibration="uniform")
        found[name] = claims.answer_and_oscillation(load_run(tmp_path / name))
    assert found["stops"] == pytest.approx((101, 0))
    assert found["swings"] == pytest.approx((np.inf, np.var(side[: len(X)])))


def test_frames_count_until_the_body_is_far_away(ball, tmp_path):
    """Moved by 0, 1.03, 2.07 and 3.1 of its diagonals; two are far."""
    size = np.linalg.norm(np.ptp(ball[0], axis=0))
    times = np.linspace(0, 1, 4)
    write_run(tmp_path / "run", *ball, lambda X: 0 * X + [3.1 * size, 0, 0], times, calibration="uniform")
    run = published.sound_part(load_frames(tmp_path / "run"))
    assert list(run.times) == pytest.approx(times[: len(run.times)])
    assert len(run.times) == len(run.curves["time"]) == 2


def test_claims_of_other_studies_are_read_from_their_tables():
    page = claims.RESULTS.read_text()
    stored = (claims.PACKAGE / "CLAIMS.md").read_text()
    for claim in claims.of_tables(page):
        assert "| " + " | ".join(claim) + " |" in stored
    calm = page.replace("| 180 | 5 | 0 | 0 | 25 | 0 |", "| 205 | 5 | 0 | 0 | 0 | 0 |")
    slow = page.replace("| 6260 (5.14) | 5097 | 543 (0.23) |", "| 6260 (5.14) | 5097 | 12 (0.23) |")
    assert claims.of_tables(calm)[0].verdict == claims.HOLDS
    assert claims.of_tables(slow)[1].verdict == claims.FAILS
    with pytest.raises(RunError, match="no row 'head'"):
        claims.of_tables(page.replace("| head |", "| hat |"))
