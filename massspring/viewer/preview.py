"""A scene that is stepped in real time while its window changes it.

    python -m massspring.viewer.preview SCENE.toml [--set KEY=VALUE]...

The program `preview` steps; this draws, and sends it what keys and sliders say.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import threading
import time
import tomllib
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkCellPicker

from analysis.compare import volume
from analysis.drawing.pictures import LOOK, aim, skin_of, tiles
from analysis.drawing.replay import stretch
from analysis.drawing.window import Window, check_display
from analysis.paths import PROGRAMS
from analysis.runs import Array, RunError, built
from analysis.scene import toml_of

_ASKED = 1 / 40  # s between two pictures that are asked for
_KEPT = 2000  # points of a curve
_RATED = 2.0  # s, over which rates are counted
_LATE = 0.5  # s: a step that takes longer is told of
_ROOM = (0.5, 0.5)  # of the panel, left to the body at rest
_PULL = 0.02  # stiffness of the spring that pulls a vertex, over E times the body's diagonal
_KEYS = (
    "space: run   Right: a step   r: reset   g: grab or let go   i: integrator   m: model   o: floor   c: colour   "
    "f, d: faster, slower   s: save the session   p: picture   q: close"
)


class Moment(NamedTuple):
    """What the engine tells of a moment: its head, u (n, 3) in m and v (n, 3) in m/s of the surface."""

    head: dict[str, Any]
    u: Array
    v: Array


class Engine:
    """The program that steps, which is spoken to by a thread of its own: no window waits for it.

    X: (n, 3) at rest in m; F: (m, 3) triangles; latest: the last moment that it told of.
    """

    def __init__(self, scene: Path, overrides: list[str]) -> None:
        """Raises RunError where the program refuses the scene, which it has told then."""
        words = [str(built(PROGRAMS, "preview")), str(scene)]
        words += [word for value in overrides for word in ("--set", value)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin and self._process.stdout
        self._in, self._out = self._process.stdin, self._process.stdout
        self._lock = threading.Lock()
        first = self._out.readline()
        if not first:
            raise RunError(f"{scene}: cannot be previewed", is_told=True)
        head = json.loads(first)
        self.is_static: bool = head["is_static"]
        self.X = self._read(head["n_surface"])
        self.F = self._read(head["n_triangles"]).astype(int)
        self.latest = self._ask()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _read(self, n: int) -> Array:
        return np.frombuffer(self._out.read(12 * n), "<f4").reshape(n, 3).astype(float)

    def _ask(self) -> Moment:
        self.say("picture")
        head = json.loads(self._out.readline())
        return Moment(head, self._read(len(self.X)), self._read(len(self.X)))

    def _listen(self) -> None:
        try:
            while True:
                time.sleep(_ASKED)
                self.latest = self._ask()
        except (OSError, ValueError):  # it has ended
            return

    def say(self, command: str) -> None:
        """Raises OSError or ValueError once the program has ended."""
        with self._lock:
            self._in.write(f"{command}\n".encode())
            self._in.flush()

    @property
    def has_died(self) -> bool:
        return self._process.poll() is not None

    def end(self) -> None:
        """Whatever step is under way."""
        with self._lock:
            self._in.close()
        self._process.wait()


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
    E, nu = scene["material"]["E"], scene["material"]["nu"]
    found = [
        Slider("material.E", "E (Pa)", E / 100, 100 * E, E, is_log=True),
        Slider("material.nu", "nu", 0.0, 0.49, nu),
        Slider("gravity", "gravity up (m/s2)", -20, 20, scene.get("gravity", [0, 0, 0])[1]),
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


class Preview:
    """The window of a scene."""

    def __init__(self, file: Path, overrides: list[str]) -> None:
        self.file, self.overrides = file, overrides
        self.engine = Engine(file, overrides)
        listed = json.loads(subprocess.check_output([built(PROGRAMS, "massspring"), "--list"]))
        self.models, self.schemes = ([one["name"] for one in listed[of]] for of in ("models", "schemes"))
        self.colours = ["displacement (m)", "speed (m/s)", "strain (%)"]
        self.changed: set[str] = set()
        self.speed = 1.0
        self.note = ""
        keys = {
            "space": self.toggle, "Right": lambda: self.say("step"), "r": lambda: self.say("reset"),
            "g": self.grab, "i": self.next_integrator, "m": self.next_model, "o": self.toggle_floor, "c": self.next_colour,
            "f": lambda: self.set_speed(2), "d": lambda: self.set_speed(0.5),
            "s": lambda: self.say(f"save {Path('preview.toml').resolve()}"), "p": self.save_picture,
        }  # fmt: skip
        self.window = Window("preview", 2, keys, is_linked=False)
        plotter = self.window.plotter
        plotter.subplot(1, 0)
        self.text = plotter.add_text("", position="upper_left", font_size=9, color="black")
        self.charts = {
            title: pv.Chart2D(x_label="time (s)", y_label=title)
            for title in ("volume (%)", "largest displacement (m)", "kinetic and elastic energy (J)")
        }
        self.lines = {
            title: chart.line([0], [0], color="#0072B2", width=2) for title, chart in self.charts.items()
        }
        self.window.add_curves(list(self.charts.values()))
        self._begin()
        self._add_sliders()

    @property
    def scene(self) -> dict[str, Any]:
        return tomllib.loads(self.engine.latest.head["scene"])

    def _begin(self) -> None:
        """Draws the engine's body, in place of another one's."""
        plotter, engine = self.window.plotter, self.engine
        plotter.subplot(0, 0)
        self.skin = skin_of(engine.X, engine.F)
        self.skin.mesh["value"] = np.zeros(self.skin.mesh.n_points)
        self.largest = dict.fromkeys(self.colours, 0.0)
        self.actor = plotter.add_mesh(
            self.skin.mesh, scalars="value", cmap="viridis", name="body", show_scalar_bar=False, **LOOK
        )
        aim(plotter.camera, engine.X, self.window.panel, _ROOM)
        self.points: deque[tuple[float, ...]] = deque(maxlen=_KEPT)
        self.rates = Rates()
        self.volume_at_rest = volume(engine.X, engine.F)
        self.shown: Moment | None = None
        self._add_pivots()
        self.handle: Any = None
        self._draw_floor()

    def _add_sliders(self) -> None:
        plotter = self.window.plotter
        plotter.subplot(0, 1)
        self.sliders = {}
        for row, slider in enumerate(sliders_of(self.scene, self.engine.latest.head["step"])):
            ends = [slider.low, slider.high, slider.value]
            low, high, value = np.log10(ends) if slider.is_log else ends
            height = 0.92 - 0.13 * row
            label = f"log10 of {slider.label}" if slider.is_log else slider.label
            self.sliders[slider.key] = plotter.add_slider_widget(
                lambda moved, slider=slider: self.slide(slider, moved), (low, high), value=value, title=label,
                pointa=(0.1, height), pointb=(0.9, height), style="modern", color="black", title_height=0.022,
                interaction_event="end", fmt="%.3g",
            )  # fmt: skip

    def slide(self, slider: Slider, moved: float) -> None:
        value = 10**moved if slider.is_log else moved
        if slider.key == "gravity":
            x, _, z = self.scene.get("gravity", [0, 0, 0])
            self.set("gravity", f"[{float(x)}, {value}, {float(z)}]")
        else:
            self.set(slider.key, str(float(value)))

    def _add_pivots(self) -> None:
        """Handles on the body, which are dragged."""
        plotter = self.window.plotter
        plotter.clear_sphere_widgets()
        radius = 0.03 * float(np.linalg.norm(np.ptp(self.engine.X, axis=0)))
        for number, pivot in enumerate(self.scene.get("collapse", {}).get("pivots", [])):
            plotter.add_sphere_widget(
                lambda at, number=number: self.set(
                    f"collapse.pivots.{number}.point", str([float(x) for x in at])
                ),
                center=pivot["point"], radius=radius, color="#D55E00", test_callback=False, interaction_event="end",
            )  # fmt: skip

    def grab(self) -> None:
        """The vertex under the mouse by a spring whose other end is dragged; or lets go of it."""
        plotter = self.window.plotter
        if self.handle is not None:
            self.handle.Off()
            self.handle = None
            self.set("handles", "[]")
            return
        picker = vtkCellPicker()
        body = plotter.renderers[0]
        x, y = plotter.iren.get_event_position()
        if not picker.Pick(x, y, 0, body):
            self.note = "no surface under the mouse"
            return
        engine = self.engine
        at_hand = engine.X + engine.latest.u
        vertex = int(np.argmin(np.linalg.norm(at_hand - picker.GetPickPosition(), axis=1)))
        size = float(np.linalg.norm(np.ptp(engine.X, axis=0)))
        stiffness = _PULL * float(self.scene["material"]["E"]) * size

        def drag(at: Any) -> None:
            way = ", ".join(str(float(c)) for c in np.asarray(at) - engine.X[vertex])
            self.set("handles", f"[{{vertex = {vertex}, stiffness = {stiffness}, motion = [[0.0, {way}]]}}]")

        drag(at_hand[vertex])
        plotter.subplot(0, 0)
        self.handle = plotter.add_sphere_widget(
            drag, center=at_hand[vertex], radius=0.02 * size, color="#009E73", test_callback=False, interaction_event="always",
        )  # fmt: skip
        self.note = f"vertex {vertex} is pulled by {stiffness:.3g} N/m"

    def _draw_floor(self) -> None:
        plotter = self.window.plotter
        plotter.subplot(0, 0)
        plotter.remove_actor("floor")
        planes = [o["plane"] for o in self.scene.get("obstacles", []) if "plane" in o]
        for plane in planes[:1]:
            normal = np.array(plane["normal"], dtype=float)
            normal /= np.linalg.norm(normal)
            middle = self.engine.X.mean(axis=0)
            at = middle - (middle - plane["point"]) @ normal * normal
            size = 3 * float(np.ptp(self.engine.X, axis=0).max())
            floor = tiles(at, normal, size)
            plotter.add_mesh(floor, scalars="tile", rgb=True, lighting=False, name="floor", opacity=0.7)

    def say(self, command: str) -> None:
        try:
            self.engine.say(command)
        except (OSError, ValueError):
            self.note = "the program that steps has ended: close the window"

    def set(self, key: str, value: str) -> None:
        """A value on the way; what the engine refuses, it tells."""
        self.changed.add(key)
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
        now = self.scene["time"]["integrator"]
        following = self.schemes[(self.schemes.index(now) + 1) % len(self.schemes)]
        self.set("time.integrator", f'"{following}"')

    def next_model(self) -> None:
        """From rest, since it is another body."""
        now = self.scene["network"]["calibration"]
        following = self.models[(self.models.index(now) + 1) % len(self.models)]
        overrides = [*self._overrides_now(), f"network.calibration={following}"]
        try:
            engine = Engine(self.file, overrides)
        except RunError:
            self.note = f"{following} refuses the scene"
            return
        self.engine.end()
        self.engine, self.overrides = engine, overrides
        self.note = f"{following}, from rest"
        self._begin()

    def _overrides_now(self) -> list[str]:
        """Those of the command line, then what the engine has taken since."""
        taken = []
        for key in self.changed:
            value: Any = self.scene
            for part in key.split("."):
                value = value[int(part)] if isinstance(value, list) else value.get(part, [])
            taken.append(f"{key}={toml_of(value, key)}")
        return [*self.overrides, *taken]

    def toggle_floor(self) -> None:
        if any("plane" in obstacle for obstacle in self.scene.get("obstacles", [])):
            self.set("obstacles", "[]")
            return
        low, high = self.engine.X.min(axis=0), self.engine.X.max(axis=0)
        below = (low + high) / 2
        below[1] = low[1] - 0.5 * float(np.max(high - low))
        point = [float(x) for x in below]
        self.set("obstacles", f"[{{plane = {{point = {point}, normal = [0, 1, 0]}}}}]")

    def save_picture(self) -> None:
        self.window.plotter.screenshot("preview.png")
        self.note = f"saved {Path('preview.png').resolve()}"

    def draw(self, _: float) -> None:
        moment = self.engine.latest
        head = moment.head
        if self.shown is None or head["scene"] != self.shown.head["scene"]:
            self._draw_floor()
        rates = self.rates.add(time.perf_counter(), head["n_steps"], head["time"])
        if moment is not self.shown:
            self._show(moment)
        self._tell(head, *rates)

    def _show(self, moment: Moment) -> None:
        engine, head = self.engine, moment.head
        x = engine.X + moment.u
        colour = self.colours[0]
        values = {
            "displacement (m)": lambda: np.linalg.norm(moment.u, axis=1),
            "speed (m/s)": lambda: np.linalg.norm(moment.v, axis=1),
            "strain (%)": lambda: 100 * stretch(engine.X, engine.F, x),
        }[colour]()
        self.largest[colour] = max(self.largest[colour], float(values.max()), 1e-300)
        self.skin.move(x)
        self.skin.mesh["value"][:] = values[self.skin.ids]
        self.actor.mapper.scalar_range = (0, self.largest[colour])
        if self.points and head["time"] < self.points[-1][0]:
            self.points.clear()
        if not self.points or head["time"] > self.points[-1][0]:
            change = 100 * (head["volume"] / self.volume_at_rest - 1)
            energy = head["kinetic_energy"] + head["elastic_energy"]
            self.points.append((head["time"], change, float(np.linalg.norm(moment.u, axis=1).max()), energy))
            times, *curves = np.array(self.points).T
            for line, curve in zip(self.lines.values(), curves, strict=True):
                line.update(times, curve)
        self.shown = moment

    def _tell(self, head: dict[str, Any], steps: float, factor: float) -> None:
        scene = self.scene
        state = (
            "ended: r begins again" if head["has_ended"] else "running" if head["is_running"] else "paused"
        )
        if head["busy"] > _LATE:
            state += f", a step takes {head['busy']:.0f} s so far"
        if self.engine.has_died:
            state = "the program that steps has died: close the window"
        colour = self.colours[0]
        lines = [
            f"{head['time']:.4g} s, {state}; {steps:.0f} steps/s, {self.window.frames_per_second:.0f} frames/s, "
            f"{factor:.2g} of real time (at most {self.speed:g}); {scene['network']['calibration']}, "
            f"{scene['time']['integrator']}; colour: {colour}, to {self.largest[colour]:.3g}",
            _KEYS,
            head["message"] or head["reason"] or self.note,
        ]
        self.text.set_text("upper_left", "\n".join(lines))

    def run(self) -> None:
        """Until the window is closed."""
        self.window.open()
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
