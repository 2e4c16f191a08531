"""Finished runs replayed side by side in a window: one camera, colours, curves that grow, and a slider of time."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from ..compare import volume_change
from ..methods import REFERENCE, label_of
from ..runs import SOLVED, Array, Run, RunError, method_of, scene_of
from ..surface_points import on_points_of
from ..time_warp import WARPS
from .export import opened
from .obstacles import Obstacles
from .pictures import LOOK, Skin, aim, magnification, skin_of
from .style import style_of
from .window import Window, check_display

_HELP = "space: play   left, right: a frame   b: backwards   w: warp   c: colour   f: faster   d: slower   q: close"
LEGEND: dict[str, Any] = {
    "vertical": True, "position_x": 0.86, "position_y": 0.15, "width": 0.07, "height": 0.6, "n_labels": 3, "fmt": "%.3g",
    "color": "black", "title_font_size": 13, "label_font_size": 12,
}  # fmt: skip
_TITLE = 65  # pixels to either side of its middle that a legend's title takes
_DASHES = ("-", "--", ":", "-.")  # of runs by one method
_ROOM = (0.66, 0.88)  # of a panel's width and height, left to the body


def stretch(X: Array, F: Array, x: Array) -> Array:
    """At vertices (n,): the largest |principal stretch - 1| of their triangles, as F (m, 3) moves from X to x (n, 3).

    With edges a, b the metrics G = (a, b)^T (a, b) at rest and g when moved, squared stretches are eigenvalues of G^-1 g.
    """

    def metric(points: Array) -> Array:
        edges = points[F[:, 1:]] - points[F[:, :1]]
        return np.einsum("tid,tjd->tij", edges, edges)

    ratio = np.linalg.solve(metric(X), metric(x))
    half_trace = np.trace(ratio, axis1=1, axis2=2) / 2
    half_difference = (ratio[:, 0, 0] - ratio[:, 1, 1]) / 2
    root = np.sqrt(np.maximum(half_difference**2 + ratio[:, 0, 1] * ratio[:, 1, 0], 0))
    strains = [np.abs(np.sqrt(np.maximum(half_trace + sign * root, 0)) - 1) for sign in (-1, 1)]
    values = np.zeros(len(X))
    np.maximum.at(values, F.ravel(), np.repeat(np.maximum(*strains), 3))
    return values


def entitle(legend: Any, title: str) -> None:
    """A scalar bar of VTK."""
    legend.SetTitle(title)
    legend.SetVerticalTitleSeparation(8)


def is_static(run: Run) -> bool:
    return scene_of(run).get("time", {}).get("mode") == "static"


@dataclass
class _Body:
    """A run and what shows it: u (n_frames, n, 3) m, fields: name -> (n_frames, n) that colours it."""

    run: Run
    u: Array
    fields: dict[str, Array]
    skin: Skin = field(init=False)

    def __post_init__(self) -> None:
        self.X, self.F = self.run.last.X, self.run.last.F
        self.skin = skin_of(self.X, self.F)


def fields_of(run: Run, u: Array, other: Run | None) -> dict[str, Array]:
    """Label with unit -> values (n_frames, n): what a body can be coloured by.

    u: (n_frames, n, 3) m; other: the run that it differs from, on points of its own surface.
    """
    X, F = run.last.X, run.last.F
    fields = {
        "displacement (m)": np.linalg.norm(u, axis=2),
        "strain (%)": np.array([100 * stretch(X, F, X + v) for v in u]),
    }
    if not is_static(run):
        fields["speed (m/s)"] = np.linalg.norm(np.gradient(u, run.times, axis=0), axis=2)
    if other and is_same_body(run, other):
        at = on_points_of(other, run)
        theirs = np.array([at.frame(k).u for k in range(len(at.times))])
        fields["difference (m)"] = np.linalg.norm(u - in_time(theirs, at.times, run.times), axis=2)
    return fields


def other_than(run: Run, runs: list[Run]) -> Run | None:
    """Of the runs the one that a run is compared with: the reference, or else the first."""
    others = [other for other in runs if other is not run]
    return next((other for other in others if method_of(other) == REFERENCE), others[0] if others else None)


def is_same_body(run: Run, other: Run) -> bool:
    try:
        on_points_of(other, run)
    except RunError:
        return False
    return True


def in_time(values: Array, times: Array, at: Array) -> Array:
    """Values (n_times, ...) at other times, linear between, constant beyond."""
    number = np.interp(at, times, np.arange(len(times)))
    before = np.minimum(number.astype(int), len(times) - 2)
    share = (number - before).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[before] + share * values[before + 1]


class Player:
    """Where in time a replay stands (s, or load factor), and how it goes on: it knows no window."""

    def __init__(self, times: Array, seconds: float, warp: str, is_reversed: bool) -> None:
        self.times, self.seconds, self.warp, self.is_reversed = times, seconds, warp, is_reversed
        self.time = float(times[-1] if is_reversed else times[0])
        self.is_playing = True

    @property
    def _length(self) -> float:
        return float(self.times[-1] - self.times[0])

    def advance(self, seconds: float) -> None:
        """Goes on by so much of the film, and begins anew after its end."""
        shares = np.linspace(0, 1, 1001)
        warped = WARPS[self.warp](shares)
        share = (self.time - self.times[0]) / self._length
        share = 1 - share if self.is_reversed else share
        film = float(np.interp(share, warped, shares)) + seconds / self.seconds
        share = 0.0 if film > 1 and share >= 1 else float(np.interp(film, shares, warped))
        self.time = float(self.times[0] + self._length * (1 - share if self.is_reversed else share))

    def step(self, n: int) -> None:
        """Stops at the n-th frame from here."""
        self.is_playing = False
        frame = int(np.interp(self.time, self.times, np.arange(len(self.times))) + (1 - 1e-9) * (n < 0))
        self.time = float(self.times[np.clip(frame + n, 0, len(self.times) - 1)])


_CURVES: dict[str, Callable[[_Body], tuple[Array, Array]]] = {
    "volume (%)": lambda body: (body.run.curves["time"], 100 * volume_change(body.run)[1]),
    "tip (m)": lambda body: (body.run.times, body.fields["displacement (m)"].max(axis=1)),
    "energy (J)": lambda body: (
        body.run.curves["time"],
        np.sum(
            [body.run.curves[n] for n in ("kinetic_energy", "elastic_energy") if n in body.run.curves], axis=0
        ),
    ),
}


class Replay:
    """The window; runs: name -> run."""

    def __init__(self, runs: dict[str, Run], player: Player) -> None:
        self.player = player
        first = next(iter(runs.values()))
        self.bodies = {}
        for name, run in runs.items():
            u = np.array([run.frame(k).u for k in range(len(run.times))])
            self.bodies[name] = _Body(run, u, fields_of(run, u, other_than(run, list(runs.values()))))
        body = next(iter(self.bodies.values()))
        largest = body.u[np.unravel_index(np.linalg.norm(body.u, axis=2).argmax(), body.u.shape[:2])]
        self.factor = 1.0 if scene_of(first).get("obstacles") else magnification(body.X, largest[None])
        self.colours = list(dict.fromkeys(name for b in self.bodies.values() for name in b.fields))
        self.colour = self.colours[0]
        self.window = Window(
            "replay", [min(700, 1500 // len(runs))] * len(runs),
            {
                "space": self.toggle_play, "Right": lambda: player.step(1), "Left": lambda: player.step(-1),
                "b": self.turn_back, "w": self.next_warp, "c": self.next_colour,
                "f": lambda: self.change_length(1 / 1.5), "d": lambda: self.change_length(1.5),
            },
        )  # fmt: skip
        self.curves: list[tuple[Any, Array, Array]] = []
        self._add_bodies()
        self._add_curves()
        plotter = self.window.plotter
        plotter.subplot(1, 0)
        self.text = self.window.add_text(0.98)
        self.slider = plotter.add_slider_widget(
            self._scrub, (player.times[0], player.times[-1]), value=player.time, color="black",
            pointa=(0.5, 0.9), pointb=(0.97, 0.9), style="modern", interaction_event="always", fmt="%.4g",
        )  # fmt: skip
        self.paint()
        self.show()

    def _add_bodies(self) -> None:
        plotter = self.window.plotter
        shown = np.vstack([b.X + self.factor * v for b in self.bodies.values() for v in b.u])
        self.actors: dict[str, pv.Actor] = {}
        self.obstacles: list[Obstacles] = []
        middle = min(LEGEND["position_x"] + LEGEND["width"] / 2, 1 - _TITLE / self.window.panel[0])
        look = LEGEND | {"position_x": middle - LEGEND["width"] / 2}
        for panel, (name, body) in enumerate(self.bodies.items()):
            plotter.subplot(0, panel)
            enlarged = "" if self.factor == 1 else f", motion drawn {self.factor:g} times as large"
            plotter.add_text(f"{name}{enlarged}", font_size=10, color="black")
            body.skin.mesh["value"] = np.zeros(body.skin.mesh.n_points)
            self.actors[name] = plotter.add_mesh(
                body.skin.mesh, scalars="value", cmap="viridis", scalar_bar_args={"title": name} | look, **LOOK
            )  # fmt: skip
            self.obstacles.append(Obstacles(plotter, scene_of(body.run).get("obstacles", []), shown))
            aim(plotter.camera, shown, self.window.panel, _ROOM)

    def _add_curves(self) -> None:
        run = next(iter(self.bodies.values())).run
        label = "load factor" if is_static(run) else "time (s)"
        charts: list[pv.Chart2D] = []
        methods = [method_of(body.run) for body in self.bodies.values()]
        for title, curve_of in _CURVES.items():
            chart = pv.Chart2D(x_label=label, y_label=title)
            for place, (name, body) in enumerate(self.bodies.items()):
                times, values = curve_of(body)
                colour = style_of(methods[place], place).colour
                dash = _DASHES[methods[:place].count(methods[place]) % len(_DASHES)]
                chart.line(times, values, color=(*pv.Color(colour).int_rgb, 60))
                line = chart.line(times[:1], values[:1], color=colour, width=2.5, style=dash, label=name)
                self.curves.append((line, times, values))
            chart.legend_visible = not charts
            charts.append(chart)
        self.window.add_curves(charts)

    def toggle_play(self) -> None:
        self.player.is_playing = not self.player.is_playing

    def turn_back(self) -> None:
        self.player.is_reversed = not self.player.is_reversed

    def next_warp(self) -> None:
        names = list(WARPS)
        self.player.warp = names[(names.index(self.player.warp) + 1) % len(names)]

    def change_length(self, factor: float) -> None:
        self.player.seconds *= factor

    def next_colour(self) -> None:
        self.colour = self.colours[(self.colours.index(self.colour) + 1) % len(self.colours)]
        self.paint()

    def paint(self) -> None:
        """One scale for all bodies that have such a field; others are plain."""
        coloured = [body.fields[self.colour] for body in self.bodies.values() if self.colour in body.fields]
        largest = max(float(values.max()) for values in coloured)
        for name, actor in self.actors.items():
            actor.mapper.scalar_visibility = self.colour in self.bodies[name].fields
            actor.mapper.scalar_range = (0, largest or 1)
            legend = self.window.plotter.scalar_bars[name]
            legend.SetVisibility(actor.mapper.scalar_visibility)
            entitle(legend, self.colour)

    def _scrub(self, time: float) -> None:
        if abs(time - self.player.time) > 1e-9 * abs(self.player.times[-1]):
            self.player.time, self.player.is_playing = float(time), False

    def show(self) -> None:
        """The bodies and the curves at the player's time."""
        now = np.array([self.player.time])
        for body in self.bodies.values():
            (u,) = in_time(body.u, body.run.times, now)
            body.skin.move(body.X + self.factor * u)
            if self.colour in body.fields:
                (value,) = in_time(body.fields[self.colour], body.run.times, now)
                body.skin.mesh["value"][:] = value[body.skin.ids]
        for obstacles in self.obstacles:
            obstacles.move(self.player.time)
        for line, times, values in self.curves:
            until = np.append(times[times < self.player.time], self.player.time)
            line.update(until, np.interp(until, times, values))
        player = self.player
        direction = "backwards" if player.is_reversed else "forwards"
        state = "playing" if player.is_playing else "paused"
        self.text.input = (
            f"{player.time:.4g} of {player.times[-1]:.4g}, {state} {direction}, warp {player.warp}, {player.seconds:.3g} s,"
            f" {self.window.frames_per_second:.0f} frames/s\n{_HELP}"
        )
        self.slider.GetRepresentation().SetValue(player.time)

    def draw(self, seconds: float) -> None:
        if self.player.is_playing:
            self.player.advance(seconds)
        self.show()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folders of runs, side by side")
    parser.add_argument("--reverse", action="store_true", help="play backwards")
    parser.add_argument(
        "--warp", choices=list(WARPS), default="constant", help="of time; default: %(default)s"
    )
    parser.add_argument("--seconds", type=float, default=4, help="of the replay; default: %(default)g")


def replay_of(arguments: argparse.Namespace) -> Replay:
    """Raises RunError where a run is damaged, has one frame, or there is no display."""
    check_display(f"./testbed export {arguments.runs[0]} --format film draws a film")
    if not 0 < arguments.seconds < 1e6:
        raise RunError(f"--seconds {arguments.seconds:g}, expected more than 0 and less than a million")
    runs: dict[str, Run] = {}
    for run in map(opened, arguments.runs):
        if len(run.times) < 2:
            raise RunError(f"{run.folder}: one frame, expected two at least; was output.frames_every = 0?")
        label = label_of(method_of(run))
        runs[f"{label} ({run.folder})" if label in runs else label] = run
    longest = max(runs.values(), key=lambda run: run.times[-1])
    return Replay(runs, Player(longest.times, arguments.seconds, arguments.warp, arguments.reverse))


def main(arguments: argparse.Namespace) -> int:
    replay = replay_of(arguments)
    replay.window.open()
    replay.window.loop(replay.draw)
    return SOLVED
