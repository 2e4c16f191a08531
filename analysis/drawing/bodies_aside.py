"""Deformed bodies side by side, to be turned in a session or drawn into a file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from ..wording import significant
from .bodies import Body, add_body, shown
from .error_scale import TICKS, powers_of
from .pictures import aim, light, magnification


def bodies_aside(bodies: dict[str, Body], **options: Any) -> pv.Plotter:
    """A panel for every body (title -> body), in the light and the colours of a report's pictures, turned together.

    Displacements are enlarged alike, as the first body needs it. options: of pyvista's Plotter.
    """
    first = next(iter(bodies.values()))
    factor = magnification(first.X, first.u)
    plotter = pv.Plotter(shape=(1, len(bodies)), lighting="none", **options)
    plotter.set_background("white", all_renderers=True)
    points = shown(list(bodies.values()), factor)
    light(plotter)
    for place, (name, body) in enumerate(bodies.items()):
        plotter.subplot(0, place)
        title = name if factor == 1 else f"{name}, {factor:g} times enlarged"
        plotter.add_text(title, font_size=10, color="black")
        add_body(plotter, body, factor)
        if body.error is not None:
            plotter.mapper.lookup_table.annotations = {
                float(power): significant(tick)
                for power, tick in zip(powers_of(np.array(TICKS)), TICKS, strict=True)
            }
            plotter.add_scalar_bar(
                "error (%)", n_labels=0, color="black", vertical=True, height=0.5, position_y=0.25
            )
        aim(plotter.camera, points)
    plotter.link_views()
    return plotter
