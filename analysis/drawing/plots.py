"""Plots of a comparison, as SVG text."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..methods import REFERENCE, label_of
from ..runs import Array
from .style import style_of, svg_of

Curve = tuple[Array, Array]
SMALLEST = 1e-9  # error drawn (%): below lies rounding


def plot_volume(curves: dict[str, Curve], time_label: str) -> str:
    """Volume curves, with their difference from the reference, where there is one, below.

    curves: method -> times and dV/V0.
    """
    figure = Figure(figsize=(7, 5.2 if REFERENCE in curves else 3.5))
    if REFERENCE in curves:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        times_ref, change_ref = curves[REFERENCE]
    else:
        above = figure.subplots()
    for method, (times, change) in curves.items():
        colour, marker = style_of(method)
        shape = {"color": colour, "marker": marker, "markersize": 5, "linewidth": 1.6}
        if method == REFERENCE:  # below the others, and seen behind a curve that meets it
            shape |= {"markersize": 8, "linewidth": 3, "zorder": 1}
        if len(times) > 25:
            shape["markevery"] = len(times) // 12
        above.plot(times, 100 * change, label=label_of(method), **shape)
        if method != REFERENCE and REFERENCE in curves:
            difference = np.interp(times_ref, times, change) - change_ref
            below.plot(times_ref, 100 * difference, **(shape | {"markevery": None}))
    above.set_ylabel("volume change (% of volume)")
    above.legend()
    if REFERENCE not in curves:
        above.set_xlabel(time_label)
        return svg_of(figure)
    below.axhline(0, color=style_of(REFERENCE).colour, linewidth=1)
    below.set_ylabel("difference\n(% of volume)")
    below.set_xlabel(time_label)
    figure.align_ylabels()
    return svg_of(figure)


def plot_errors(errors: dict[str, float], of_reference: float | None) -> str:
    """A bar for the relative displacement error of every method, with a band up to the reference's own (if it is known)."""
    figure = Figure(figsize=(7, 0.8 + 0.3 * len(errors)))
    axes = figure.subplots()
    values = [max(100 * error, SMALLEST) for error in errors.values()]
    bars = axes.barh(
        [label_of(name) for name in errors], values, color=[style_of(name).colour for name in errors]
    )
    axes.bar_label(bars, [f"{value:.3g}" for value in values], padding=2, fontsize=8)
    axes.set_xscale("log")
    axes.margins(x=0.1)
    if not errors:
        axes.set_xlim(1, 100)  # a logarithmic axis without bars would start below zero
    axes.set_xlim(left=min(axes.get_xlim()[0], 50 * (of_reference or np.inf), min(values, default=1) / 2))
    if of_reference and 100 * of_reference > axes.get_xlim()[0]:
        axes.axvspan(axes.get_xlim()[0], 100 * of_reference, color="grey", alpha=0.25, linewidth=0)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("displacement error (%)")
    return svg_of(figure)


def plot_times(seconds: dict[str, dict[str, float]]) -> str:
    """Bars of seconds per stage and in total, on a logarithmic axis.

    seconds: method -> stage -> s.
    """
    stages = list(dict.fromkeys(stage for by_stage in seconds.values() for stage in by_stage))
    order = ["mesh", "setup", "assemble", "solve", "output"]
    stages.sort(key=lambda stage: order.index(stage) if stage in order else len(order))
    rows = [*stages, "total"]
    figure = Figure(figsize=(7, 0.6 + 0.24 * len(rows) * (len(seconds) + 1)))
    axes = figure.subplots()
    height = 1 / (len(seconds) + 1)
    for k, (method, by_stage) in enumerate(seconds.items()):
        times = [by_stage.get(stage, 0) for stage in stages]
        times.append(sum(times))
        at = np.arange(len(rows)) + (k - (len(seconds) - 1) / 2) * height
        bars = axes.barh(at, times, height, color=style_of(method).colour, label=label_of(method))
        axes.bar_label(bars, [f"{t:.3g}" if t > 0 else "" for t in times], padding=2, fontsize=8)
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), rows)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("wall-clock time (s)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    axes.margins(x=0.1)
    return svg_of(figure)
