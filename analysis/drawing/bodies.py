"""Bodies of a comparison side by side: all from one place, in one light, on the one scale of error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv
from PIL import Image

from ..compare import Free, deformation, displacement_at, root_mean_square, volume
from ..runs import Array, Frame, Run
from .error_scale import CLAY, COLOURS, POWERS, powers_of
from .pictures import LOOK, add_outline, aim, floor_of, panel_of, skin_of, stage, surface_of, view_axes


@dataclass(frozen=True)
class Body:
    """A deformed body of a picture: points at rest X (n, 3) in m, triangles F, displacement u (n, 3) in m.

    error: of every point, in %; None: of the reference, which is drawn in clay. inside: the cut through its cells with
    their displacement "u", where it is drawn cut open.
    """

    X: Array
    F: Array
    u: Array
    error: Array | None = None
    inside: pv.PolyData | None = None


def bodies_of(run: Run, reference: Run, time: float, is_free: Free, is_cut: bool) -> tuple[Body, Body]:
    """The reference's body and the run's at a time, without rigid motion where they are free.

    The error is given in % of the root mean square of the reference's displacement, of a motion over all of it.
    """
    X, F = reference.last.X, reference.last.F
    frames = [Frame(r.last.X, displacement_at(r, time), F) for r in (reference, run)]
    u_reference, u = (deformation(frame, is_free) for frame in frames)
    error = 100 * np.linalg.norm(u - u_reference, axis=1) / root_mean_square(reference, is_free, time)
    cuts = [
        _cut(r, time, X, frame.u - moved) if is_cut else None
        for r, frame, moved in zip((reference, run), frames, (u_reference, u), strict=True)
    ]
    return Body(X, F, u_reference, inside=cuts[0]), Body(X, F, u, error, cuts[1])


def _cut(run: Run, time: float, X: Array, rigid: Array) -> pv.PolyData | None:
    """The run's tetrahedra where the plane of the cut meets them at rest; None for a run of springs without any.

    rigid: of the surface's vertices at rest X, what was taken off their displacement (n, 3).
    """
    grid = run.grid(int(np.argmin(np.abs(run.times - time))))
    solids = [kind for kind in (pv.CellType.TETRA, pv.CellType.QUADRATIC_TETRA) if kind in grid.cells_dict]
    if not solids:
        return None
    (kind,) = solids
    u = np.asarray(grid["displacement"], dtype=float)
    points = np.asarray(grid.points, dtype=float) - u
    linear, *_ = np.linalg.lstsq(np.column_stack([X, np.ones(len(X))]), rigid, rcond=None)
    solid = pv.UnstructuredGrid({pv.CellType.TETRA: grid.cells_dict[kind][:, :4]}, points)
    solid["u"] = u - np.column_stack([points, np.ones(len(points))]) @ linear
    origin, normal = cut_plane(X)
    return solid.slice(normal=normal, origin=origin)


def has_cavity(X: Array, F: Array) -> bool:
    """Whether a shell of the surface lies inside another, so that much is seen only where the body is cut open."""
    parts = surface_of(X, F).connectivity("all")
    labels = np.asarray(parts.cell_data["RegionId"])
    return any(volume(X, F[labels == label]) < 0 for label in np.unique(labels))


def cut_plane(X: Array) -> tuple[Array, Array]:
    """Origin and normal of the cut that takes away what is nearest to the camera: upright, through the middle."""
    towards = view_axes()[2] * (1, 0, 1)
    return (X.min(axis=0) + X.max(axis=0)) / 2, towards / np.linalg.norm(towards)


def shown(bodies: Sequence[Body], factor: float) -> Array:
    """Points that a picture holds: all of the first body, and of others what stays within its size of it."""
    first = bodies[0]
    points = np.vstack([first.X, first.X + factor * first.u])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.25 * np.linalg.norm(high - low)
    others = [np.clip(body.X + factor * body.u, low - room, high + room) for body in bodies[1:]]
    return np.vstack([points, *others])


def draw_bodies(files: Sequence[Path], bodies: Sequence[Body], factor: float) -> None:
    """Draws each body into its file (PNG), all seen from the same place.

    Displacements are drawn factor times as large. The body at rest is an outline.
    """
    visible = shown(bodies, factor)
    floor = floor_of(bodies[0].X, bodies[0].u, visible)
    if floor:
        shadows = [floor.shadow_of(body.X + factor * body.u) for body in bodies]
        visible = np.vstack([visible, *shadows])
    panel = panel_of(visible)
    for number, (file, body) in enumerate(zip(files, bodies, strict=True)):
        plotter = stage(panel)
        if floor:
            floor.add_to(plotter)
            plotter.add_mesh(surface_of(shadows[number], body.F), color="#b9bcc2", lighting=False)
        add_body(plotter, body, factor)
        add_outline(plotter, body.X, body.F)
        aim(plotter.camera, visible, panel)
        plotter.screenshot(file)
        plotter.close()


def add_body(plotter: pv.Plotter, body: Body, factor: float) -> None:
    """The body in the colours of its errors, its displacement drawn factor times as large."""
    skin = skin_of(body.X, body.F)
    mesh = skin.mesh
    mesh["u"] = body.u[skin.ids]
    if body.error is not None:
        mesh["error"] = powers_of(body.error[skin.ids])
    skin.move(body.X + factor * body.u)
    if body.inside is not None:
        origin, normal = cut_plane(body.X)
        mesh["side"] = (body.X[skin.ids] - origin) @ normal
        mesh = mesh.clip_scalar(scalars="side", value=0.0)
        cut = body.inside.copy()
        cut.points = cut.points + factor * cut["u"]
        plotter.add_mesh(cut, color=CLAY, show_edges=True, edge_color="#8d939c", line_width=0.5, ambient=0.5)
    add_painted(plotter, mesh)


def add_painted(plotter: pv.Plotter, mesh: pv.PolyData) -> None:
    """A mesh in the colours of its "error", powers of ten of %, or else in clay."""
    if "error" not in mesh.point_data:
        plotter.add_mesh(mesh, color=CLAY, **LOOK)
    else:
        plotter.add_mesh(mesh, scalars="error", cmap=COLOURS, clim=POWERS, show_scalar_bar=False, **LOOK)


def draw_thumbnail(file: Path, pictures: Sequence[Path], height: int = 200) -> None:
    """Puts pictures side by side, small (JPEG)."""
    parts = [Image.open(picture).convert("RGB") for picture in pictures]
    parts = [part.resize((round(part.width * height / part.height), height)) for part in parts]
    page = Image.new("RGB", (sum(part.width for part in parts), height), "white")
    left = 0
    for part in parts:
        page.paste(part, (left, 0))
        left += part.width
    page.save(file, quality=85, optimize=True)
