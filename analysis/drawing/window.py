"""A window on the screen: keys, a loop that ends with the window, and what to do where there is no screen."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import pyvista as pv

from ..runs import RunError
from .pictures import light

_FRAME = 1 / 30  # s, at least, from one picture to the next
_CURVES = 0.78  # of the height of their panel, below text and slider
_SMOOTHED = 0.9  # share of the former rate in the one that is shown


def check_display(instead: str) -> None:
    """Raises RunError, which says what to do instead, where no window can be opened."""
    if not os.environ.get("DISPLAY"):
        raise RunError(f"no display: start this in a desktop session or by ssh -X; without one, {instead}")


class Window:
    """A lit pyvista window of panels in a row, above one for curves; is_linked: all seen from one place.

    keys: as VTK names them -> what each does; the window has no other keys but q, which closes it.
    """

    def __init__(
        self, title: str, n_panels: int, keys: dict[str, Callable[[], None]], is_linked: bool = True
    ) -> None:
        self.panel = (min(700, 1500 // n_panels), 600)  #: pixels of a body's, at first
        self.plotter = pv.Plotter(
            shape=(2, n_panels), row_weights=[3, 1], groups=[(1, slice(None))], border=False, lighting="none",
            window_size=[n_panels * self.panel[0], self.panel[1] * 4 // 3], title=title, off_screen=False,
        )  # fmt: skip
        self.plotter.set_background("white", all_renderers=True)
        self._linked = list(range(n_panels)) if is_linked else []
        for panel in range(n_panels):
            self.plotter.subplot(0, panel)
            light(self.plotter)
        self.is_open = True
        self.frames_per_second = 0.0
        self._keys = keys | {"q": self.close}

    def add_curves(self, charts: list[pv.Chart2D]) -> None:
        """Side by side below the bodies."""
        self.plotter.subplot(1, 0)
        for place, chart in enumerate(charts):
            chart.size, chart.loc = (1 / len(charts), _CURVES), (place / len(charts), 0)
            chart.border_color = chart.background_color = "white"
            self.plotter.add_chart(chart)

    def open(self) -> None:
        if self._linked:
            self.plotter.link_views(self._linked)
        self.plotter.show(interactive_update=True, auto_close=False)
        interactor = self.plotter.iren.interactor
        style = interactor.GetInteractorStyle()
        style.AddObserver("CharEvent", lambda *_: None)  # in place of VTK's own keys
        interactor.AddObserver("KeyPressEvent", self._press, 1.0)
        interactor.AddObserver("ExitEvent", lambda *_: self.close())

    def _press(self, interactor: Any, _: str) -> None:
        key = interactor.GetKeySym()
        action = self._keys.get(key) or self._keys.get(key.lower())
        if action:
            action()

    def close(self) -> None:
        self.is_open = False

    def loop(self, draw: Callable[[float], None]) -> None:
        """Draws with the seconds since the last picture, until the window is closed."""
        last = time.perf_counter()
        while self.is_open:
            self.plotter.iren.process_events()
            now = time.perf_counter()
            if now - last < _FRAME:
                time.sleep(0.2 * _FRAME)
                continue
            draw(now - last)
            rate = 1 / (now - last)
            self.frames_per_second += (1 - _SMOOTHED) * (rate - self.frames_per_second)
            last = now
            if self.is_open:
                self.plotter.render()
        self.plotter.close()
