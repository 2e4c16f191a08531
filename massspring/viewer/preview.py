"""A scene that is stepped in real time while its window changes it.

    python -m massspring.viewer.preview SCENE.toml [--set KEY=VALUE]...

The program `preview` steps; this draws, and sends it what keys and sliders say.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from PIL import Image
from vtkmodules.vtkCommonDataModel import vtkPlane

from analysis.compare import volume
from analysis.drawing.obstacles import Obstacles
from analysis.drawing.pictures import LOOK, aim, skin_of
from analysis.drawing.replay import LEGEND, entitle, stretch
from analysis.drawing.window import Window, check_display
from analysis.paths import PROGRAMS
from analysis.runs import Array, RunError, built
from analysis.scene import toml_of
from massspring.viewer.engine import Body, Engine, Moment
from massspring.viewer.hand import Hand
from massspring.viewer.inside import Inside

_WIDTHS = [900, 450]  # pixels of the body's panel and of that of sliders
_KEPT = 2000  # points of a curve
_RATED = 2.0  # s, over which rates are counted
_LATE = 0.5  # s: a step that takes longer is told of
_ROOM = (0.5, 0.5)  # of the panel, left to the body at rest
_BRIGHT = 95  # per cent of nodes whose colours are told apart
_ROUNDING = 1e-10  # of strains
_FILMED = 0.5  # size of a film's pictures, over the window's
_LONGEST = 1000  # pictures of a film: 0.8 GB
_LEGEND = "body"  # its key
_LAWS = ["neo_hookean", "small_strain"]
_PARTS = ("springs", "patches", "nodes")
_KEYS = """\
drag the body: pull it; beside it: turn it
g: hold what is pulled, or let go of all
1, 2, 3: springs, patches, inner nodes
x: cutting plane across z, x, y, none
space: run     Right: a step     r: reset
f, d: faster, slower     c: colour
i: integrator     o: floor
m: model     l: law, both from rest
s: save session     p: picture     v: film
q: close"""


@dataclass(frozen=True)
class Slider:
    """A value of the scene: key, label, range and where it begins; is_log: the slider moves its power of ten."""

    key: str
    label: str
    low: float
    high: float
    value: float
    is_log: bool = False


def sliders_of(scene: dict[str, Any], step: float) -> list[Slider]:
    """What can change on the way, of a scene with every default filled in; step: of time (s), 0 in statics."""
    E, nu, gravity = scene["material"]["E"], scene["material"]["nu"], scene.get("gravity", [0, 0, 0])[1]
    strongest = max(20, 2 * abs(gravity))
    found = [
        Slider("material.E", "E (Pa)", E / 100, 100 * E, E, is_log=True),
        Slider("material.nu", "nu", 0.0, max(0.49, nu), nu),
        Slider("gravity", "gravity up (m/s2)", -strongest, strongest, gravity),
    ]
    for number, load in enumerate(scene.get("loads", [])):
        if pressure := load.get("pressure"):
            size = 3 * abs(pressure)
            found.append(Slider(f"loads.{number}.pressure", "pressure (Pa)", -size, size, pressure))
    if step > 0:
        found.append(Slider("time.step", "step (s)", step / 100, 10 * step, step, is_log=True))
    if scene.get("collapse", {}).get("pivots"):
        coefficient = scene["collapse"]["coefficient"]
        found.append(Slider("collapse.coefficient", "collapse", 0, 0.99, coefficient))
    return found


class Rates:
    """Steps and seconds of the scene for each second of the wall."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, int, float]] = deque()

    def add(self, now: float, n_steps: int, scene_time: float) -> tuple[float, float]:
        """now: s of the wall. What went back in time begins anew."""
        if self._kept and n_steps < self._kept[-1][1]:
            self._kept.clear()
        self._kept.append((now, n_steps, scene_time))
        while now - self._kept[0][0] > _RATED:
            self._kept.popleft()
        first, passed = self._kept[0], now - self._kept[0][0]
        return ((n_steps - first[1]) / passed, (scene_time - first[2]) / passed) if passed > 0 else (0.0, 0.0)


def strain_of_springs(X: Array, E: Array, x: Array) -> Array:
    """At nodes (n,): the largest |l/L - 1| of their springs E (k, 2), of lengths L at X and l at x (n, 3)."""
    lengths, now = (np.linalg.norm(np.diff(points[E], axis=1)[:, 0], axis=1) for points in (X, x))
    values = np.zeros(len(X))
    np.maximum.at(values, E.ravel(), np.repeat(np.abs(now / lengths - 1), 2))
    return values


def _floor_below(X: Array) -> dict[str, Any]:
    """Below nodes X (n, 3), in m."""
    low, high = X.min(axis=0), X.max(axis=0)
    below = (low + high) / 2
    below[1] = low[1] - 0.5 * float(np.max(high - low))
    return {"plane": {"point": [float(x) for x in below], "normal": [0.0, 1.0, 0.0]}}


def write_film(file: Path, pictures: list[Image.Image], seconds: float) -> None:
    """A film (.webp) that shows each picture for so long."""
    first, *others = pictures
    duration = round(1000 * seconds)
    first.save(file, save_all=True, append_images=others, duration=duration, loop=0, quality=75, method=4)


class Preview:
    """The window of a scene."""

    def __init__(self, file: Path, overrides: list[str]) -> None:
        self.engine = Engine(file, overrides)
        listed = json.loads(subprocess.check_output([built(PROGRAMS, "massspring"), "--list"]))
        self.models, self.schemes = ([one["name"] for one in listed[of]] for of in ("models", "schemes"))
        self.colours = ["displacement (m)", "speed (m/s)", "strain (%)"]
        self.speed = 1.0
        self.note = self.told = ""  # what was told last, and what by the engine
        self.hand: Hand
        self.plane, self.axes, self.share = vtkPlane(), deque([None, 2, 0, 1]), 0.5
        self.film: list[Image.Image] | None = None
        self.floors = [_floor_below(self.engine.latest.body.X)]
        keys = {
            "space": self.toggle, "Right": lambda: self.say("step"), "r": lambda: self.say("reset"),
            "f": lambda: self.set_speed(2), "d": lambda: self.set_speed(0.5), "c": self.next_colour, "x": self.next_cut,
            "g": lambda: self.hand.toggle_holding(), "i": self.next_integrator, "o": self.toggle_floor,
            "m": self.next_model, "l": self.next_law,
            "s": lambda: self.say(f"save {Path('preview.toml').resolve()}"), "p": self.save_picture, "v": self.toggle_film,
        } | {str(n): functools.partial(self.toggle_part, part) for n, part in enumerate(_PARTS, 1)}  # fmt: skip
        n_drawing = max(1, (os.cpu_count() or 1) - 1)  # threads: a core is left to steps
        os.environ.setdefault("LP_NUM_THREADS", str(n_drawing))  # Mesa's
        self.window = Window("preview", _WIDTHS, keys, is_linked=False, shrinks=True)
        plotter = self.window.plotter
        plotter.subplot(1, 0)
        self.text = self.window.add_text(0.98)
        x_label = "load factor" if self.engine.latest.body.is_static else "time (s)"
        self.charts = {
            title: pv.Chart2D(x_label=x_label, y_label=title)
            for title in ("volume (%)", "tip (m)", "energy (J)")
        }
        self.lines = {
            title: chart.line([0], [0], color="#0072B2", width=2) for title, chart in self.charts.items()
        }
        self.window.add_curves(list(self.charts.values()))
        self._begin(self.engine.latest.body)
        self._add_sliders()

    @property
    def scene(self) -> dict[str, Any]:
        return self.engine.scene

    def _begin(self, body: Body) -> None:
        """Draws the engine's body, in place of another one's."""
        self.body, plotter = body, self.window.plotter
        plotter.subplot(0, 0)
        plotter.renderer.clear_actors()
        if _LEGEND in plotter.scalar_bars:
            plotter.remove_scalar_bar(_LEGEND, render=False)
        X = body.X[: body.n_surface]
        self.skin = skin_of(X, body.F)
        self.skin.mesh["value"] = np.zeros(self.skin.mesh.n_points)
        self.largest = dict.fromkeys(self.colours, 0.0)
        self.actor = plotter.add_mesh(
            self.skin.mesh,
            scalars="value",
            cmap="viridis",
            scalar_bar_args={"title": _LEGEND} | LEGEND,
            **LOOK,
        )
        self.plane.SetOrigin(*X.mean(axis=0))
        if self.axes[0] is not None:
            self.actor.mapper.AddClippingPlane(self.plane)
        self.inside = Inside(plotter, body, self.plane)
        aim(plotter.camera, X, self.window.panel, _ROOM)
        self.points: deque[tuple[float, ...]] = deque(maxlen=_KEPT)
        self.rates = Rates()
        self.volume_at_rest = volume(X, body.F)
        self.shown: Moment | None = None
        tell = functools.partial(setattr, self, "note")
        self.hand = Hand(self.window, self.engine, body, self.actor, self.set, tell)
        self.window.hold = self.hand
        self.obstacles = Obstacles(plotter, [], X)

    def _add_sliders(self) -> None:
        plotter = self.window.plotter
        plotter.subplot(0, 1)
        self.sliders: dict[str, Any] = {}
        for row, slider in enumerate(sliders_of(self.scene, self.engine.latest.head["step"])):
            ends = [slider.low, slider.high, slider.value]
            low, high, value = np.log10(ends) if slider.is_log else ends
            label = f"log10 of {slider.label}" if slider.is_log else slider.label
            self._add_slider(
                row, slider.key, label, (low, high, value), functools.partial(self.slide, slider), "end"
            )
        self._add_slider(
            len(self.sliders), "cut", "cutting plane", (0, 1, self.share), self.move_cut, "always"
        )
        self.window.add_text(0.31, _KEYS)

    def _add_slider(
        self,
        row: int,
        key: str,
        label: str,
        ends: tuple[float, float, float],
        told: Callable[[float], None],
        when: str,
    ) -> None:
        low, high, value = ends
        height = 0.93 - 0.11 * row
        slider = self.window.plotter.add_slider_widget(
            told, (low, high), value=value, title=label, pointa=(0.08, height), pointb=(0.92, height), color="grey",
            title_height=0.02, title_color="black", slider_width=0.025, tube_width=0.004, interaction_event=when, fmt="%.3g",
        )  # fmt: skip
        look = slider.GetRepresentation()
        look.SetLabelHeight(0.02)
        look.SetEndCapLength(0.004)
        look.SetEndCapWidth(0.015)
        self.sliders[key] = slider

    def slide(self, slider: Slider, moved: float) -> None:
        if slider.key not in self.sliders:  # it is being made: nobody has moved it
            return
        value = 10**moved if slider.is_log else moved
        if slider.key == "gravity":
            x, _, z = self.scene.get("gravity", [0, 0, 0])
            self.set("gravity", f"[{float(x)}, {value}, {float(z)}]")
        else:
            self.set(slider.key, str(float(value)))

    def toggle_part(self, part: str) -> None:
        """Shown where the body is cut, which it is then."""
        if not self.inside.has(part):
            self.note = f"{self.scene['network']['calibration']} has no {part}"
            return
        self.inside.show(part, not self.inside.is_shown(part))
        if self.inside.is_shown(part) and self.axes[0] is None:
            self.next_cut()
        self.shown = None

    def next_cut(self) -> None:
        """Across another axis, or none; then nothing inside is seen."""
        self.axes.rotate(-1)
        self.actor.mapper.RemoveAllClippingPlanes()
        if self.axes[0] is None:
            for part in _PARTS:
                self.inside.show(part, False)
        else:
            self.actor.mapper.AddClippingPlane(self.plane)
        self.shown = None

    def move_cut(self, share: float) -> None:
        self.share = share
        self.shown = None

    def _cut(self, x: Array) -> None:
        if self.axes[0] is None:
            return
        normal = -np.eye(3)[self.axes[0]]
        low, high = x.min(axis=0), x.max(axis=0)
        self.plane.SetNormal(*normal)
        self.plane.SetOrigin(*(low + self.share * (high - low)))

    def say(self, command: str) -> None:
        try:
            self.engine.say(command)
        except (OSError, ValueError):
            self.note = "the program that steps has ended: close the window"

    def set(self, key: str, value: str) -> None:
        """A value on the way; what the engine refuses, it tells."""
        self.say(f"set {key}={value}")

    def toggle(self) -> None:
        self.say("pause" if self.engine.latest.head["is_running"] else "run")

    def set_speed(self, factor: float) -> None:
        self.speed *= factor
        self.say(f"speed {self.speed}")

    def next_colour(self) -> None:
        self.colours.append(self.colours.pop(0))
        self.shown = None

    def next_integrator(self) -> None:
        self.say(f"first {self._following('time.integrator', self.schemes)}")

    def next_model(self) -> None:
        self._begin_with("network.calibration", self.models)

    def next_law(self) -> None:
        self._begin_with("material.law", _LAWS)

    def _begin_with(self, key: str, choices: list[str]) -> None:
        """The next choice of a key that does not refuse the scene, from rest, since it is another body."""
        if self.engine.is_beginning:
            self.note = "wait: another body is being set up"
            return
        self.hand.let_go()
        self.say(f"begin {self._following(key, choices)}")

    def _following(self, key: str, choices: list[str]) -> str:
        """The key, then its choices after that of the scene."""
        part, name = key.split(".")
        now = choices.index(self.scene[part][name])
        return " ".join([key, *choices[now + 1 :], *choices[:now]])

    def toggle_floor(self) -> None:
        """Takes all planes away, or puts them back; other obstacles stay."""
        obstacles = self.scene.get("obstacles", [])
        planes = [obstacle for obstacle in obstacles if "plane" in obstacle]
        others = [obstacle for obstacle in obstacles if "plane" not in obstacle]
        if planes:
            self.floors = planes
        self.set("obstacles", toml_of(others if planes else [*others, *self.floors], "obstacles"))

    def save_picture(self) -> None:
        self._write(Path("preview.png"), self.window.plotter.screenshot)

    def toggle_film(self) -> None:
        """Of all pictures from here on; or writes it, which takes longer than a window may stand still."""
        if self.film is None:
            self.film, self.note = [], "a film is made: v ends it"
            return
        if self.film:
            self.note = "the film is written"
            write = functools.partial(
                write_film, pictures=self.film, seconds=1 / max(self.window.frames_per_second, 1)
            )
            threading.Thread(target=self._write, args=(Path("preview.webp"), write)).start()
        self.film = None

    def _write(self, file: Path, write: Callable[[Path], object]) -> None:
        try:
            write(file)
            self.note = f"saved {file.resolve()}"
        except OSError as error:
            self.note = str(error)

    def picture(self) -> Image.Image:
        """The window as it is, smaller."""
        picture = Image.fromarray(self.window.plotter.screenshot(None, return_img=True))
        return picture.reduce(round(1 / _FILMED))

    def draw(self, _: float) -> None:
        moment = self.engine.latest
        head = moment.head
        if moment.body is not self.body:
            self._begin(moment.body)
        rates = self.rates.add(time.perf_counter(), head["n_steps"], head["time"])
        if moment is not self.shown:
            self._show(moment)
        self._tell(head, *rates)
        if self.film is not None:
            self.film.append(self.picture())
            if len(self.film) == _LONGEST:
                self.toggle_film()

    def _values(self, moment: Moment) -> Array:
        """(n,): what colours all nodes."""
        if self.colours[0] == "displacement (m)":
            return np.linalg.norm(moment.u, axis=1)
        if self.colours[0] == "speed (m/s)":
            return np.linalg.norm(moment.v, axis=1)
        body = moment.body
        x, n = body.X + moment.u, body.n_surface
        values = strain_of_springs(body.X, body.E, x)
        values[:n] = stretch(body.X[:n], body.F, x[:n])
        return np.where(values > _ROUNDING, 100 * values, 0)

    def _show(self, moment: Moment) -> None:
        body, head = moment.body, moment.head
        x = body.X + moment.u
        obstacles = self.scene.get("obstacles", [])
        if [drawn for drawn, _ in self.obstacles.drawn] != obstacles:
            self.window.plotter.subplot(0, 0)
            self.obstacles.remove()
            self.obstacles = Obstacles(self.window.plotter, obstacles, body.X)
        self.obstacles.move(head["time"])
        if self.points and head["time"] < self.points[-1][0]:
            self.points.clear()
            self.largest = dict.fromkeys(self.colours, 0.0)
        colour, values = self.colours[0], self._values(moment)
        self.largest[colour] = max(self.largest[colour], float(np.percentile(values, _BRIGHT)))
        self._cut(x)
        self.skin.move(x[: body.n_surface])
        self.skin.mesh["value"][:] = values[self.skin.ids]
        self.actor.mapper.scalar_range = (0, self.largest[colour] or 1)
        entitle(self.window.plotter.scalar_bars[_LEGEND], colour)
        self.inside.move(x, values, self.largest[colour] or 1)
        self.hand.draw(x, head["time"])
        if not self.points or head["time"] > self.points[-1][0]:
            change = 100 * (head["volume"] / self.volume_at_rest - 1)
            energy = head["kinetic_energy"] + head["elastic_energy"]
            largest = float(np.linalg.norm(moment.u[: body.n_surface], axis=1).max())
            self.points.append((head["time"], change, largest, energy))
            times, *curves = np.array(self.points).T
            for line, curve in zip(self.lines.values(), curves, strict=True):
                line.update(times, curve)
        self.shown = moment

    def _tell(self, head: dict[str, Any], steps: float, factor: float) -> None:
        scene = self.scene
        ended = "ended" if head["status"] == "ok" else head["status"].replace("_", " ")
        state = (
            f"{ended}: r begins again" if head["has_ended"] else "running" if head["is_running"] else "paused"
        )
        if head["busy"] > _LATE:
            state += f", {head['task']} takes {head['busy']:.0f} s so far"
        if self.engine.has_died:
            state = "the program that steps has died: close the window"
        unit, pace = "s", f", {factor:.2g} of real time (at most {self.speed:g})"
        if self.body.is_static:
            unit, pace = "of the load", ""
        if head["message"] != self.told:
            self.told = self.note = head["message"]
        lines = [
            f"{head['time']:.4g} {unit}, {state}; {steps:.0f} steps/s, {self.window.frames_per_second:.0f} frames/s"
            f"{pace}; {scene['network']['calibration']}, {scene['time']['integrator']}",
            "; ".join(filter(None, [head["reason"], self.note])),
        ]
        self.text.input = "\n".join(lines)

    def run(self) -> None:
        """Until the window is closed."""
        self.window.open()
        self.draw(0)
        self.window.fit()
        try:
            self.window.loop(self.draw)
        finally:
            self.engine.end()


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="./testbed preview", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, metavar="SCENE.toml")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
        help="replace a value of the scene; may be repeated",
    )  # fmt: skip
    arguments = parser.parse_args(words)
    try:
        check_display(f"./testbed run {arguments.scene} draws a film")
        Preview(arguments.scene, arguments.overrides).run()
    except RunError as error:
        return 1 if error.is_told else tell(error)
    return 0


def tell(error: RunError) -> int:
    print(f"error: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
