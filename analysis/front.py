"""What no other measurement beats: the front of seconds and errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (seconds, error) that no other beats in both, fastest first."""
    front: list[int] = []
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if not front or points[index][1] < points[front[-1]][1]:
            front.append(index)
    return front


def seconds_for(points: Sequence[tuple[float, float]], error: float) -> float | None:
    """Seconds that a method needs for an error, between its measured points by a straight line in the logarithms.

    Where all points are more accurate than asked for, the fastest counts; None where none is accurate enough.
    """
    front = [points[index] for index in pareto(points)]
    if not front or front[-1][1] > error:
        return None
    if front[0][1] <= error:
        return front[0][0]
    logs = np.log(np.array(front)[::-1])
    return float(np.exp(np.interp(np.log(error), logs[:, 1], logs[:, 0])))
