"""Replay of runs known in closed form, at last in a window on a virtual screen."""

import subprocess
import sys

import numpy as np
import pytest
from screen import screen
from synthetic import write_run

from analysis.__main__ import parse_arguments
from analysis.drawing.replay import Player, fields_of, in_time, other_than, replay_of, stretch
from analysis.paths import ROOT
from analysis.runs import RunError, load_run
from analysis.time_warp import WARPS

ROUNDING = 1e-12
TIMES = np.array([0, 0.5, 1.5, 2])


def test_stretch_is_that_of_an_affine_map(ball):
    """In a triangle's plane: of a map A the singular values of A Q, Q two orthonormal vectors of the plane."""
    X, F = ball
    A = np.array([[1.2, 0.3, 0], [-0.1, 0.8, 0.2], [0, 0.1, 1.1]])
    expected = np.zeros(len(X))
    for triangle in F:
        a, b, c = X[triangle]
        Q, _ = np.linalg.qr(np.column_stack([b - a, c - a]))
        strain = np.abs(np.linalg.svd(A @ Q, compute_uv=False) - 1).max()
        expected[triangle] = np.maximum(expected[triangle], strain)
    np.testing.assert_allclose(stretch(X, F, X @ A.T), expected, rtol=1e-9)


def test_turning_strains_nothing(ball):
    X, F = ball
    turned = X @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]).T + 3
    np.testing.assert_allclose(stretch(X, F, turned), 0, atol=1e-12)


def test_values_between_frames_are_linear():
    values = np.array([[0.0, 1], [2, 1], [4, 5], [4, 7]])
    at = np.array([-1, 0.25, 1, 2, 3])
    expected = [[0, 1], [1, 1], [3, 3], [4, 7], [4, 7]]
    np.testing.assert_allclose(in_time(values, TIMES, at), expected, atol=ROUNDING)


@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("is_reversed", [False, True])
def test_a_film_shows_the_warps_share_of_the_simulation(warp, is_reversed):
    player = Player(TIMES, 4, warp, is_reversed)
    for _ in range(10):
        player.advance(0.1)
    share = WARPS[warp](np.array([0.25]))[0]
    assert player.time == pytest.approx(2 * (1 - share if is_reversed else share), abs=1e-3)
    player.advance(3.5)
    assert player.time == pytest.approx(0 if is_reversed else 2, abs=1e-12)
    player.advance(0.1)
    assert player.time == (2 if is_reversed else 0)  # begins anew


def test_turned_back_in_the_middle_a_film_goes_on_from_there():
    player = Player(TIMES, 4, "constant", False)
    player.advance(3)
    player.is_reversed = True
    player.advance(1)
    assert player.time == pytest.approx(1)


@pytest.mark.parametrize(
    "time, n, expected",
    [
        (0, 1, 0.5),
        (0.6, 1, 1.5),
        (0.6, -1, 0.5),
        (0.5, -1, 0),
        (0, -1, 0),
        (2, 1, 2),
        (1.5, 1, 2),
        (2, -1, 1.5),
    ],
)
def test_a_step_ends_at_a_frame(time, n, expected):
    player = Player(TIMES, 4, "elastic", False)
    player.time = time
    player.step(n)
    assert player.time == pytest.approx(expected, abs=ROUNDING) and not player.is_playing


@pytest.fixture
def runs(ball, tmp_path):
    """A ball grows by a tenth a second, another by a fifth."""
    for name, rate in (("slow", 0.1), ("fast", 0.2)):
        write_run(tmp_path / name, *ball, lambda X, rate=rate: rate * X, TIMES, calibration="uniform")
    (tmp_path / "slow" / "scene.toml").write_text(
        "[[obstacles]]\nsphere = { center = [3, 0, 0], radius = 0.2 }\nmotion = [[0, 0, 0, 0], [2, 1, 0, 0]]\n"
    )
    return tmp_path / "slow", tmp_path / "fast"


def test_fields_are_those_of_the_motion(runs, ball):
    slow, fast = map(load_run, runs)
    u = np.array([slow.frame(k).u for k in range(len(TIMES))])
    fields = fields_of(slow, u, fast)
    ones = np.ones(len(ball[0]))
    for name, factor in (("displacement (m)", 0.1), ("strain (%)", 10), ("difference (m)", 0.1)):
        np.testing.assert_allclose(fields[name], np.outer(factor * TIMES, ones), atol=1e-5, err_msg=name)
    np.testing.assert_allclose(fields["speed (m/s)"], 0.1, rtol=1e-6)


def test_a_run_differs_from_the_reference_or_else_from_the_first(runs, tmp_path, ball):
    slow, fast = map(load_run, runs)
    assert other_than(slow, [slow, fast]) is fast and other_than(fast, [slow, fast]) is slow
    assert other_than(slow, [slow]) is None
    reference = load_run(write_run(tmp_path / "reference", *ball, lambda X: X, TIMES))
    every = [slow, fast, reference]
    assert [other_than(run, every) for run in every] == [reference, reference, slow]


def test_another_body_has_no_difference(runs, tmp_path, ball):
    X, F = ball
    other = load_run(write_run(tmp_path / "other", X * [1, 2, 1], F, lambda X: X, TIMES))
    slow = load_run(runs[0])
    u = np.array([slow.frame(k).u for k in range(len(TIMES))])
    assert "difference (m)" not in fields_of(slow, u, other)


def test_without_a_display_a_film_is_offered(runs, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(RunError, match=r"no display: .* ./testbed export .*slow --format film draws a film"):
        replay_of(parse_arguments(["view", *map(str, runs)]))


SESSION = """
import sys
import numpy as np
from analysis.__main__ import parse_arguments
from analysis.drawing.replay import replay_of

replay = replay_of(parse_arguments(["view", *sys.argv[1:]]))
window, player = replay.window, replay.player
window.open()
assert window.plotter.render_window.GetClassName() == "vtkXOpenGLRenderWindow"

def press(key):
    interactor = window.plotter.iren.interactor
    interactor.SetKeySym(key)
    interactor.InvokeEvent("KeyPressEvent")

def picture():
    replay.draw(0)
    window.plotter.render()
    return window.plotter.screenshot(None, return_img=True).astype(int)

def width(picture):  # pixels of the second body, which is not grey
    panel = picture[: picture.shape[0] // 2, picture.shape[1] // 2 : picture.shape[1] * 92 // 100]
    return (np.ptp(panel, axis=2) > 20).any(axis=0).sum()

press("space")
assert not player.is_playing
small = picture()
for _ in range(3):
    press("Right")
large = picture()
assert player.time == 2
assert abs(width(large) / width(small) - 1.4) < 0.03, (width(large), width(small))  # one view for all times
for colour in ("strain (%)", "speed (m/s)", "difference (m)", "displacement (m)"):
    press("c")
    assert replay.colour == colour
press("b")
press("w")
assert player.is_reversed and player.warp == "elastic"
press("space")
replay.draw(2.0)
assert abs(player.time - 1) < 1e-3
replay.slider.GetRepresentation().SetValue(0.5)
replay.slider.InvokeEvent("InteractionEvent")
assert player.time == 0.5 and not player.is_playing
replay.draw(0)
assert [[actor.position[0] for _, actor in obstacles.drawn] for obstacles in replay.obstacles] == [[0.25], []]
pictures = iter(range(3))
def draw(seconds):
    replay.draw(seconds)
    if next(pictures, None) is None:
        press("q")
window.loop(draw)
print("closed")
"""


def test_a_window_obeys_its_keys_and_ends(runs):
    with screen() as environment:
        words = [sys.executable, "-c", SESSION, *map(str, runs)]
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "closed\n"), done.stderr


THREE = """
import sys
import numpy as np
from analysis.__main__ import parse_arguments
from analysis.drawing.replay import replay_of

replay = replay_of(parse_arguments(["view", *sys.argv[1:]]))
window = replay.window
window.open()
replay.draw(0)
window.plotter.render()
picture = window.plotter.screenshot(None, return_img=True).astype(int)
for edge in (500, 1000, 1500):
    assert (picture[:590, edge - 2 : edge] > 200).all(), "the legend's title is cut"
lines = [line for line, *_ in replay.curves[:3]]
assert len({(line.color.hex_rgb, line.line_style) for line in lines}) == 3
replay.colour = "speed (m/s)"
replay.next_colour()
assert replay.colour == "difference (m)"
assert [bool(actor.mapper.scalar_visibility) for actor in replay.actors.values()] == [True, True, False]
assert [bool(window.plotter.scalar_bars[name].GetVisibility()) for name in replay.bodies] == [True, True, False]
window.close()
window.loop(replay.draw)
print("closed")
"""


def test_three_runs_by_one_method_are_told_apart_and_another_body_is_plain(runs, tmp_path, ball):
    X, F = ball
    other = write_run(tmp_path / "other", X * [1, 2, 1], F, lambda X: X, TIMES, calibration="uniform")
    with screen() as environment:
        words = [sys.executable, "-c", THREE, *map(str, [*runs, other])]
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "closed\n"), done.stderr
