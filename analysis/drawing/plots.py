"""Plots of a comparison, each by itself as SVG text or all in one figure."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure, FigureBase

from ..methods import REFERENCE, label_of
from ..runs import Array
from ..wording import percent
from ..wording import seconds as wording_of
from .error_scale import LEAST, MARKS, MOST
from .style import number_logarithmic, style_of, svg_of

Curve = tuple[Array, Array]
SMALLEST = 1e-9  # error drawn (%): below lies rounding
_STAGES = {  # in the order of a report's table; Tol 2021, "Colour schemes"
    "start-up": "#AA4499",
    "mesh": "#BBBBBB",
    "adapt": "#999933",
    "setup": "#DDCC77",
    "assemble": "#88CCEE",
    "solve": "#332288",
    "output": "#117733",
}


class Plot(NamedTuple):
    """A plot that stands by itself or in a part of a figure."""

    size: tuple[float, float]  #: inches
    draw: Callable[[FigureBase], None]

    def svg(self) -> str:
        figure = Figure(figsize=self.size, layout="constrained")
        self.draw(figure)
        return svg_of(figure)


_LETTERS = 13  # of a caption, in an inch


class ShownFigure(Figure):
    """A figure that a notebook shows without being told how."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()


def figure_of(plots: dict[str, Plot]) -> ShownFigure:
    """All plots below each other, with their captions."""
    sizes = [plot.size for plot in plots.values()]
    width, heights = max(width for width, _ in sizes), [height for _, height in sizes]
    figure = ShownFigure(figsize=(width, sum(heights) + 0.4 * len(heights)), layout="constrained")
    parts = figure.subfigures(len(plots), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, (caption, plot) in zip(parts, plots.items(), strict=True):
        plot.draw(part)
        lines = textwrap.fill(caption, int(_LETTERS * width))
        part.supxlabel(lines, fontsize=9, color="#555555")
    return figure


class Panel(NamedTuple):
    """One quantity of every method over load or time."""

    label: str
    factor: float  #: from the curves' values to what is drawn
    curves: dict[str, Curve]  #: method -> times and values


def plot_curves(panels: list[Panel], time_label: str, labels: dict[str, str] | None = None) -> Plot:
    """Panels side by side, below each the difference from the reference, where there is one.

    labels: of methods, where they are not those that every report uses.
    """
    has_reference = REFERENCE in panels[0].curves

    def draw(figure: FigureBase) -> None:
        grid = figure.subplots(2 if has_reference else 1, len(panels), sharex="col", squeeze=False,
                               height_ratios=(2, 1) if has_reference else None)  # fmt: skip
        for panel, column in zip(panels, grid.T, strict=True):
            column[-1].set_xlabel(time_label)
            column[0].set_ylabel(panel.label)
            for method, (times, values) in panel.curves.items():
                colour, marker = style_of(method)
                shape = {"color": colour, "marker": marker, "markersize": 5, "linewidth": 1.6}
                if method == REFERENCE:  # below the others, and seen behind a curve that meets it
                    shape |= {"markersize": 8, "linewidth": 3, "zorder": 1}
                column[0].plot(
                    times,
                    panel.factor * values,
                    label=(labels or {}).get(method, label_of(method)),
                    markevery=_every(times),
                    **shape,
                )
                if method != REFERENCE and has_reference:
                    times_ref, values_ref = panel.curves[REFERENCE]
                    is_shared = times_ref <= times[-1] * (1 + 1e-9)
                    difference = np.interp(times_ref, times, values) - values_ref
                    column[1].plot(
                        times_ref[is_shared],
                        panel.factor * difference[is_shared],
                        markevery=_every(times_ref),
                        **shape,
                    )
            if has_reference:
                column[1].axhline(0, color=style_of(REFERENCE).colour, linewidth=1)
                column[1].set_ylabel("difference")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        figure.align_ylabels()

    return Plot((7 if len(panels) == 1 else 10, 5.2 if has_reference else 3.5), draw)


def _every(times: Array) -> int:
    """A dozen markers or two are enough."""
    return 1 if len(times) <= 25 else len(times) // 12


def plot_errors(errors: dict[str, tuple[float, float]], of_reference: float | None) -> Plot:
    """Points for the relative displacement error of every method, its mean and its largest, on a logarithmic axis.

    of_reference: up to which a band is drawn, if it is known.
    """

    def draw(figure: FigureBase) -> None:
        axes = figure.subplots()
        for row, (name, pair) in enumerate(errors.items()):
            mean, largest = (max(100 * error, SMALLEST) for error in pair)
            colour, marker = style_of(name)
            axes.plot([mean, largest], [row, row], color=colour, linewidth=1)
            axes.plot([largest], [row], marker, color=colour, markerfacecolor="white")
            axes.plot([mean], [row], marker, color=colour, markersize=8)
            axes.annotate(percent(pair[0]), (mean, row), (-8, 0), textcoords="offset points",
                          ha="right", va="center", fontsize=8)  # fmt: skip
        axes.set_xscale("log")
        drawn = [max(100 * error, SMALLEST) for pair in errors.values() for error in pair] or [1, 100]
        band = 100 * (of_reference or 0)
        low = (
            min(drawn) * (min(drawn) / max(*drawn, 10 * min(drawn))) ** 0.25
        )  # room for the figure beside the first point
        if band > SMALLEST:
            low = min(low, band / 2)
            axes.axvspan(low, band, color="grey", alpha=0.25, linewidth=0)
        axes.set_xlim(low, 2 * max(*drawn, band))
        number_logarithmic(axes.xaxis)
        axes.set_yticks(range(len(errors)), [label_of(name) for name in errors])
        axes.set_ylim(max(len(errors), 1) - 0.5, -0.5)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("displacement error (%)")

    return Plot((7, 0.8 + 0.3 * max(len(errors), 1)), draw)


def plot_errors_over_surface(errors: dict[str, Array], areas: Array, labels: dict[str, str]) -> str:
    """A curve for every method: the share of the surface on which it errs by more than what stands below, over the scale of
    errors.

    errors: method -> error (%) at each vertex; areas: of the vertices (m2); labels: of the methods.
    """
    figure = Figure(figsize=(7, 2.6))
    axes = figure.subplots()
    for name, values in errors.items():
        if values.max() <= LEAST:
            continue  # its curve would lie on the axis
        order = np.argsort(values)
        worse = 100 * (1 - np.cumsum(areas[order]) / areas.sum())
        colour, marker = style_of(name)
        axes.plot(
            np.maximum(values[order], LEAST),
            worse,
            color=colour,
            marker=marker,
            markevery=0.25,
            label=labels[name],
        )
    axes.set_xscale("log")
    axes.set_xlim(LEAST, max(MOST, *(values.max() for values in errors.values())))
    axes.set_ylim(0, 100)
    for mark in MARKS:
        axes.axvline(mark, color="black", linewidth=1)
    number_logarithmic(axes.xaxis)
    axes.set_xlabel("displacement error (%)")
    axes.set_ylabel("surface that errs\nby more (%)")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    return svg_of(figure)


def plot_times(seconds: dict[str, dict[str, float]]) -> Plot:
    """A bar of seconds for every method, its stages stacked, with their sum.

    seconds: method -> stage -> s.
    """
    stages = [
        *_STAGES,
        *{stage for by_stage in seconds.values() for stage in by_stage if stage not in _STAGES},
    ]

    def draw(figure: FigureBase) -> None:
        axes = figure.subplots()
        labels, ends = [label_of(method) for method in seconds], np.zeros(len(seconds))
        for stage in stages:
            parts = np.array([by_stage.get(stage, 0) for by_stage in seconds.values()])
            if parts.any():
                axes.barh(labels, parts, 0.7, left=ends, color=_STAGES.get(stage, "#888888"), label=stage)
                ends += parts
        for row, end in enumerate(ends):
            axes.annotate(
                wording_of(end), (end, row), (3, 0), textcoords="offset points", va="center", fontsize=8
            )
        axes.set_xlim(0, 1.15 * max(ends.max(initial=0), 1e-9))
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("wall-clock time (s)")
        figure.legend(loc="outside upper left", ncols=4)

    return Plot((7, 1.5 + 0.3 * len(seconds)), draw)
