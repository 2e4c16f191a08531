"""Films and strips of frames: runs side by side, painted with displacement, above their volume curves.

    python -m analysis.drawing.film RUN_FOLDER [RUN_FOLDER ...] [--out FOLDER]

writes film.gif and strip.png, by default into the first run's folder.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba_array
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from ..compare import displacement_at, volume_change
from ..methods import REFERENCE, label_of
from ..runs import Array, Run, RunError, load_run, method_of, scene_of
from ..wording import significant
from .pictures import (
    add_outline,
    aim,
    magnification,
    round_length,
    seen_size,
    skin_of,
    stage,
    tiles,
    view_axes,
)
from .style import style_of

_HEIGHT = 480  # pixels of a panel of a film; half as many of a strip
_ASPECT = (1.0, 1.6)  # least and largest width of a panel over its height
_TITLE, _FOOTER = 22, 150  # pixels above the panels and below them
_COLOURS = 256  # of a film: few keep it small
_MAP = "viridis"
_SWATCH = 60  # pixels: height of the colours that a film's palette must hold


@dataclass(frozen=True)
class _Body:
    """A run's displacements at the shown times, and how they are drawn."""

    X: Array
    F: Array
    u: list[Array]

    def points(self, number: int, factor: float) -> Array:
        return self.X + factor * self.u[number]


def _bodies(runs: dict[str, Run], times: Array) -> dict[str, _Body]:
    return {
        name: _Body(run.last.X, run.last.F, [displacement_at(run, time) for time in times])
        for name, run in runs.items()
    }


def _shared_times(runs: dict[str, Run], n: int) -> Array:
    """At most n times, evenly from the first frame to the end of the run that ends first; each run's own frames count
    where it has fewer."""
    first = max(run.times[0] for run in runs.values())
    last = min(run.times[-1] for run in runs.values())
    if not last > first:
        raise RunError("a film needs at least two frames; was the scene run with output.frames_every = 0?")
    return np.linspace(first, last, min(n, max(len(run.times) for run in runs.values())))


def _obstacle_mesh(obstacle: dict[str, Any], middle: Array, size: float) -> pv.PolyData:
    """An obstacle of the scene where it starts; a plane as a square of twice the size, beside the body's middle."""
    if plane := obstacle.get("plane"):
        normal = np.array(plane["normal"], dtype=float)
        normal /= np.linalg.norm(normal)
        at = middle - (middle - plane["point"]) @ normal * normal
        return tiles(at, normal, 2 * size)
    if sphere := obstacle.get("sphere"):
        return pv.Sphere(
            radius=sphere["radius"], center=sphere["center"], theta_resolution=60, phi_resolution=60
        )
    if box := obstacle.get("box"):
        return pv.Box(bounds=np.column_stack([box["low"], box["high"]]).ravel())
    if capsule := obstacle.get("capsule"):
        a, b = np.array(capsule["a"], dtype=float), np.array(capsule["b"], dtype=float)
        axis = b - a
        return pv.Capsule(
            center=(a + b) / 2,
            direction=axis,
            radius=capsule["radius"],
            cylinder_length=float(np.linalg.norm(axis)),
        )
    return pv.read(obstacle["mesh"]["file"])


def _add_obstacle(plotter: pv.Plotter, mesh: pv.PolyData) -> pv.Actor:
    """A floor is behind all that stands on it; what else there is must not hide a body."""
    if "tile" in mesh.cell_data and mesh.point_normals[0] @ view_axes()[2] > 0:
        return plotter.add_mesh(mesh, scalars="tile", rgb=True, lighting=False)
    return plotter.add_mesh(mesh, color="lightgrey", opacity=0.5)


def _translation(obstacle: dict[str, Any], time: float) -> Array:
    """Of the obstacle's motion [[s, m, m, m], ...], linear in between and constant outside."""
    if not obstacle.get("motion"):
        return np.zeros(3)
    times, *components = np.array(obstacle["motion"], dtype=float).T
    return np.array([np.interp(time, times, component) for component in components])


class _Camera:
    """Draws bodies from one fixed view, on one colour scale, so that frames and runs can be compared."""

    def __init__(self, runs: dict[str, Run], times: Array, panel_height: int) -> None:
        self.bodies = _bodies(runs, times)
        scene = scene_of(next(iter(runs.values())))
        self.is_static = scene.get("time", {}).get("mode") == "static"
        fields = [np.linalg.norm(u, axis=1).max() for body in self.bodies.values() for u in body.u]
        self.largest = max(fields)
        if not self.largest > 0:
            raise RunError("nothing moves in these runs, so there is no film of them")
        first = next(iter(self.bodies.values()))
        self.factor = magnification(first.X, np.array([[self.largest, 0, 0]]))
        if scene.get("obstacles"):
            self.factor = 1.0  # enlarged, a body would cross what it only touches
        self.shown = np.vstack(
            [
                points
                for body in self.bodies.values()
                for points in (body.points(k, self.factor) for k in range(len(times)))
            ]
        )
        width, height = seen_size(self.shown)
        self.panel = (int(panel_height * np.clip(width / height, *_ASPECT)), panel_height)
        middle = (self.shown.min(axis=0) + self.shown.max(axis=0)) / 2
        size = float(np.linalg.norm(np.ptp(self.shown, axis=0)))
        self.times = times
        self.obstacles = [(o, _obstacle_mesh(o, middle, size)) for o in scene.get("obstacles", [])]

    def shots(self, name: str) -> list[Image.Image]:
        """One picture of a run's body for each time."""
        body = self.bodies[name]
        plotter = stage(self.panel, is_smooth=False)
        skin = skin_of(body.X, body.F)
        skin.mesh["displacement"] = np.zeros(skin.mesh.n_points)
        plotter.add_mesh(
            skin.mesh, scalars="displacement", cmap=_MAP, clim=(0, self.largest), ambient=0.5, diffuse=0.6, show_scalar_bar=False,
            smooth_shading=True,
        )  # fmt: skip
        add_outline(plotter, body.X, body.F)
        actors = [(o, _add_obstacle(plotter, m)) for o, m in self.obstacles]
        aim(plotter.camera, self.shown, self.panel)
        pictures = []
        for number, u in enumerate(body.u):
            skin.move(body.points(number, self.factor))
            skin.mesh["displacement"] = np.linalg.norm(u, axis=1)[skin.ids]
            for obstacle, actor in actors:
                actor.position = _translation(obstacle, self.times[number])
            plotter.render()
            picture = Image.fromarray(plotter.screenshot(None, return_img=True))
            _write_scale(picture, 2 * plotter.camera.parallel_scale / self.panel[1])
            pictures.append(picture)
        plotter.close()
        return pictures

    def footer(self, runs: dict[str, Run], width: int, marks: Array) -> tuple[Image.Image, Array]:
        """Volume curves and the colour scale, and where on it (pixels from the left) the marks lie."""
        figure = Figure(figsize=(width / 100, _FOOTER / 100), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((min(0.3, 70 / width), 0.33, 1 - min(0.45, 220 / width), 0.6))
        for number, (name, run) in enumerate(runs.items()):
            times, change = volume_change(run)
            axes.plot(
                times,
                100 * change,
                color=style_of(name, number).colour,
                linewidth=2 if name == REFERENCE else 1.2,
            )
        enlarged = "" if self.factor == 1 else f"; motion drawn {self.factor:g} x"
        axes.set_xlabel(("load factor (1)" if self.is_static else "time (s)") + enlarged, fontsize=8)
        axes.set_ylabel("volume (%)", fontsize=8)
        axes.tick_params(labelsize=7)
        bar = figure.add_axes((1 - min(0.1, 60 / width), 0.1, 12 / width, 0.8))
        figure.colorbar(
            ScalarMappable(Normalize(0, self.largest), _MAP), cax=bar, ticks=[0, self.largest], format="%.2g"
        )
        bar.tick_params(labelsize=7)
        bar.set_ylabel("displ. (m)", fontsize=7, labelpad=-8)
        canvas.draw()
        at = axes.transData.transform(np.column_stack([marks, np.zeros_like(marks)]))[:, 0]
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"), at

    def moment(self, time: float) -> str:
        return f"load {time:.3g}" if self.is_static else f"{time:.3g} s"


def _write(picture: Image.Image, at: tuple[float, float], text: str) -> None:
    ImageDraw.Draw(picture).text(at, text, fill="black", font=ImageFont.load_default(13))


def _write_scale(picture: Image.Image, pixel: float) -> None:
    """A bar of a round length at the lower left. pixel: its size (m)."""
    length = round_length(0.25 * picture.width * pixel)
    left, right, bottom = 8, 8 + length / pixel, picture.height - 8
    ImageDraw.Draw(picture).line([(left, bottom), (right, bottom)], fill="black", width=3)
    _write(picture, (left, bottom - 19), f"{significant(length)} m")


def _mosaic(pages: list[Image.Image], lines: list[str]) -> Image.Image:
    """Some of the pages in one, so that a palette serves them all, above the colours of the scale and the lines, which are
    too few of the pixels to be kept by themselves."""
    some = pages[:: max(1, len(pages) // 8)]
    width, height = some[0].size
    whole = Image.new("RGB", (width, len(some) * height + 2 * _SWATCH), "white")
    for number, page in enumerate(some):
        whole.paste(page, (0, number * height))
    for row, colours in enumerate((colormaps[_MAP](np.linspace(0, 1, 32)), to_rgba_array(lines))):
        swatches = np.repeat(np.uint8(255 * colours[None, :, :3]), _SWATCH, axis=0)
        at = (0, len(some) * height + row * _SWATCH)
        whole.paste(Image.fromarray(swatches).resize((width, _SWATCH), Image.Resampling.NEAREST), at)
    return whole


def draw_film(
    file: Path, runs: dict[str, Run], n_frames: int = 30, seconds: float = 4, times: Array | None = None
) -> None:
    """Writes a GIF of the runs side by side above their volume curves.

    runs: method (fem_reference or a spring model) -> run; times: of the frames, where not n_frames evenly. All are seen from
    the same place and coloured by displacement on one scale; small motion is enlarged, and the film says by how much. Raises
    RunError where nothing moves.
    """
    times = _shared_times(runs, n_frames) if times is None else times
    camera = _Camera(runs, times, _HEIGHT)
    width, height = camera.panel
    shots = {name: camera.shots(name) for name in runs}
    footer, at = camera.footer(runs, len(runs) * width, times)
    pages = []
    for number, time in enumerate(times):
        page = Image.new("RGB", (len(runs) * width, _TITLE + height + _FOOTER), "white")
        for column, name in enumerate(runs):
            page.paste(shots[name][number], (column * width, _TITLE))
            _write(page, (column * width + 6, 4), f"{label_of(name)}, {camera.moment(time)}")
        page.paste(footer, (0, _TITLE + height))
        ImageDraw.Draw(page).line(
            [(at[number], _TITLE + height + 10), (at[number], _TITLE + height + 100)], fill="grey"
        )
        pages.append(page)
    lines = [style_of(name, number).colour for number, name in enumerate(runs)]
    palette = _mosaic(pages, lines).quantize(_COLOURS, Image.Quantize.MEDIANCUT)
    frames = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in pages]
    duration = int(1000 * seconds / len(frames))
    durations = [duration] * (len(frames) - 1) + [1000]  # rest at the end
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)


def draw_strip(file: Path, runs: dict[str, Run], n_frames: int = 5) -> None:
    """Writes a PNG with a row of frames for each run, evenly in time, above their volume curves."""
    times = _shared_times(runs, n_frames)
    camera = _Camera(runs, times, _HEIGHT // 2)
    width, height = camera.panel
    row = _TITLE + height
    page = Image.new("RGB", (len(times) * width, len(runs) * row + _FOOTER), "white")
    for line, name in enumerate(runs):
        for column, shot in enumerate(camera.shots(name)):
            page.paste(shot, (column * width, line * row + _TITLE))
            moment = camera.moment(times[column])
            _write(
                page,
                (column * width + 6, line * row + 4),
                moment if column else f"{label_of(name)}, {moment}",
            )
    footer, at = camera.footer(runs, page.width, times)
    page.paste(footer, (0, page.height - _FOOTER))
    for x in at:
        ImageDraw.Draw(page).line([(x, page.height - _FOOTER + 10), (x, page.height - 50)], fill="lightgrey")
    page.save(file, optimize=True)


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m analysis.drawing.film", description=__doc__.splitlines()[0]
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN_FOLDER")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the first run's folder")
    arguments = parser.parse_args(words)
    out = arguments.out or arguments.runs[0]
    try:
        runs = {method_of(run): run for run in map(load_run, arguments.runs)}
        out.mkdir(parents=True, exist_ok=True)
        draw_film(out / "film.gif", runs)
        draw_strip(out / "strip.png", runs)
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"{out / 'film.gif'}\n{out / 'strip.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
