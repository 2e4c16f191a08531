"""What a race of methods shows: fronts, crossovers, who is cheapest at which error and by how much, in tables and words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..drawing.plots import SMALLEST
from ..drawing.style import number_logarithmic, style_of, svg_of
from ..front import pareto, seconds_for
from ..methods import ELEMENTS, label_of
from ..report import Table
from ..wording import percent, significant
from ..wording import seconds as seconds_in_words
from .race import Measurement, SceneStudy
from .result import Figures, Section

ERRORS = (0.1, 0.03, 0.01, 0.003, 0.001)  #: at which methods are compared
_USABLE = 0.3  # what is further off is no answer, however fast
_LEVEL = 1.1  # ratios within which two methods count as equally fast

Curves = dict[str, list[tuple[float, float]]]


def curves_of(measurements: Iterable[Measurement]) -> Curves:
    """Method -> (seconds, error) of its good rungs."""
    curves: Curves = {}
    for m in measurements:
        if m.proven is not None:
            curves.setdefault(m.method.name, []).append((m.whole, m.proven))
    return curves


def winners(curves: Curves) -> list[tuple[str, float, float]]:
    """Which method is the fastest at which errors, from _USABLE down: (method, from, down to), largest errors first."""
    errors = [error for curve in curves.values() for _, error in curve]
    if not errors:
        return []
    parts: list[tuple[str, float, float]] = []
    for error in np.geomspace(max(min(max(errors), _USABLE), min(errors)), min(errors), 400):
        known = {
            name: s
            for name, curve in curves.items()
            if (s := seconds_for(curve, error * (1 + 1e-9))) is not None
        }
        best = min(known, key=lambda name: known[name])
        if parts and parts[-1][0] == best:
            parts[-1] = (best, parts[-1][1], error)
        else:
            parts.append((best, error, error))
    return parts


def crossovers(curves: Curves) -> str:
    """Who is the fastest where, in a sentence."""
    parts = winners(curves)
    if not parts:
        return "No method gave a result."
    if len(parts) == 1:
        return f"{label_of(parts[0][0])} is the fastest at every error reached."
    words = [f"{label_of(name)} down to {percent(low, 2)}" for name, _, low in parts]
    return f"The fastest is {', then '.join(words)}."


Best = tuple[float, str] | None


def best_of(curves: Curves, error: float, elements: Sequence[str] = ELEMENTS) -> tuple[Best, Best]:
    """Seconds and name of the cheapest springs and of the cheapest elements at an error; None of who does not reach it."""
    sides = [
        {name: curve for name, curve in curves.items() if (name in elements) == is_element}
        for is_element in (False, True)
    ]
    springs, fem = (
        min(
            ((s, name) for name, curve in side.items() if (s := seconds_for(curve, error)) is not None),
            default=None,
        )
        for side in sides
    )
    return springs, fem


LEVELS = (
    "The cheapest of either side whose error is no larger than asked for, between measured rungs by interpolation. Seconds "
    "are meshing, set-up and solution on one thread. The last column is the springs' seconds over the elements': above 1 the "
    "springs lose."
)


def levels(studies: Sequence[SceneStudy]) -> Table:
    """Head and rows: every scene at every error that a side reaches."""
    head = ["regime", "scene", "error", "springs", "seconds", "elements", "seconds", "springs / elements"]
    rows = []
    for scene in studies:
        curves = curves_of(scene.measurements)
        for error in ERRORS:
            best = best_of(curves, error)
            if not any(best):
                continue
            cells = [
                cell for side in best for cell in ((label_of(side[1]), seconds_in_words(side[0])) if side else ("-", "-"))
            ]  # fmt: skip
            ratio = significant(best[0][0] / best[1][0], 2) if best[0] and best[1] else "-"
            rows.append([scene.regime, scene.name, percent(error), *cells, ratio])
    return head, rows


class Tally(NamedTuple):
    """Of a regime: where springs lose and win by how much (seconds of the slower over the faster, scene and error); how often
    both are level."""

    regime: str
    lost: list[tuple[float, str]]
    won: list[tuple[float, str]]
    level: int

    @property
    def n(self) -> int:
        return len(self.lost) + len(self.won) + self.level


def tallies(studies: Sequence[SceneStudy]) -> list[Tally]:
    """Of every regime in which a side reaches an error."""
    found: dict[str, Tally] = {}
    for scene in studies:
        lost, won, level = found.get(scene.regime, Tally(scene.regime, [], [], 0))[1:]
        curves = curves_of(scene.measurements)
        for error in ERRORS:
            springs, elements = best_of(curves, error)
            if not (springs or elements):
                continue
            ratio = springs[0] / elements[0] if springs and elements else np.inf if elements else 0.0
            where = f"{scene.name} at {percent(error)}"
            if ratio > _LEVEL:
                lost.append((ratio, where))
            elif ratio < 1 / _LEVEL:
                won.append((1 / ratio if ratio else np.inf, where))
            else:
                level += 1
        found[scene.regime] = Tally(scene.regime, lost, won, level)
    return [tally for tally in found.values() if tally.n]


def finding(studies: Sequence[SceneStudy]) -> str:
    """Where springs lose, then where they win, at equal accuracy: scene and largest ratio, regime by regime."""
    sentences = [
        f"{t.regime.capitalize()}: springs lose {len(t.lost)} of {t.n} comparisons{_most(t.lost)}, "
        f"win {len(t.won)}{_most(t.won)} and are level in {t.level}."
        for t in tallies(studies)
    ]
    return " ".join(sentences) or "No method gave a result."


def regimes(studies: Sequence[SceneStudy]) -> Table:
    """Head and rows: what the finding tells."""
    head = ["regime", "comparisons", "springs lose", "by up to", "springs win", "by up to", "level"]
    rows = []
    for t in tallies(studies):
        lost, won = (_most(pairs).strip(" ()").removeprefix("by up to ") or "-" for pairs in (t.lost, t.won))
        rows.append([t.regime, str(t.n), str(len(t.lost)), lost, str(len(t.won)), won, str(t.level)])
    return head, rows


def _most(pairs: list[tuple[float, str]]) -> str:
    """(Of ratio and place) the largest ratio, in brackets."""
    known = [pair for pair in pairs if np.isfinite(pair[0])]
    if not known:
        return " (the other does not get there)" if pairs else ""
    ratio, where = max(known)
    return f" (by up to {significant(ratio, 2)} times: {where})"


def section(scene: SceneStudy) -> Section:
    """Words, fronts and every measurement of a scene."""
    curves = curves_of(scene.measurements)
    figures: Figures = {f"{scene.name}_work_precision": (plot(scene), CAPTION)} if curves else {}
    tables = {scene.name: table(scene)}
    if scene.tolerances:
        rows = [[label_of(method.name), f"{100 * change:+.2f} %"] for method, change in scene.tolerances]
        tables[f"{scene.name}_tolerances"] = (["residual of a hundredth changes", "the error by"], rows)
    words = [crossovers(curves), noise(scene.measurements)]
    return Section(f"{scene.regime}: {scene.name}", words, figures, tables)


def plot(scene: SceneStudy) -> str:
    """Error over the seconds of the whole, over those of the solution alone, and over those of two threads where measured."""
    known = [m for m in scene.measurements if m.error is not None]
    band = max((m.reference_error or 0 for m in known), default=0)
    titles = ["meshing, set-up and solution", "solution alone"]
    if any(m.seconds_on_two_threads > 0 for m in known):
        titles.append("the whole on two threads")
    figure = Figure(figsize=(4 * len(titles), 6), layout="constrained")
    axes: list[Axes] = list(figure.subplots(1, len(titles), sharey=True))
    for axis, title in zip(axes, titles, strict=True):
        for method in dict.fromkeys(m.method for m in known):
            rungs = [m for m in known if m.method == method and (axis not in axes[2:] or m.two_threads)]
            if rungs:
                _draw(axis, rungs, [_seconds(m, axes.index(axis)) for m in rungs])
        axis.set_xscale("log")
        axis.set_yscale("log")
        if band > 0:
            low = max(min(100 * m.error for m in known), SMALLEST)  # type: ignore[operator]
            axis.axhspan(min(low, 100 * band) / 2, 100 * band, color="grey", alpha=0.2, linewidth=0)
            axis.set_ylim(bottom=min(low, 100 * band) / 2)
        number_logarithmic(axis.xaxis, axis.yaxis)
        axis.set_xlabel(f"seconds: {title}")
    axes[0].set_ylabel("displacement error (%)")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        fontsize=7,
        loc="outside lower left",
        ncols=len(titles),
        handlelength=3,
    )
    figure.suptitle(scene.name, fontsize=11)
    return svg_of(figure)


def _seconds(m: Measurement, panel: int) -> list[float]:
    if panel == 2 and m.two_threads:
        return [m.seconds_on_two_threads]
    return m.seconds(*(("solve",) if panel == 1 else ()))


def _draw(axis: Axes, rungs: list[Measurement], seconds: list[list[float]]) -> None:
    """A method's rungs: medians, bars over all draws, a line along its front."""
    method = rungs[0].method
    colour, marker = style_of(method.model)
    x = np.array([[median(s), min(s), max(s)] for s in seconds]).T
    y = np.array([[m.error, min(m.errors), max(m.errors)] for m in rungs], dtype=float).T
    y = np.maximum(100 * y, SMALLEST)
    axis.errorbar(
        x[0], y[0], xerr=[x[0] - x[1], x[2] - x[0]], yerr=[y[0] - y[1], y[2] - y[0]],
        color=colour, linestyle="none", elinewidth=1,
    )  # fmt: skip
    front = pareto(list(zip(x[0], y[0], strict=True)))
    axis.plot(x[0][front], y[0][front], color=colour, linestyle=method.line)
    axis.plot([], [], marker, color=colour, linestyle=method.line, markersize=4, label=label_of(method.name))
    filled = np.array([m.is_resolved for m in rungs])
    for part, face in ((filled, colour), (~filled, "white")):
        axis.plot(x[0][part], y[0][part], marker, markersize=4, markerfacecolor=face, markeredgecolor=colour)


CAPTION = (
    "Error over seconds: medians, bars over all seeds and repetitions, lines along each method's front. Down and to the left is "
    "better. Grey: the largest estimated error of the references; a hollow marker lies within twice the reference's own."
)


def table(scene: SceneStudy) -> Table:
    """Head and rows, every measurement of the scene."""
    head = [
        "method", "vertices", "step (s)", "target", "nodes", "runs", "error", "from", "to", "volume error", "of reference",
        "mesh (s)", "set-up (s)", "solve (s)", "whole (s)", "from (s)", "to (s)", "memory (MB)", "",
    ]  # fmt: skip
    rows = []
    for m in scene.measurements:
        words = dict(word.split("=") for word in scene.overrides(m.rung))
        step = significant(float(words["time.step"])) if "time.step" in words else "-"
        target = percent(m.rung.target) if m.rung.target else "-"
        where = [label_of(m.method.name), words["surface.n_vertices"], step, target]
        if not m.outcomes:
            rows.append([*where, *["-"] * 14, m.message])
            continue
        seconds, errors = m.seconds(), m.errors or [float("nan")]
        volume = percent(median(m.volume_errors) if m.volume_errors else None)
        stages = [median(m.seconds(*s)) for s in (("mesh",), ("adapt", "setup", "assemble"), ("solve",), ())]
        rows.append(
            [
                *where, str(m.outcomes[0].record["n_nodes"]), str(len(m.outcomes)), percent(m.error), percent(min(errors)),
                percent(max(errors)), volume, percent(m.reference_error), *map(significant, stages),
                significant(min(seconds)), significant(max(seconds)), f"{m.memory / 1e6:.0f}",
                m.message or ("" if m.timed else "shared a core"),
            ]
        )  # fmt: skip
    return head, rows


def noise(measurements: Iterable[Measurement]) -> str:
    """How far the timed runs had the machine for themselves, in words."""
    rungs = [m for m in measurements if m.outcomes]
    n_runs = sum(len(m.outcomes) for m in rungs)
    n_shared = n_runs - sum(len(m.timed) for m in rungs)
    if not n_shared:
        return "Every timed run had a core for itself."
    return (
        f"{n_shared} of {n_runs} timed runs waited for a core or a disk more than a tenth of their time, three times over, and "
        f"are left out; {sum(not m.timed for m in rungs)} rungs have no others."
    )
