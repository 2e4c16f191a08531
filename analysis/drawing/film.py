"""Films and strips of frames: runs side by side, in the order of a report, above a curve of each.

Beside a reference, runs have the colours of their errors; without one, those of their displacement.

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
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgba_array
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from ..compare import (
    Free,
    deformation,
    displacement_at,
    free_motions_of,
    keeps_volume,
    root_mean_square,
    tip_of,
    trajectory_error,
    volume_change,
)
from ..methods import REFERENCE, label_of
from ..runs import Array, Frame, Run, RunError, load_run, method_of, scene_of
from ..surface_points import on_points_of
from ..wording import percent, significant, unit_of_length
from .error_scale import CLAY, COLOURS, LEAST, MOST, POWERS, TICKS, powers_of
from .obstacles import Obstacles
from .pictures import LOOK, add_outline, aim, magnification, round_length, seen_size, skin_of, stage
from .style import style_of

_HEIGHT = 480  # pixels of a panel of a film, at most; half as many of a strip
_WIDTH = 1600  # pixels of a film, at most
_ASPECT = (1.0, 1.6)  # least and largest width of a panel over its height
_TITLE, _FOOTER = 22, 150  # pixels above the panels and below them
_DASH = 18  # pixels: of the line in a panel's title, which has the colour of its curve
_COLOURS = 256  # of a film: few keep it small
_SWATCH = 60  # pixels: height of the colours that a film's palette must hold


@dataclass(frozen=True)
class _Body:
    """A run's displacements at the shown times, and the values that colour it; None: it is drawn in clay."""

    X: Array
    F: Array
    u: list[Array]
    values: list[Array] | None

    def points(self, number: int, factor: float) -> Array:
        return self.X + factor * self.u[number]


@dataclass(frozen=True)
class _Paint:
    """What colours mean in a film."""

    label: str
    colours: Any  #: matplotlib's map
    norm: Normalize
    ticks: list[float]
    limits: tuple[float, float]  #: of the values at vertices


def _errors(runs: dict[str, Run], reference: Run, times: Array, is_free: Free) -> dict[str, list[Array]]:
    """At each vertex, at the times, of all runs but the reference, relative to what the report's are: powers of ten of %."""
    X, F = reference.last.X, reference.last.F

    def deformed(run: Run, time: float) -> Array:
        return deformation(Frame(X, displacement_at(run, time), F), is_free)

    length = root_mean_square(reference, is_free, times[-1])
    expected = [deformed(reference, time) for time in times]
    return {
        name: [
            powers_of(100 / length * np.linalg.norm(deformed(run, time) - u, axis=1))
            for time, u in zip(times, expected, strict=True)
        ]
        for name, run in runs.items()
        if run is not reference
    }


def _shared_times(runs: dict[str, Run], n: int) -> Array:
    """At most n times, evenly from the first frame to the end of the run that ends first; each run's own frames count
    where it has fewer."""
    first = max(run.times[0] for run in runs.values())
    last = min(run.times[-1] for run in runs.values())
    if not last > first:
        raise RunError("a film needs at least two frames; was the scene run with output.frames_every = 0?")
    return np.linspace(first, last, min(n, max(len(run.times) for run in runs.values())))


class _Camera:
    """Draws bodies from one fixed view, on one colour scale, so that frames and runs can be compared."""

    def __init__(self, runs: dict[str, Run], times: Array, panel_height: int) -> None:
        self.times = times
        scene = scene_of(next(iter(runs.values())))
        self.is_static = scene.get("time", {}).get("mode") == "static"
        self.is_free = free_motions_of(scene, (run.record for run in runs.values())) if scene else False
        reference = runs.get(REFERENCE) if len(runs) > 1 else None
        if reference:
            runs = {name: on_points_of(run, reference) for name, run in runs.items()}
        self.runs, self.reference = runs, reference
        fields = {name: [displacement_at(run, time) for time in times] for name, run in runs.items()}
        lengths = {name: [np.linalg.norm(u, axis=1) for u in of] for name, of in fields.items()}
        largest = max(float(length.max()) for of in lengths.values() for length in of)
        if not largest > 0:
            raise RunError("nothing moves in these runs, so there is no film of them")
        unit, size = unit_of_length(largest)
        values = (
            _errors(runs, reference, times, self.is_free)
            if reference
            else {name: [length / size for length in of] for name, of in lengths.items()}
        )
        self.bodies = {
            name: _Body(run.last.X, run.last.F, fields[name], values.get(name)) for name, run in runs.items()
        }
        self.paint = (
            _Paint("error (%)", COLOURS, LogNorm(LEAST, MOST), TICKS, POWERS)
            if reference
            else _Paint(
                f"displacement ({unit})",
                colormaps["viridis"],
                Normalize(0, largest / size),
                [0, largest / size],
                (0, largest / size),
            )
        )
        first = next(iter(self.bodies.values()))
        self.factor = magnification(first.X, np.array([[largest, 0, 0]]))
        if scene.get("obstacles"):
            self.factor = 1.0  # enlarged, a body would cross what it only touches
        self.shown = np.vstack(
            [body.points(k, self.factor) for body in self.bodies.values() for k in range(len(times))]
        )
        width, height = seen_size(self.shown)
        aspect = float(np.clip(width / height, *_ASPECT))
        high = min(panel_height, int(_WIDTH / len(runs) / aspect))
        self.panel = (int(high * aspect), high)
        self.obstacles = scene.get("obstacles", [])

    def title(self, name: str) -> str:
        """Of a run's panels: its name and, of a motion beside a reference, the error that the report's table holds."""
        if not self.reference or name == REFERENCE or self.is_static:
            return label_of(name)
        error = trajectory_error(self.runs[name], self.reference, self.is_free)
        return f"{label_of(name)} ({percent(error.l2)})"

    def shots(self, name: str) -> list[Image.Image]:
        """One picture of a run's body for each time."""
        body = self.bodies[name]
        plotter = stage(self.panel, is_smooth=False)
        skin = skin_of(body.X, body.F)
        if body.values is None:
            plotter.add_mesh(skin.mesh, color=CLAY, **LOOK)
        else:
            skin.mesh["value"] = np.zeros(skin.mesh.n_points)
            plotter.add_mesh(
                skin.mesh, scalars="value", cmap=self.paint.colours, clim=self.paint.limits,
                show_scalar_bar=False, **LOOK,
            )  # fmt: skip
        add_outline(plotter, body.X, body.F)
        obstacles = Obstacles(plotter, self.obstacles, self.shown)
        aim(plotter.camera, self.shown, self.panel)
        pictures = []
        for number in range(len(self.times)):
            skin.move(body.points(number, self.factor))
            if body.values is not None:
                skin.mesh["value"] = body.values[number][skin.ids]
            obstacles.move(self.times[number])
            plotter.render()
            picture = Image.fromarray(plotter.screenshot(None, return_img=True))
            _write_scale(picture, 2 * plotter.camera.parallel_scale / self.panel[1])
            pictures.append(picture)
        plotter.close()
        return pictures

    def curves(self) -> tuple[str, dict[str, tuple[Array, Array]]]:
        """What is drawn below the bodies, with its unit: the volume or, where the reference keeps it, the tip."""
        if self.reference and keeps_volume(self.reference):
            tip = tip_of(self.reference, self.is_free)
            curves = {name: tip.curve(run, self.is_free) for name, run in self.runs.items()}
            unit, size = unit_of_length(max(float(np.abs(moved).max()) for _, moved in curves.values()))
            return f"tip ({unit})", {name: (times, moved / size) for name, (times, moved) in curves.items()}
        changes = {name: volume_change(run) for name, run in self.runs.items()}
        return "volume (%)", {name: (times, 100 * change) for name, (times, change) in changes.items()}

    def footer(self, width: int) -> tuple[Image.Image, Array]:
        """A curve of each run and the colour scale, and where on it (pixels from the left) the shown times lie."""
        figure = Figure(figsize=(width / 100, _FOOTER / 100), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((min(0.3, 70 / width), 0.33, 1 - min(0.55, 240 / width), 0.6))
        label, curves = self.curves()
        for name, (times, values) in curves.items():
            axes.plot(times, values, color=self.colour(name), linewidth=2 if name == REFERENCE else 1.2)
        enlarged = "" if self.factor == 1 else f"; motion drawn {self.factor:g} x"
        axes.set_xlabel(("load factor (1)" if self.is_static else "time (s)") + enlarged, fontsize=8)
        axes.set_ylabel(label, fontsize=8)
        axes.tick_params(labelsize=7)
        bar = figure.add_axes((1 - min(0.25, 100 / width), 0.12, 12 / width, 0.78))
        scale = figure.colorbar(
            ScalarMappable(self.paint.norm, self.paint.colours), cax=bar, ticks=self.paint.ticks
        )
        scale.ax.minorticks_off()
        scale.ax.set_yticks(self.paint.ticks, [significant(tick, 2) for tick in self.paint.ticks], fontsize=7)
        bar.set_ylabel(self.paint.label, fontsize=7)
        canvas.draw()
        at = axes.transData.transform(np.column_stack([self.times, np.zeros_like(self.times)]))[:, 0]
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"), at

    def colour(self, name: str) -> str:
        """Of a run's curve."""
        return style_of(name, list(self.runs).index(name)).colour

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


def _entitle(page: Image.Image, at: tuple[int, int], colour: str, text: str) -> None:
    """Above a panel: a line as its curve, and text."""
    left, top = at
    ImageDraw.Draw(page).line([(left + 6, top + 12), (left + 6 + _DASH, top + 12)], fill=colour, width=3)
    _write(page, (left + 12 + _DASH, top + 4), text)


def _mosaic(pages: list[Image.Image], camera: _Camera) -> Image.Image:
    """Some of the pages in one, so that a palette serves them all, above the colours of the scale and the lines, which are
    too few of the pixels to be kept by themselves."""
    some = pages[:: max(1, len(pages) // 8)]
    width, height = some[0].size
    whole = Image.new("RGB", (width, len(some) * height + 2 * _SWATCH), "white")
    for number, page in enumerate(some):
        whole.paste(page, (0, number * height))
    lines = to_rgba_array([camera.colour(name) for name in camera.runs])
    for row, colours in enumerate((camera.paint.colours(np.linspace(0, 1, 32)), lines)):
        swatches = np.repeat(np.uint8(255 * colours[None, :, :3]), _SWATCH, axis=0)
        at = (0, len(some) * height + row * _SWATCH)
        whole.paste(Image.fromarray(swatches).resize((width, _SWATCH), Image.Resampling.NEAREST), at)
    return whole


def draw_film(
    file: Path, runs: dict[str, Run], n_frames: int = 30, seconds: float = 4, times: Array | None = None
) -> None:
    """Writes a GIF of the runs side by side above a curve of each.

    runs: method (fem_reference or a spring model) -> run; times: of the frames, where not n_frames evenly. All are seen from
    the same place; small motion is enlarged, and the film says by how much. Raises RunError where nothing moves.
    """
    times = _shared_times(runs, n_frames) if times is None else times
    camera = _Camera(runs, times, _HEIGHT)
    width, height = camera.panel
    shots = {name: camera.shots(name) for name in runs}
    titles = {name: camera.title(name) for name in runs}
    footer, at = camera.footer(len(runs) * width)
    pages = []
    for number, time in enumerate(times):
        page = Image.new("RGB", (len(runs) * width, _TITLE + height + _FOOTER), "white")
        for column, name in enumerate(runs):
            page.paste(shots[name][number], (column * width, _TITLE))
            text = f"{titles[name]}, {camera.moment(time)}"
            _entitle(page, (column * width, 0), camera.colour(name), text)
        page.paste(footer, (0, _TITLE + height))
        ImageDraw.Draw(page).line(
            [(at[number], _TITLE + height + 10), (at[number], _TITLE + height + 100)], fill="grey"
        )
        pages.append(page)
    palette = _mosaic(pages, camera).quantize(_COLOURS, Image.Quantize.MEDIANCUT)
    frames = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in pages]
    duration = int(1000 * seconds / len(frames))
    durations = [duration] * (len(frames) - 1) + [1000]  # rest at the end
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)


def draw_strip(file: Path, runs: dict[str, Run], n_frames: int = 5) -> None:
    """Writes a PNG with a row of frames for each run, evenly in time, above a curve of each."""
    times = _shared_times(runs, n_frames)
    camera = _Camera(runs, times, _HEIGHT // 2)
    width, height = camera.panel
    row = _TITLE + height
    page = Image.new("RGB", (len(times) * width, len(runs) * row + _FOOTER), "white")
    for line, name in enumerate(runs):
        for column, shot in enumerate(camera.shots(name)):
            page.paste(shot, (column * width, line * row + _TITLE))
            moment = camera.moment(times[column])
            if column:
                _write(page, (column * width + 6, line * row + 4), moment)
            else:
                _entitle(page, (0, line * row), camera.colour(name), f"{camera.title(name)}, {moment}")
    footer, at = camera.footer(page.width)
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
