"""Runs on two triangulations of one surface, put on the points of one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyvista as pv

from .runs import Array, Run, RunError, SurfacePoints

# Both programs keep the surface bit for bit, but a frame stores X + u and u, so that X comes back rounded.
_SAME_POINT = 1e-12  # of the bounding box
_SAME_SURFACE = 1e-6  # likewise, distances from triangles: files hold single precision


def nearest_points(surface: tuple[Array, Array], points: tuple[Array, Array]) -> tuple[SurfacePoints, Array]:
    """The point of a surface nearest to each of another's vertices, and how far off it lies (m).

    surface, points: vertices (n, 3) in m, and triangles.
    """
    (X, F), (P, G) = surface, points
    mesh = pv.PolyData.from_regular_faces(X, F)
    cells, nearest = mesh.find_closest_cell(P, return_closest_point=True)
    corners = F[cells]
    a, b, c = (X[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    squares = np.maximum((normals**2).sum(axis=1), 1e-300)
    opposite = [(c - b, nearest - b), (a - c, nearest - c), (b - a, nearest - a)]
    weights = np.stack(
        [(np.cross(edge, to) * normals).sum(axis=1) / squares for edge, to in opposite], axis=1
    )
    found = SurfacePoints(P, G, corners, weights)
    return found, np.linalg.norm(found.of(X) - P, axis=1)


def on_points_of(run: Run, reference: Run) -> Run:
    """The run with its frames at the vertices of the reference's surface, which may be another triangulation.

    Raises RunError where the two are not one surface.
    """
    a, b = run.last, reference.last
    size = np.ptp(b.X, axis=0).max()
    rounding = _SAME_POINT * size + 4 * np.finfo(float).eps * np.abs(b.X).max()
    if a.X.shape == b.X.shape and a.F.shape == b.F.shape and (a.F == b.F).all():
        distances = np.abs(a.X - b.X).max(axis=1)
        if distances.max() <= rounding:
            return run
    points, distances = nearest_points((a.X, a.F), (b.X, b.F))
    _, back = nearest_points((b.X, b.F), (a.X, a.F))
    farthest = max(distances.max(), back.max())
    if farthest > _SAME_SURFACE * size + rounding:
        raise RunError(
            f"{run.folder} and {reference.folder} are of different surfaces: {len(a.X)} vertices, {len(a.F)} triangles against "
            f"{len(b.X)} vertices, {len(b.F)} triangles, which lie {farthest:.3g} m apart"
        )
    return replace(run, points=points)
