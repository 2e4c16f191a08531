"""Deformed bodies side by side, to be turned in a session or drawn into a file."""

from __future__ import annotations

from typing import Any

import pyvista as pv

from ..runs import Array
from ..wording import unit_of_length
from .pictures import magnification, surface_of


def bodies_aside(
    X: Array, F: Array, displacements: dict[str, Array], error: Array | None, **options: Any
) -> pv.Plotter:
    """A panel for every displacement (title -> (n, 3) in m) of the surface X, F, the last painted with the error (n,), in m.

    Displacements are enlarged alike, as the first needs it. options: of pyvista's Plotter.
    """
    factor = magnification(X, next(iter(displacements.values())))
    plotter = pv.Plotter(shape=(1, len(displacements)), **options)
    for place, (name, u) in enumerate(displacements.items()):
        plotter.subplot(0, place)
        body = surface_of(X + factor * u, F)
        plotter.add_text(name if factor == 1 else f"{name}, {factor:g} times enlarged", font_size=10)
        if error is not None and place == len(displacements) - 1:
            unit, size = unit_of_length(float(error.max()))
            bar = {"title": f"difference ({unit})", "n_labels": 3, "fmt": "%.3g"}
            plotter.add_mesh(body, scalars=error / size, scalar_bar_args=bar)
        else:
            plotter.add_mesh(body, color="lightgrey")
    plotter.link_views()
    plotter.view_vector((0.7, 0.45, 1), viewup=(0, 1, 0))
    return plotter
