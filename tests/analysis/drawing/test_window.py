"""A window draws what changes, when it is due, and its screen shows all of it."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from screen import screen

from analysis.drawing import window
from analysis.drawing.obstacles import Obstacles
from analysis.drawing.pictures import aim, stage
from analysis.paths import ROOT


@pytest.mark.parametrize(
    "costs, pictures",
    [([0.025], 90), ([0.015, 0.045], 90), ([0.05], 60), ([0.6] + [0.001] * 9, 42)],
    ids=["quick", "seldom late", "slow", "held up"],
)
def test_pictures_begin_when_they_are_due(costs, pictures, monkeypatch):
    """In 3 s of a clock by which each takes so long (s). What was held up is not made up for by a burst."""
    clock = SimpleNamespace(now=0.0)

    def sleep(seconds):
        clock.now += seconds

    monkeypatch.setattr(window, "time", SimpleNamespace(perf_counter=lambda: clock.now, sleep=sleep))
    begun = []

    def draw(_):
        begun.append(clock.now)
        clock.now += costs[len(begun) % len(costs)]
        watched.is_open = clock.now < 3

    plotter = SimpleNamespace(iren=SimpleNamespace(process_events=lambda: None), close=lambda: None)
    watched = SimpleNamespace(is_open=True, frames_per_second=0.0, plotter=plotter, _render=lambda _: None)
    window.Window.loop(watched, draw)
    assert len(begun) == pytest.approx(pictures, abs=2)


@pytest.mark.parametrize(
    "shape",
    [
        {"sphere": {"center": [0, 0, 0], "radius": 1.0}},
        {"capsule": {"a": [-1, 0, 0], "b": [1, 0, 0], "radius": 0.5}},
        {"box": {"low": [-1, -1, -1], "high": [1, 1, 1]}},
    ],
    ids=lambda shape: next(iter(shape)),
)
def test_an_obstacle_looks_the_same_in_whatever_order_it_is_blended(shape):
    points = np.array([[-2.0, -2, -2], [2, 2, 2]])
    plotter = stage((200, 200), is_smooth=False)
    ((_, actor),) = Obstacles(plotter, [shape], points).drawn
    aim(plotter.camera, points, (200, 200))
    plotter.renderer.SetUseOIT(False)
    first = plotter.screenshot(None, return_img=True).astype(int)
    mesh = actor.mapper.dataset
    mesh.faces = np.concatenate([[len(face), *face] for face in reversed(mesh.irregular_faces)])
    plotter.render()
    then = plotter.screenshot(None, return_img=True).astype(int)
    plotter.close()
    assert first.min() < 200, "it is seen"
    np.testing.assert_allclose(then, first, atol=2)


SESSION = """
import os, time
import numpy as np
import pyvista as pv
from PIL import ImageGrab
from analysis.drawing import window as windows

windows._SELDOM = 1e9
window = windows.Window("bodies", [400, 200], {}, is_linked=False, shrinks=True)
plotter = window.plotter
plotter.subplot(0, 0)
plotter.add_mesh(pv.Sphere(), color="red")
plotter.subplot(0, 1)
words = window.add_text(0.9, "words")
window.add_curves([pv.Chart2D()])
window.open()
timed = []
for of_frame, size in ((0.2, (450, 600)), (100, (360, 480)), (None, (390, 520))):
    def seconds():  # as many pixels take, or much too long
        timed.append(plotter.window_size[0])
        return windows._FRAME * windows._SPENT * (of_frame or (plotter.window_size[0] / 390) ** 2)

    window._seconds = seconds
    plotter.window_size = (600, 800)
    window.fit()
    assert tuple(plotter.window_size) == size, f"{plotter.window_size} of 600 x 800 without a graphics card"
assert timed == [450, 450, 450, 360, 450, 390]
assert words.prop.font_size < 14, "as the window"
del window._seconds
assert 0 < window._seconds() < 1
plotter.window_size = (450, 600)
interactor = plotter.iren.interactor
drawn = [0, 0, 0]

def count(panel):
    def drew(*_):
        drawn[panel] += 1
    return drew

for number, panel in enumerate(plotter.renderers):
    assert panel.GetLights().GetNumberOfItems() == 3
    panel.AddObserver("EndEvent", count(number))
pictures = 0

def draw(_):
    global pictures
    if pictures == 0:
        interactor.SetEventPosition(100, 400)
    if pictures == 10:
        assert drawn == [10, 1, 1], drawn
        camera = np.array(plotter.renderers[0].camera.position)
        interactor.InvokeEvent("LeftButtonPressEvent")
        for x in range(100, 140):
            interactor.SetEventPosition(x, 400)
            interactor.InvokeEvent("MouseMoveEvent")
        interactor.InvokeEvent("LeftButtonReleaseEvent")
        assert drawn[0] == 10 and (plotter.renderers[0].camera.position != camera).any()
        interactor.SetEventPosition(400, 400)
    if pictures == 15:
        assert drawn == [15, 6, 1], drawn
        interactor.SetEventPosition(100, 400)
        plotter.window_size = (450, 500)
        drawn[:] = 0, 0, 0
    if pictures == 20:
        assert drawn == [5, 1, 1], drawn
        width, height = plotter.window_size
        time.sleep(0.5)  # for the screen
        seen = np.array(ImageGrab.grab(xdisplay=os.environ["DISPLAY"]))[:height, :width]
        np.testing.assert_array_equal(seen, plotter.screenshot(None, return_img=True))
        assert (np.ptp(seen.astype(int), axis=2) > 100).any() and (seen[:, 300:] < 50).all(axis=2).any()
        window.close()
    pictures += 1

window.loop(draw)
print("closed")
"""


def test_panels_without_a_body_are_drawn_seldom_and_where_the_mouse_is():
    with screen() as environment:
        words = [sys.executable, "-c", SESSION]
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "closed\n"), done.stderr
