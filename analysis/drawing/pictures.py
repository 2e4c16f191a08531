"""Pictures of surfaces, drawn without a screen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyvista as pv

from ..compare import deformation, vertex_areas
from ..runs import Array, Frame

_VISIBLE = 0.08  # of the bounding box's diagonal: smaller displacements are drawn larger
_VIEW = (0.7, 0.45, 1.0)  # from where the camera looks, y up
_PANEL = (500, 560)  # pixels
_ROOM = (0.9, 0.66)  # of a panel's width and height, left to the body by title and colour bar


def surface_of(X: Array, F: Array) -> pv.PolyData:
    """A pyvista mesh of the triangles F over the points X."""
    return pv.PolyData.from_regular_faces(X, F)


def magnification(X: Array, u: Array) -> float:
    """Round factor by which a displacement is enlarged in a picture: 1 where it can be seen as it is."""
    wanted = _VISIBLE * np.linalg.norm(np.ptp(X, axis=0)) / np.linalg.norm(u, axis=1).max()
    if wanted <= 1:
        return 1.0
    power = 10 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1, 2, 5) if step * power <= wanted))


def _view_axes() -> Array:
    """Rows: to the right, up and towards the camera."""
    towards = np.array(_VIEW) / np.linalg.norm(_VIEW)
    right = np.cross((0, 1, 0), towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def seen_size(points: Array) -> tuple[float, float]:
    """Width and height (m) of the points as the camera sees them."""
    width, height, _ = np.ptp(points @ _view_axes().T, axis=0)
    return float(width), float(height)


def aim(
    camera: pv.Camera, points: Array, panel: tuple[int, int] = _PANEL, room: tuple[float, float] = _ROOM
) -> None:
    """Parallel view along _VIEW in which all points fill that share of the panel's (pixels) width or height."""
    axes = _view_axes()
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height, depth = high - low
    camera.parallel_projection = True
    camera.parallel_scale = max(height / room[1], width / room[0] * panel[1] / panel[0]) / 2
    below_middle = 0.04 if room == _ROOM else 0
    camera.focal_point = (low + high) / 2 @ axes - below_middle * camera.parallel_scale * axes[1]
    camera.position = camera.focal_point + 2 * (depth + camera.parallel_scale) * axes[2]
    camera.up = (0, 1, 0)
    camera.clipping_range = (1e-3 * camera.parallel_scale, 10 * (depth + camera.parallel_scale))


def draw_comparison(file: Path, springs: Frame, reference: Frame, is_free: bool, label: str) -> None:
    """Draws both deformed surfaces side by side and the error painted on the rest shape (PNG).

    Both are coloured by displacement on one scale; the error is given in % of the root mean square of the reference's
    displacement, as displacement_error. Rigid motion is removed where the body is free.
    """
    X, F = reference.X, reference.F
    u, u_reference = (deformation(frame, is_free) for frame in (springs, reference))
    factor = magnification(X, u_reference)
    length, length_reference = (np.linalg.norm(field, axis=1) for field in (u, u_reference))
    mean_square = np.average(length_reference**2, weights=vertex_areas(X, F))
    error = 100 * np.linalg.norm(u - u_reference, axis=1) / np.sqrt(mean_square)

    enlarged = "" if factor == 1 else f", drawn {factor:g} x"
    panels = (
        (f"finite elements{enlarged}", X + factor * u_reference, length_reference, "displacement (m)"),
        (f"{label}{enlarged}", X + factor * u, length, "displacement (m) "),
        ("error on the shape at rest", X, error, "error (% of mean displacement)"),
    )
    plotter = pv.Plotter(off_screen=True, shape=(1, 3), window_size=[3 * _PANEL[0], _PANEL[1]], border=False)
    shown = np.vstack([X, *(points for _, points, _, _ in panels)])
    for column, (title, points, values, unit) in enumerate(panels):
        is_error = column == 2
        plotter.subplot(0, column)
        plotter.add_mesh(
            surface_of(points, F),
            scalars=values,
            cmap="inferno" if is_error else "viridis",
            ambient=0.3,
            clim=(0, max(error.max(), 1e-12) if is_error else max(length.max(), length_reference.max())),
            scalar_bar_args={
                "title": unit,
                "n_labels": 2,
                "fmt": "{:.3g}",
                "color": "black",
                "title_font_size": 17,
                "label_font_size": 15,
                "position_x": 0.15,
                "width": 0.7,
            },
        )
        if not is_error:
            plotter.add_mesh(surface_of(X, F), color="grey", opacity=0.2)
        plotter.add_text(title, font_size=10, color="black", position="upper_edge")
        aim(plotter.camera, shown)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(file)
    plotter.close()
