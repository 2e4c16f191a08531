"""An octant of a ball, graded towards its centre: a half-space that is pressed there, with two planes of symmetry."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

_AXES = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])


def write_octant(file: Path, radius: float, core: float, edge: float) -> None:
    """The part x >= 0, y <= 0, z >= 0 of a ball about the origin as an OFF file.

    radius: of the ball; core: how far from the centre edges have the length `edge`; beyond they grow with the distance (m).
    """
    growth = 0.3
    radii = [0.0]
    while radii[-1] < radius:
        radii.append(radii[-1] + edge + growth * max(0, radii[-1] - core))
    radii = [r * radius / radii[-1] for r in radii]
    counts = [0] + [max(1, round(math.pi / 2 * r / (r - before))) for before, r in pairwise(radii)]
    points: list[np.ndarray] = []
    numbers: dict[tuple[int | str, ...], int] = {}
    triangles: list[tuple[int, int, int]] = []

    def vertex(key: tuple[int | str, ...], at: np.ndarray) -> int:
        if key not in numbers:
            numbers[key] = len(points)
            points.append(at)
        return numbers[key]

    def add(i: int, j: int, k: int, outward: np.ndarray) -> None:
        normal = np.cross(points[j] - points[i], points[k] - points[i])
        triangles.append((i, j, k) if normal @ outward > 0 else (i, k, j))

    def ring(a: int, b: int, k: int) -> list[int]:
        """Vertices of the k-th ring about the centre from axis a to axis b."""
        n = counts[k]
        if n == 0:
            return [vertex((), np.zeros(3))]
        inner = []
        for j in range(1, n):
            angle = j / n * math.pi / 2
            inner.append(
                vertex((a, b, k, j), radii[k] * (math.cos(angle) * _AXES[a] + math.sin(angle) * _AXES[b]))
            )
        return [vertex((a, k), radii[k] * _AXES[a]), *inner, vertex((b, k), radii[k] * _AXES[b])]

    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for k in range(len(radii) - 1):
            near, far = ring(a, b, k), ring(a, b, k + 1)
            n, m = len(near) - 1, len(far) - 1
            i = j = 0
            while i < n or j < m:
                if j < m and (i == n or (j + 1) * n <= (i + 1) * m):
                    add(near[i], far[j], far[j + 1], -_AXES[c])
                    j += 1
                else:
                    add(near[i], far[j], near[i + 1], -_AXES[c])
                    i += 1

    n, last = counts[-1], len(radii) - 1

    def on_ball(i: int, j: int, k: int) -> int:
        if k == 0:
            return ring(0, 1, last)[j]
        if i == 0:
            return ring(1, 2, last)[k]
        if j == 0:
            return ring(2, 0, last)[i]
        way = np.sin(np.pi / 2 / n * np.array([i, j, k]))
        return vertex(("ball", i, j), radius * way / np.linalg.norm(way) @ _AXES)

    for i in range(n):
        for j in range(n - i):
            k = n - i - j
            first, second, third = on_ball(i, j, k), on_ball(i + 1, j, k - 1), on_ball(i, j + 1, k - 1)
            add(first, second, third, outward=points[first])
            if k >= 2:
                add(second, on_ball(i + 1, j + 1, k - 2), third, outward=points[first])

    lines = ["OFF", f"{len(points)} {len(triangles)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in np.array(points).tolist()]
    lines += [f"3 {i} {j} {k}" for i, j, k in triangles]
    file.write_text("\n".join(lines) + "\n")
