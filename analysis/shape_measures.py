"""Measures of shape that two bodies share although their vertices do not correspond, as where wrinkles form by chance.

A surface is closed, its triangles counterclockwise seen from outside: points X (n, 3) in m and triangles F (m, 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .compare import triangle_normals
from .runs import Array
from .silhouette import silhouette
from .surface_points import nearest_points

Surface = tuple[Array, Array]  #: X and F

_SLIVER = 1e-9  # twice a triangle's area over the square of its longest edge: below it has no angles
_SIDES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))  # axes to the right, up and towards the eye


class MassProperties(NamedTuple):
    """Of the enclosed body, of unit density."""

    volume: float  #: m3
    area: float  #: m2
    centre: Array  #: of mass, (3,), m
    inertia: Array  #: tensor about the centre of mass, (3, 3), m5


def mass_properties(surface: Surface) -> MassProperties:
    """Exact for the polyhedron, by the divergence theorem: sums over the tetrahedra of a point and the triangles.

    Shells within a shell, whose triangles face inwards, are cavities.
    """
    X, F = surface
    origin = X.mean(axis=0)
    corners = (X - origin)[F]  # (m, 3 corners, 3)
    sixfold = np.linalg.det(corners)
    sums = corners.sum(axis=1)
    volume = sixfold.sum() / 6
    centre = sixfold @ sums / 24 / volume
    # Integral of x x^T over a tetrahedron that has a corner in the origin.
    products = np.einsum("tci,tcj->tij", corners, corners) + np.einsum("ti,tj->tij", sums, sums)
    second = np.einsum("t,tij->ij", sixfold, products) / 120 - volume * np.outer(centre, centre)
    area = np.linalg.norm(triangle_normals(X, F), axis=1).sum()
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(float(volume), float(area), origin + centre, inertia)


class Distances(NamedTuple):
    """From the points of a surface to the nearest of another, in m."""

    mean: float  #: over the area
    quantile_95: float  #: not exceeded on 95 % of the area
    largest: float


class SurfaceDistance(NamedTuple):
    """Of two surfaces, both ways."""

    there: Distances  #: from the first to the second
    back: Distances

    @property
    def mean(self) -> float:
        return (self.there.mean + self.back.mean) / 2

    @property
    def quantile_95(self) -> float:
        return max(self.there.quantile_95, self.back.quantile_95)

    @property
    def hausdorff(self) -> float:
        return max(self.there.largest, self.back.largest)


def surface_distance(first: Surface, second: Surface, n: int = 4) -> SurfaceDistance:
    """Distances of two surfaces by nearest points on triangles; see [Cignoni, Rocchini & Scopigno 1998].

    Means are over the centroids of n^2 equal parts of every triangle, and the largest over the vertices, too. So a mean is off
    by rounding where the distance is linear on each part, and the Hausdorff distance is too small by a part's size at most.
    """
    return SurfaceDistance(_distances(first, second, n), _distances(second, first, n))


def _distances(surface: Surface, other: Surface, n: int) -> Distances:
    X, F = surface
    weights = _parts(n)
    samples = np.einsum("pc,tcd->tpd", weights, X[F]).reshape(-1, 3)
    _, found = nearest_points(other, (np.vstack([samples, X]), F))
    of_samples = found[: len(samples)]
    areas = np.repeat(np.linalg.norm(triangle_normals(X, F), axis=1), len(weights))
    order = np.argsort(of_samples)
    share = np.cumsum(areas[order]) / areas.sum()
    quantile = of_samples[order][min(int(np.searchsorted(share, 0.95)), len(order) - 1)]
    return Distances(float(np.average(of_samples, weights=areas)), float(quantile), float(found.max()))


def _parts(n: int) -> Array:
    """Barycentric coordinates (n^2, 3) of the centroids of a triangle's equal parts."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    upright, turned = i + j < n, i + j < n - 1
    a = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / n
    b = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / n
    return np.stack([a, b, 1 - a - b], axis=1)


def silhouette_differences(first: Surface, second: Surface) -> Array:
    """Of the silhouettes along x, y and z (3,): area of the symmetric difference over that of the union.

    From the other side of an axis a silhouette is mirrored, so that these three tell what six sides would.
    """
    shares = []
    for side in _SIDES:
        a, b = (silhouette(*surface, np.eye(3)[list(side)]) for surface in (first, second))
        union = a.union(b).area
        shares.append(a.symmetric_difference(b).area / union)
    return np.array(shares)


def mean_curvatures(surface: Surface) -> tuple[Array, Array]:
    """Mean curvature (1/m) at each vertex and its part of the area (m2), by the cotangent formula [Meyer et al. 2003].

    Of a sphere of radius r it is 1/r; in hollows it is negative.
    """
    X, F = surface
    corners = X[F]
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # opposite each corner
    twice = np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=1)
    dots = -np.stack([(edges[:, (k + 1) % 3] * edges[:, (k + 2) % 3]).sum(axis=1) for k in range(3)], axis=1)
    squares = (edges**2).sum(axis=2)
    is_sound = twice > _SLIVER * squares.max(axis=1)
    cotangents = np.where(is_sound[:, None], dots / np.maximum(twice, 1e-300)[:, None], 0.0)
    # A vertex' part of a triangle is what lies nearest to it or, of an obtuse triangle, a half or a quarter.
    weighted = squares * cotangents
    near = (weighted.sum(axis=1, keepdims=True) - weighted) / 8
    is_obtuse = dots.min(axis=1) < 0
    halves = np.where(dots < 0, 0.5, 0.25) * twice[:, None] / 2
    areas = np.bincount(F.ravel(), np.where(is_obtuse[:, None], halves, near).ravel(), minlength=len(X))
    # Gradient of the area: half of the sum of cotangents times the edge, over both edges of each corner.
    gradient, normals, of_triangles = np.zeros_like(X), np.zeros_like(X), triangle_normals(X, F)
    for k in range(3):
        i, j = F[:, (k + 1) % 3], F[:, (k + 2) % 3]
        pull = cotangents[:, k, None] * (X[i] - X[j]) / 2
        np.add.at(gradient, i, pull)
        np.add.at(gradient, j, -pull)
        np.add.at(normals, F[:, k], of_triangles)
    sign = np.sign((gradient * normals).sum(axis=1))
    return sign * np.linalg.norm(gradient, axis=1) / 2 / np.maximum(areas, 1e-300), areas


def curvature_histogram(surface: Surface, edges: Array) -> Array:
    """Shares of the area by mean curvature: (n - 1,) between n edges (1/m); what lies beyond them is in the outer bins."""
    curvatures, areas = mean_curvatures(surface)
    inside = np.clip(curvatures, edges[0], edges[-1])
    counts, _ = np.histogram(inside, edges, weights=areas)
    return counts / areas.sum()


def earth_movers_distance(first: Array, second: Array, edges: Array) -> float:
    """Of two histograms (n - 1,) between n edges: the least mean way, in the unit of the edges, that turns one into the other.

    [Rubner, Tomasi & Guibas 2000]; in one dimension it is the area between the cumulated shares.
    """
    middles = (edges[1:] + edges[:-1]) / 2
    return float(np.abs(np.cumsum(first - second)[:-1]) @ np.diff(middles))


def shared_edges(surfaces: Sequence[Surface], n_bins: int = 100) -> Array:
    """Edges (1/m) of bins for histograms of curvature that are compared: all but a hundredth of each surface's area on both
    sides lies between them."""
    ends = []
    for surface in surfaces:
        curvatures, areas = mean_curvatures(surface)
        order = np.argsort(curvatures)
        share = np.cumsum(areas[order]) / areas.sum()
        ends += [curvatures[order][int(np.searchsorted(share, at))] for at in (0.01, 0.99)]
    low, high = min(ends), max(ends)
    margin = max(high - low, 1e-9 * max(abs(low), abs(high), 1e-300)) / n_bins
    return np.linspace(low - margin, high + margin, n_bins + 1)
