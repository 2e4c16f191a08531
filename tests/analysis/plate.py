"""A plate with round holes, triangulated as CAD programs do it: from the holes to the corners, in needles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

Array = np.ndarray


def plate(n_holes: int = 2, n_sides: int = 1000, thickness: float = 0.1) -> tuple[Array, Array]:
    """A square plate of 1 m, with n_holes x n_holes drilled through. n_sides: of each hole, a multiple of 4.

    Returns points (n, 3) in m and triangles (m, 3), outward.
    """
    grid = np.arange(n_holes + 1)
    points = [(x / n_holes, y / n_holes) for x in grid for y in grid]
    angles = 2 * np.pi * np.arange(n_sides) / n_sides - 3 * np.pi / 4
    quarter = n_sides // 4
    top, walls = [], []

    def wall(a: int, b: int) -> None:
        walls.extend([(a, b, -b - 1), (a, -b - 1, -a - 1)])  # -i - 1: the point below i

    for x in range(n_holes):
        for y in range(n_holes):
            corner = [
                x * len(grid) + y,
                (x + 1) * len(grid) + y,
                (x + 1) * len(grid) + y + 1,
                x * len(grid) + y + 1,
            ]
            first = len(points)
            centre = np.array([x + 0.5, y + 0.5]) / n_holes
            points += list(centre + 0.45 / n_holes * np.column_stack([np.cos(angles), np.sin(angles)]))
            for k in range(n_sides):
                # The first side of a corner's quarter begins half a quarter before its diagonal.
                near = corner[((k + quarter // 2) // quarter) % 4]
                a, b = first + k, first + (k + 1) % n_sides
                top.append((near, b, a))
                following = corner[((k + 1 + quarter // 2) // quarter) % 4]
                if following != near:
                    top.append((near, following, b))
                wall(a, b)
    n = len(grid)
    for k in range(n_holes):
        wall((k + 1) * n, k * n)  # y = 0
        wall(k * n + n - 1, (k + 1) * n + n - 1)  # y = 1
        wall(k, k + 1)  # x = 0
        wall((n - 1) * n + k + 1, (n - 1) * n + k)  # x = 1
    flat = np.array(points)
    count = len(flat)
    sides = np.array(walls)
    sides = np.where(sides < 0, count - 1 - sides, sides)  # below: beyond those above
    above = np.array(top)
    X = np.concatenate([np.column_stack([flat, np.full(count, z)]) for z in (thickness, 0)])
    return X, np.concatenate([above, above[:, ::-1] + count, sides])


def write_off(file: Path, X: Array, F: Array) -> Path:
    rows = [" ".join(map(repr, map(float, x))) for x in X] + [f"3 {a} {b} {c}" for a, b, c in F]
    file.write_text(f"OFF\n{len(X)} {len(F)} 0\n" + "\n".join(rows) + "\n")
    return file
