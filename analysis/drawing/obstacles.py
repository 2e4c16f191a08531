"""A scene's obstacles, drawn where they are at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from ..runs import Array
from .pictures import tiles, view_axes


def translation(moving: dict[str, Any], time: float) -> Array:
    """By the motion [[s, m, m, m], ...] of an obstacle, a pivot or a handle, linear in between and constant outside."""
    if not moving.get("motion"):
        return np.zeros(3)
    times, *components = np.array(moving["motion"], dtype=float).T
    return np.array([np.interp(time, times, component) for component in components])


def _mesh_of(obstacle: dict[str, Any], middle: Array, size: float) -> pv.PolyData:
    """Where it starts; a plane as a square of twice the size, beside the middle."""
    if plane := obstacle.get("plane"):
        normal = np.array(plane["normal"], dtype=float)
        normal /= np.linalg.norm(normal)
        at = middle - (middle - plane["point"]) @ normal * normal
        return tiles(at, normal, 2 * size)
    if sphere := obstacle.get("sphere"):
        return pv.Sphere(
            radius=sphere["radius"], center=sphere["center"], theta_resolution=60, phi_resolution=60
        )
    if box := obstacle.get("box"):
        return pv.Box(bounds=np.column_stack([box["low"], box["high"]]).ravel())
    if capsule := obstacle.get("capsule"):
        a, b = np.array(capsule["a"], dtype=float), np.array(capsule["b"], dtype=float)
        axis = b - a
        return pv.Capsule(
            center=(a + b) / 2,
            direction=axis,
            radius=capsule["radius"],
            cylinder_length=float(np.linalg.norm(axis)),
        )
    return pv.read(obstacle["mesh"]["file"])


def _add(plotter: pv.Plotter, mesh: pv.PolyData) -> pv.Actor:
    """A floor is behind all that stands on it, and not seen from below; what else there is must not hide a body.

    One layer of each obstacle is drawn, so that none is blended in the wrong order.
    """
    is_plane = "tile" in mesh.cell_data
    if is_plane and mesh.point_normals[0] @ view_axes()[2] > 0:
        return plotter.add_mesh(
            mesh, scalars="tile", rgb=True, lighting=False, reset_camera=False, culling="back"
        )
    look = {"opacity": 0.5} if is_plane else {"opacity": 0.75, "culling": "back"}
    return plotter.add_mesh(mesh, color="lightgrey", reset_camera=False, **look)


class Obstacles:
    """Those of a scene in a plotter's present panel; points: what they are drawn around."""

    def __init__(self, plotter: pv.Plotter, obstacles: list[dict[str, Any]], points: Array) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        size = float(np.linalg.norm(high - low))
        self.drawn = [(o, _add(plotter, _mesh_of(o, (low + high) / 2, size))) for o in obstacles]
        self._plotter = plotter

    def move(self, time: float) -> None:
        """time: s, or the load factor."""
        for obstacle, actor in self.drawn:
            actor.position = translation(obstacle, time)

    def remove(self) -> None:
        for _, actor in self.drawn:
            self._plotter.remove_actor(actor)
