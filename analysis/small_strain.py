"""How far an answer of small-strain elasticity may be off: by the rotations and strains that it has and leaves out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .runs import Array

_SHARE = 0.95  # of the surface: the rest may be clamped edges, whose strain grows with the mesh


class Deformation(NamedTuple):
    """Of a surface, what all but a twentieth of its area stays below."""

    rotation: float  #: rad
    strain: float  #: largest |principal strain| along the surface, of the linear strain tensor

    def error(self, is_collapse: bool) -> float:
        """Estimated relative error of a small-strain displacement.

        A rotation a lengthens what it turns by 1/cos a - 1, about a^2 / 2. A strain e changes the lengths, areas and
        lever arms on which loads act by about e; in a collapse no load acts, and strain is what the scene prescribes.
        """
        return self.rotation**2 / 2 + (0 if is_collapse else self.strain)


def deformation_of(X: Array, F: Array, u: Array) -> Deformation:
    """Rotation and strain of the surface X, F (rest points in m, triangles) by the displacement u (n, 3)."""
    edges = X[F[:, 1:]] - X[F[:, :1]]  # (m, 2, 3)
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(normals, axis=1) / 2
    is_sound = areas > 0
    edges, normals, F = edges[is_sound], normals[is_sound], F[is_sound]
    changes = u[F[:, 1:]] - u[F[:, :1]]
    # Rows: a right-handed frame of each triangle at rest, its first two along the triangle.
    first = _unit(edges[:, 0])
    normal = _unit(normals)
    axes = np.stack([first, np.cross(normal, first), normal], axis=1)
    plane = edges @ axes[:, :2].transpose(0, 2, 1)  # (m, 2 edges, 2)
    gradient = np.linalg.solve(plane, changes) @ axes.transpose(0, 2, 1)  # (m, 2 directions, 3 components)
    along = gradient[:, :, :2]
    strains = np.abs(np.linalg.eigvalsh((along + along.transpose(0, 2, 1)) / 2)).max(axis=1)
    # The nearest rotation of the deformed triangle, whose normal stays a unit normal.
    tangents = np.eye(3)[:2] + gradient
    deformed = np.concatenate([tangents, _unit(np.cross(tangents[:, 0], tangents[:, 1]))[:, None]], axis=1)
    left, _, right = np.linalg.svd(deformed)
    cosines = (np.einsum("mij,mji->m", left, right) - 1) / 2
    angles = np.arccos(np.clip(cosines, -1, 1))
    weights = areas[is_sound]
    return Deformation(stays_below(angles, weights, _SHARE), stays_below(strains, weights, _SHARE))


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def stays_below(values: Array, weights: Array, share: float) -> float:
    """The least value that is not exceeded on this share of the weight."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, share * reached[-1] * (1 - 1e-12))])
