"""Time warps, and playback of a run whose every moment is known."""

import numpy as np
import pytest
import pyvista as pv
from PIL import Image
from synthetic import write_run

from analysis.drawing.warp import WARPS, draw_playback, main, playback_times, warp_of
from analysis.runs import RunError, load_run

SHARES = np.linspace(0, 1, 1001)


@pytest.fixture
def run(ball, tmp_path):
    """Shrinks evenly to half its size in 2 s."""
    times = np.linspace(0, 2, 5)
    return load_run(write_run(tmp_path / "run", *ball, lambda X: -0.25 * X, times, calibration="uniform"))


def settings(warp="constant", **more):
    return {"warp": warp, "reversed": True, "seconds": 1, "fps": 8} | more


@pytest.mark.parametrize("name", WARPS)
def test_warps_never_go_back_and_end_where_they_should(name):
    w = warp_of(name)(SHARES)
    assert (np.diff(w) > 0).all()
    assert w[0] == 0 and w[-1] == pytest.approx(1, abs=1e-15)


def test_warps_have_their_characters():
    speed = {name: np.gradient(warp_of(name)(SHARES), SHARES) for name in WARPS}
    np.testing.assert_allclose(speed["constant"], 1, rtol=1e-9)
    assert speed["elastic"][0] < 0.01 and speed["elastic"][-1] < 0.01
    assert speed["elastic"][500] == pytest.approx(1.5, rel=1e-3)
    assert speed["explode"][0] > 5 and speed["explode"][-1] < 0.05
    assert warp_of("explode")(1 / 6) == pytest.approx(1 - np.exp(-1), rel=0.01)


def test_custom_warps_are_points_or_an_expression():
    np.testing.assert_allclose(warp_of("custom", expression="t**3")(SHARES), SHARES**3)
    points = warp_of("custom", points=[[0, 0], [0.5, 0.9], [1, 1]])
    np.testing.assert_allclose(points(np.array([0.25, 0.75])), [0.45, 0.95])
    rests = warp_of("custom", points=[[0, 0], [0.4, 0.5], [0.6, 0.5], [1, 1]])
    np.testing.assert_allclose(rests(np.array([0.4, 0.5, 0.6])), 0.5)


@pytest.mark.parametrize(
    "more, message",
    [
        ({}, "expected either"),
        ({"expression": "1 - t"}, "never goes back"),
        ({"expression": "t / 2"}, "goes from 0 to 0.5"),
        ({"expression": "(t + 1) / 2"}, "goes from 0.5 to 1"),
        ({"points": [[0, 0], [0.5, 0.6], [0.6, 0.5], [1, 1]]}, "never goes back"),
        ({"expression": "open('x')"}, "expected a function of t"),
        ({"expression": "nobody"}, "expected a function of t"),
        ({"expression": "3"}, "expected a number for every t"),
        ({"expression": "9**9**9**9 * t"}, "expected a number for every t"),
        ({"expression": "t.real"}, "expected a function of t"),
        ({"expression": "'a' * 9**9"}, "expected a function of t"),
        ({"expression": "(" * 400 + "t" + ")" * 99}, "expected a function of t"),
        ({"expression": "t" + "+t" * 1000}, "501 letters|2001 letters"),
        ({"expression": "sin(t, t, t, t, t, t)"}, "expected a function of t"),
        ({"expression": "t\0"}, "expected a function of t"),
        ({"expression": "log(t)"}, "expected a number for every t"),
        ({"points": [[0, 0], [1, 1]], "expression": "t"}, "expected either"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_warps_that_are_none_are_refused(more, message):
    with pytest.raises(RunError, match=message):
        warp_of("custom", **more)


def test_unknown_warp_is_refused():
    with pytest.raises(RunError, match="expected one of constant"):
        warp_of("bounce")


def test_reverse_playback_is_the_mirror(run):
    for name in WARPS:
        forwards = playback_times(run, warp_of(name), 9, is_reversed=False)
        backwards = playback_times(run, warp_of(name), 9, is_reversed=True)
        np.testing.assert_allclose(forwards + backwards, 2, atol=1e-14)
    # The constant warp shows the very frames, last first.
    np.testing.assert_array_equal(
        playback_times(run, WARPS["constant"], 5, is_reversed=True), run.times[::-1]
    )


def test_playback_is_resampled_to_the_frame_rate(run, tmp_path, ball):
    times = draw_playback(tmp_path / "playback", run, settings("elastic"))
    reader = pv.get_reader(tmp_path / "playback" / "frames.pvd")
    np.testing.assert_allclose(reader.time_values, np.arange(9) / 8)
    for number, time in enumerate(times):
        reader.set_active_time_value(reader.time_values[number])
        surface = reader.read()[0]
        np.testing.assert_allclose(surface.points, (1 - 0.25 * time) * ball[0], atol=1e-12)
        np.testing.assert_allclose(surface["displacement"], -0.25 * time * ball[0], atol=1e-12)
    film = Image.open(tmp_path / "playback" / "film.gif")
    assert film.n_frames == 9
    assert film.info["duration"] == pytest.approx(1000 / 8, abs=20)  # ms a frame
    # A second playback leaves nothing of the longer one before.
    draw_playback(tmp_path / "playback", run, settings(fps=4))
    assert len(list(tmp_path.glob("playback/frames/*.vtp"))) == 5


def radii(run):
    """Of the ball, frame by frame of its playback."""
    reader = pv.get_reader(run.folder / "playback" / "frames.pvd")
    found = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        found.append(np.linalg.norm(reader.read()[0].points, axis=1).mean())
    return np.array(found)


def test_playback_takes_the_points_of_a_custom_warp(run):
    draw_playback(
        run.folder / "playback", run, settings("custom", points=[[0, 0], [0.5, 0.2], [1, 1]], fps=2)
    )
    np.testing.assert_allclose(radii(run), [0.5, 0.6, 1], atol=1e-12)


def test_command_plays_a_run(run, capsys):
    words = [str(run.folder), "t**2", "--fps", "4", "--seconds", "1"]
    shrunk = 0.5 * (np.arange(5) / 4) ** 2
    assert main(words) == 0
    assert (run.folder / "playback" / "film.gif").exists()
    np.testing.assert_allclose(radii(run), 0.5 + shrunk, atol=1e-12)
    assert main([*words, "--forwards"]) == 0
    np.testing.assert_allclose(radii(run), 1 - shrunk, atol=1e-12)
    assert main([str(run.folder), "t -"]) == 1
    assert "expected a function of t" in capsys.readouterr().err
