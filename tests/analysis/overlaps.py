"""What covers what in a plot: texts each other, and legends the curves."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.transforms import Bbox

_SLACK = 1.0  # pixels that boxes may share: letters do not fill them


def overlaps(figure: Figure) -> list[str]:
    """Texts that share pixels or, of a figure with a layout, lie beyond it; curves and bars below a legend; in words."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    hidden = {
        label
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in {*axis.get_major_ticks(), *axis.get_minor_ticks()} - set(axis._update_ticks())
        for label in (tick.label1, tick.label2)
    }  # ticks outside of the limits
    texts = {
        text: text.get_window_extent(renderer)
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and text not in hidden
    }
    whole = figure.bbox.padded(_SLACK)
    found = [
        f"'{text.get_text()}' beyond the figure"
        for text, box in texts.items()
        if figure.get_layout_engine()
        and not (whole.contains(box.x0, box.y0) and whole.contains(box.x1, box.y1))
    ]
    found += [
        f"'{a.get_text()}' and '{b.get_text()}'"
        for (a, box), (b, other) in combinations(texts.items(), 2)
        if _shared(box, other)
    ]
    for legend in figure.findobj(Legend):
        box = legend.get_window_extent(renderer)
        found += [f"legend and {what}" for axes in figure.axes for what in _below(axes, box)]
        own = set(legend.get_texts()) | {legend.get_title()}
        found += [
            f"legend and '{text.get_text()}'"
            for text, extent in texts.items()
            if text not in own and _shared(box, extent)
        ]
    return found


def _shared(a: Bbox, b: Bbox) -> bool:
    return min(a.x1, b.x1) - max(a.x0, b.x0) > _SLACK and min(a.y1, b.y1) - max(a.y0, b.y0) > _SLACK


def _below(axes, box: Bbox) -> list[str]:
    names = []
    for line in axes.lines:
        points = line.get_transform().transform(np.column_stack(line.get_data()).astype(float))
        points = points[np.isfinite(points).all(axis=1)]
        dense = [np.linspace(a, b, 50) for a, b in pairwise(points)] if len(points) > 1 else [points]
        inside = box.padded(-_SLACK)
        if any(inside.contains(x, y) for part in dense for x, y in part) and line.get_linestyle() != "None":
            names.append(f"'{line.get_label()}'")
    names += [
        f"bar {patch.get_label()}"
        for patch in axes.patches
        if patch.get_width() and _shared(box, patch.get_window_extent())
    ]
    return names
