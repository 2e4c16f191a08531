"""A plate with round holes as CAD exports it: flat faces in as few triangles as their outlines need, which are needles."""

from __future__ import annotations

import mapbox_earcut
import numpy as np


def plate(n_holes: int = 4, n_around: int = 48, side: float = 100.0, thickness: float = 5.0):
    """X (n, 3) and F (m, 3) of a square plate of n_holes by n_holes round holes, closed and oriented outward."""
    turn = -2 * np.pi * np.arange(n_around) / n_around
    pitch = side / n_holes
    rings = [np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=float)]
    for i in range(n_holes):
        for j in range(n_holes):
            middle = [(i + 0.5) * pitch, (j + 0.5) * pitch]
            rings.append(middle + 0.3 * pitch * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    flat = np.vstack(rings)
    n = len(flat)
    ends = np.cumsum([len(ring) for ring in rings])
    top = mapbox_earcut.triangulate_float64(flat, ends.astype(np.uint32)).reshape(-1, 3).astype(int)
    a, b, c = flat[top].transpose(1, 0, 2)
    is_turned = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    top[is_turned] = top[is_turned][:, ::-1]
    walls = []
    for end, ring in zip(ends, rings, strict=True):
        here = np.arange(end - len(ring), end)
        after = np.roll(here, -1)
        walls += [np.stack([here, after, after + n], axis=1), np.stack([here, after + n, here + n], axis=1)]
    X = np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (0.0, thickness)])
    return X, np.vstack([top[:, ::-1], top + n, *walls])


def plate_volume(n_holes: int = 4, n_around: int = 48, side: float = 100.0, thickness: float = 5.0) -> float:
    """Of its polygons, in closed form."""
    radius = 0.3 * side / n_holes
    hole = n_around / 2 * radius**2 * np.sin(2 * np.pi / n_around)
    return thickness * (side**2 - n_holes**2 * hole)
