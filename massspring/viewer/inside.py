"""What a cutting plane lays open of a body: its springs, the patches of its tetrahedra, its inner nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkPlane
from vtkmodules.vtkFiltersCore import vtkCutter

from analysis.drawing.pictures import LOOK
from analysis.runs import Array
from massspring.viewer.engine import Body

# Of a tetrahedron abcd: its corners, then the middles of ab, ac, ad, bc, bd, cd, those of bcd, acd, abd, abc, and its own,
# as means of these corners.
_MEANS = ((0,), (1,), (2,), (3,), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3),
          (1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2), (0, 1, 2, 3))  # fmt: skip
_WEIGHTS = np.array([[(corner in mean) / len(mean) for corner in range(4)] for mean in _MEANS])
# The quarter that each corner's patch has of it, a hexahedron; and where two patches meet.
_QUARTERS = np.array([[0, 4, 13, 5, 6, 12, 14, 11], [1, 7, 13, 4, 8, 10, 14, 12],
                      [2, 5, 13, 7, 9, 11, 14, 10], [3, 8, 12, 6, 9, 10, 14, 11]])  # fmt: skip
_WALLS = np.array([[4, 13, 14, 12], [5, 11, 14, 13], [6, 12, 14, 11],
                   [7, 13, 14, 10], [8, 10, 14, 12], [9, 11, 14, 10]])  # fmt: skip


def _points(x: Array, T: Array) -> Array:
    """Of tetrahedra T (t, 4) between nodes x (n, 3): (15 t, 3)."""
    return np.einsum("pc,tcd->tpd", _WEIGHTS, x[T]).reshape(-1, 3)


def patch_grids(x: Array, T: Array) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
    """What the patch of each corner has of each tetrahedron, in the order of T (t, 4), and the walls between patches."""
    first = len(_MEANS) * np.arange(len(T))[:, None, None]
    kinds = ((pv.CellType.HEXAHEDRON, _QUARTERS), (pv.CellType.QUAD, _WALLS))
    quarters, walls = (
        pv.UnstructuredGrid({kind: (corners + first).reshape(-1, corners.shape[1])}, _points(x, T))
        for kind, corners in kinds
    )
    return quarters, walls


class Inside:
    """The parts "springs", "patches" and "nodes" in the plotter's present panel, behind the plane; none is shown at first."""

    def __init__(self, plotter: pv.Plotter, body: Body, plane: vtkPlane) -> None:
        X, T, n = body.X, body.T, len(body.T)
        self._T, self._n_surface = T, body.n_surface
        lines = np.insert(body.E, 0, 2, axis=1).ravel()
        self._springs = pv.PolyData(X.copy(), lines=lines)
        self._nodes = pv.PolyData(X[body.n_surface :].copy())
        self._quarters, self._walls = patch_grids(X, T)
        for mesh in (self._springs, self._nodes):
            mesh["value"] = np.zeros(mesh.n_points)
        self._quarters.cell_data["value"] = np.zeros(4 * n)

        def add(mesh: Any, **look: Any) -> pv.Actor:
            actor = plotter.add_mesh(mesh, cmap="viridis", show_scalar_bar=False, reset_camera=False, **look)
            actor.visibility = False
            return actor

        def cut(grid: pv.UnstructuredGrid) -> vtkCutter:
            cutter = vtkCutter()
            cutter.SetInputData(grid)
            cutter.SetCutFunction(plane)
            cutter.GenerateTrianglesOff()
            return cutter

        self._actors: dict[str, list[pv.Actor]] = {"springs": [], "patches": [], "nodes": []}
        if len(body.E):
            springs = add(self._springs, scalars="value", line_width=1.5, lighting=False)
            self._actors["springs"] = [springs]
        if self._nodes.n_points:
            nodes = add(self._nodes, scalars="value", point_size=9, render_points_as_spheres=True)
            self._actors["nodes"] = [nodes]
        if n:
            patches = add(cut(self._quarters), scalars="value", **LOOK | {"smooth_shading": False})
            walls = add(cut(self._walls), color="black", line_width=1, lighting=False)
            self._actors["patches"] = [patches, walls]
        for actor in self._actors["springs"] + self._actors["nodes"]:
            actor.mapper.AddClippingPlane(plane)

    def has(self, part: str) -> bool:
        return bool(self._actors[part])

    def is_shown(self, part: str) -> bool:
        return self.has(part) and bool(self._actors[part][0].visibility)

    def show(self, part: str, is_shown: bool) -> None:
        for actor in self._actors[part]:
            actor.visibility = is_shown

    def move(self, x: Array, values: Array, largest: float) -> None:
        """x: (n, 3) m; values: (n,), coloured from 0 to the largest."""
        if self.is_shown("springs"):
            self._springs.points = x
            self._springs["value"][:] = values
        if self.is_shown("nodes"):
            self._nodes.points = x[self._n_surface :]
            self._nodes["value"][:] = values[self._n_surface :]
        if self.is_shown("patches"):
            self._quarters.points = self._walls.points = _points(x, self._T)
            self._quarters.cell_data["value"][:] = values[self._T].ravel()
        for actors in self._actors.values():
            for actor in actors:
                actor.mapper.scalar_range = (0, largest)
