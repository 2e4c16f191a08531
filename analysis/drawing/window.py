"""A window on the screen: keys, a loop that ends with the window, and what to do where there is no screen."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import pyvista as pv

from ..runs import Array, RunError
from .pictures import light

_FRAME = 1 / 30  # s, at least, from one picture to the next
_SELDOM = 1 / 5  # s, about, between pictures of a panel without a body
_HEIGHT = 600  # pixels of a panel, at first
# Of each side of a window that shrinks, at least and at most: without a graphics card pixels decide how long a picture takes.
_SMALLER = (0.6, 0.75)
_SPENT = 0.6  # of the time from one picture to the next, on drawing
_TIMED = 5  # pictures
_LEGIBLE = 10  # pixels of a letter
_CURVES = 0.78  # of the height of their panel, below text and slider
_SMOOTHED = 0.9  # share of the former rate in the one that is shown


def check_display(instead: str) -> None:
    """Raises RunError, which says what to do instead, where no window can be opened."""
    if not os.environ.get("DISPLAY"):
        raise RunError(f"no display: start this in a desktop session or by ssh -X; without one, {instead}")


class Hold(Protocol):
    """What the left button does in the first panel."""

    def take(self, x: int, y: int) -> Array | None:
        """The point (m) that is taken hold of at a pixel; None: the camera turns."""

    def drag(self, point: Array) -> None:
        """To another point of the plane of view."""

    def drop(self) -> None: ...


class Window:
    """A lit pyvista window of panels in a row, above one for curves; is_linked: all seen from one place.

    widths: of the panels, in pixels at first, fewer in a window that shrinks without a graphics card; keys: as VTK names them
    -> what each does; the window has no other keys but q, which closes it.
    """

    def __init__(
        self,
        title: str,
        widths: list[int],
        keys: dict[str, Callable[[], None]],
        is_linked: bool = True,
        shrinks: bool = False,
    ) -> None:
        self.panel = (widths[0], _HEIGHT)  #: pixels of the first, at first
        self.plotter = pv.Plotter(
            shape=(2, len(widths)), row_weights=[3, 1], col_weights=widths, groups=[(1, slice(None))], border=False,
            lighting="none", window_size=[sum(widths), _HEIGHT * 4 // 3], title=title,
        )  # fmt: skip
        self.plotter.set_background("white", all_renderers=True)
        self._shrinks = shrinks
        self._linked = list(range(len(widths))) if is_linked else []
        light(self.plotter)  # all panels
        self.is_open = True
        self.frames_per_second = 0.0
        self._keys = keys | {"q": self.close}
        self.hold: Hold | None = None
        self._texts: list[pv.Text] = []
        self._depth: float | None = None  # of what is held
        self._tags: dict[str, int] = {}  # of observers
        self._drawn = ((0, 0), 0.0)  # size (pixels) and time (s) of the last picture of all panels

    def add_curves(self, charts: list[pv.Chart2D]) -> None:
        """Side by side below the bodies."""
        self.plotter.subplot(1, 0)
        for place, chart in enumerate(charts):
            chart.size, chart.loc = (1 / len(charts), _CURVES), (place / len(charts), 0)
            chart.border_color = chart.background_color = "white"
            self.plotter.add_chart(chart)

    def add_text(self, height: float, text: str = "") -> pv.Text:
        """Of a size that only fit() changes in the plotter's present panel, from that share of its height downwards."""
        written = self.plotter.add_text(
            text, position=(0.005, height), viewport=True, font_size=7, color="black"
        )
        written.prop.justification_vertical = "top"
        self._texts.append(written)
        return written

    def _is_soft(self) -> bool:
        """Without a graphics card Mesa draws."""
        return "llvmpipe" in self.plotter.render_window.ReportCapabilities()

    def open(self) -> None:
        if self._linked:
            self.plotter.link_views(self._linked)
        for renderer in self.plotter.renderers:
            renderer.SetUseOIT(False)  # passes over all pixels, for layers that obstacles do not have
        self.plotter.show(interactive_update=True, auto_close=False)
        if self._is_soft():
            self.plotter.render_window.SetMultiSamples(0)  # smooth edges take a processor three times as long
            self.plotter.render_window.SetFrameBlitModeToBlitToCurrent()  # colours: nothing reads a window's depths
        interactor = self.plotter.iren.interactor
        interactor.EnableRenderOff()  # the loop draws, not each move of the mouse
        style = interactor.GetInteractorStyle()
        style.AddObserver("CharEvent", lambda *_: None)  # in place of VTK's own keys
        self.plotter.iren.clear_key_event_callbacks()  # and of pyvista's
        interactor.AddObserver("KeyPressEvent", self._press, 1.0)
        interactor.AddObserver("ExitEvent", lambda *_: self.close())
        if self.hold:
            for event in ("LeftButtonPressEvent", "MouseMoveEvent", "LeftButtonReleaseEvent"):
                self._tags[event] = interactor.AddObserver(
                    event, self._move_mouse, 1.0
                )  # before the camera's

    def fit(self) -> None:
        """A window that shrinks takes as many pixels as can be drawn for each picture; its bodies are there."""
        if not (self._shrinks and self._is_soft()):
            return
        size, smaller = self.plotter.window_size, _SMALLER[1]
        for _ in range(2):  # time is not all spent on pixels
            self.plotter.window_size = [round(smaller * n) for n in size]
            smaller = float(np.clip(smaller * np.sqrt(_SPENT * _FRAME / self._seconds()), *_SMALLER))
        self.plotter.window_size = [round(smaller * n) for n in size]
        for text in self._texts:
            text.prop.font_size = max(_LEGIBLE, round(smaller * text.prop.font_size))

    def _seconds(self) -> float:
        """Of a picture of the bodies, once the first of all panels, which takes longer, is drawn."""
        self._render(time.perf_counter())
        start = time.perf_counter()
        for _ in range(_TIMED):
            self._render(start)
        return (time.perf_counter() - start) / _TIMED

    def _press(self, interactor: Any, _: str) -> None:
        key = interactor.GetKeySym()
        action = self._keys.get(key) or self._keys.get(key.lower())
        if action:
            action()

    def _move_mouse(self, interactor: Any, event: str) -> None:
        assert self.hold
        x, y = interactor.GetEventPosition()
        if (
            event == "LeftButtonPressEvent"
            and interactor.FindPokedRenderer(x, y) is self.plotter.renderers[0]
        ):
            point = self.hold.take(x, y)
            self._depth = None if point is None else float(self.pixels_of(point)[2])
        if self._depth is None:
            return
        if event == "MouseMoveEvent":
            self.hold.drag(self.point_at(x, y, self._depth))
        elif event == "LeftButtonReleaseEvent":
            self._depth = None
            self.hold.drop()
        interactor.GetCommand(self._tags[event]).SetAbortFlag(1)

    def pixels_of(self, point: Array) -> Array:
        """Where the first panel shows a point (m): x, y and its depth."""
        renderer = self.plotter.renderers[0]
        renderer.SetWorldPoint(*point, 1)
        renderer.WorldToDisplay()
        return np.array(renderer.GetDisplayPoint())

    def point_at(self, x: int, y: int, depth: float) -> Array:
        renderer = self.plotter.renderers[0]
        renderer.SetDisplayPoint(x, y, depth)
        renderer.DisplayToWorld()
        *point, scale = renderer.GetWorldPoint()
        return np.array(point) / scale

    def close(self) -> None:
        self.is_open = False

    def loop(self, draw: Callable[[float], None]) -> None:
        """Draws with the seconds since the last picture, until the window is closed."""
        last = time.perf_counter()
        due = last + _FRAME
        while self.is_open:
            self.plotter.iren.process_events()
            now = time.perf_counter()
            if now < due:
                time.sleep(due - now)
                continue
            draw(now - last)
            rate = 1 / (now - last)
            self.frames_per_second += (1 - _SMOOTHED) * (rate - self.frames_per_second)
            last, due = now, max(due, now - _FRAME) + _FRAME
            if self.is_open:
                self._render(now)
        self.plotter.close()

    def _render(self, now: float) -> None:
        """Bodies always; words, sliders and curves seldom, but at once under the mouse and in a window of another size."""
        size, interactor = self.plotter.render_window.GetSize(), self.plotter.iren.interactor
        is_due = size != self._drawn[0] or now - self._drawn[1] > _SELDOM
        if is_due:
            self._drawn = size, now
        under = interactor.FindPokedRenderer(*interactor.GetEventPosition())
        for panel in self.plotter.renderers:
            panel.SetDraw(is_due or panel is under or panel.GetActors().GetNumberOfItems() > 0)
        self.plotter.render()
