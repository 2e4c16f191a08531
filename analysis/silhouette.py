"""What a body hides of the background, seen from afar."""

from __future__ import annotations

import numpy as np
import shapely

from .runs import Array

_GRID = (
    1e-10  # of the body's size, which corners snap to: without it slivers of folds may give an invalid union
)
_SLIT = 1e-9  # of the square of the body's size: smaller holes are rounding between triangles


def silhouette(X: Array, F: Array, axes: Array) -> shapely.MultiPolygon:
    """The polygons (m), holes included, that a closed surface covers in parallel projection.

    X: points (n, 3) in m; F: triangles (m, 3); axes: rows to the right, up and towards the eye, orthonormal.
    """
    P = X @ axes.T
    # Whatever ray meets a closed surface enters it somewhere, through a triangle that faces the eye.
    a, b, c = (P[F[:, k]] for k in range(3))
    is_seen = np.cross(b - a, c - a)[:, 2] > 0
    size = float(np.ptp(P, axis=0).max())
    covered = shapely.union_all(shapely.polygons(P[F[is_seen]][:, :, :2]), grid_size=_GRID * size)
    least = _SLIT * size**2
    return shapely.multipolygons(
        [
            shapely.Polygon(
                part.exterior, [hole for hole in part.interiors if shapely.Polygon(hole).area > least]
            )
            for part in shapely.get_parts(covered)
            if part.area > least
        ]
    )
