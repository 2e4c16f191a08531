"""The hand of a preview: what the mouse takes hold of."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor, vtkCellPicker

from analysis.drawing.obstacles import translation
from analysis.drawing.window import Window
from analysis.runs import Array
from analysis.scene import toml_of
from massspring.viewer.engine import Body, Engine

_PULL = 0.05  # stiffness of the spring that pulls, over E times the body's diagonal
_FINGER = 0.06  # of the diagonal: so far about a vertex it pulls
_NEAR = 12  # pixels: a pivot is taken hold of from here
_BEFORE_ALL = -66000  # units of depth: what is drawn so is hidden by nothing


class Hand:
    """Moves pivots, and pulls vertices by springs.

    pulled: vertex -> where its spring's other end is held (m).
    """

    def __init__(
        self,
        window: Window,
        engine: Engine,
        body: Body,
        actor: vtkActor,
        set_value: Callable[[str, str], None],
        tell: Callable[[str], None],
    ) -> None:
        """Of the engine's body, which actor draws; set_value: told a key of the scene and its value; tell: what it does."""
        self._window, self._engine, self._body = window, engine, body
        self._actor, self._set, self._tell = actor, set_value, tell
        self._own_handles = engine.scene.get("handles", [])
        self._dragged: Callable[[Array], None] | None = None
        self._marks: dict[str, pv.PolyData] = {}
        self._is_holding = False
        self.pulled: dict[int, Array] = {}

    def _pivots(self) -> list[Array]:
        """Where they are now (m)."""
        now = self._engine.latest.head["time"]
        pivots = self._engine.scene.get("collapse", {}).get("pivots", [])
        return [np.array(pivot["point"]) + translation(pivot, now) for pivot in pivots]

    def take(self, x: int, y: int) -> Array | None:
        """A pivot, or else the vertex under the mouse; nothing of a body in whose place another is being set up."""
        latest = self._engine.latest
        if self._engine.is_beginning or latest.body is not self._body:
            return None
        for number, at in enumerate(self._pivots()):
            if np.hypot(*(self._window.pixels_of(at)[:2] - (x, y))) < _NEAR:
                self._dragged = functools.partial(self._move_pivot, number)
                return at
        picker = vtkCellPicker()
        picker.PickFromListOn()
        picker.AddPickList(self._actor)
        if not picker.Pick(x, y, 0, self._window.plotter.renderers[0]):
            return None
        at_hand = (self._body.X + latest.u)[: self._body.n_uncut]
        vertex = int(np.argmin(np.linalg.norm(at_hand - picker.GetPickPosition(), axis=1)))
        self._dragged = functools.partial(self._pull, vertex)
        self._pull(vertex, at_hand[vertex])
        return at_hand[vertex]

    def drag(self, point: Array) -> None:
        """Nothing, if all has been let go since the button was pressed."""
        if self._dragged:
            self._dragged(point)

    def drop(self) -> None:
        self._dragged = None
        if not self._is_holding:
            self.let_go()

    def _move_pivot(self, number: int, at: Array) -> None:
        way = at - self._engine.scene["collapse"]["pivots"][number]["point"]
        self._set(f"collapse.pivots.{number}.motion", str([[0.0, *map(float, way)]]))

    def _pull(self, vertex: int, at: Array) -> None:
        self.pulled[vertex] = at
        X = self._body.X
        size = float(np.linalg.norm(np.ptp(X, axis=0)))
        stiffness = _PULL * float(self._engine.scene["material"]["E"]) * size
        hands = [
            {
                "region": {"sphere": {"center": X[held], "radius": _FINGER * size}},
                "stiffness": stiffness,
                "motion": [[0.0, *(end - X[held])]],
            }
            for held, end in self.pulled.items()
        ]
        self._set("handles", toml_of([*self._own_handles, *hands], "handles"))
        self._tell(f"what is about vertex {vertex} is pulled by {stiffness:.3g} N/m")

    def let_go(self) -> None:
        """Of all."""
        self._dragged = None
        if self.pulled:
            self.pulled.clear()
            self._set("handles", toml_of(self._own_handles, "handles"))
            self._tell("")

    def toggle_holding(self) -> None:
        self._is_holding = not self._is_holding
        if not self._is_holding:
            self.let_go()
        self._tell("what is pulled is held" if self._is_holding else "what is pulled is let go")

    def draw(self, x: Array, now: float) -> None:
        """Pivots, and a thread from each vertex that a handle pulls to where it is pulled."""
        X = self._body.X
        own = {h["vertex"]: X[h["vertex"]] + translation(h, now) for h in self._own_handles if "vertex" in h}
        threads = [point for vertex, end in (own | self.pulled).items() for point in (x[vertex], end)]
        plotter = self._window.plotter
        plotter.subplot(0, 0)
        for name, points, colour in (("pivots", self._pivots(), "#D55E00"), ("hands", threads, "#009E73")):
            if name in self._marks and self._marks[name].n_points == len(points):
                self._marks[name].points = np.array(points).reshape(-1, 3)
                continue
            plotter.remove_actor(name, render=False)
            mesh = self._marks[name] = pv.PolyData(np.array(points).reshape(-1, 3))
            if not points:
                continue
            if name == "hands":
                mesh.lines = np.insert(np.arange(len(points)).reshape(-1, 2), 0, 2, axis=1).ravel()
                mesh.verts = np.insert(np.arange(len(points)).reshape(-1, 1), 0, 1, axis=1).ravel()
            mapper = plotter.add_mesh(
                mesh, color=colour, name=name, point_size=16, line_width=4, render_points_as_spheres=True,
                lighting=False, reset_camera=False, render=False,
            ).mapper  # fmt: skip
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0, _BEFORE_ALL)
            mapper.SetRelativeCoincidentTopologyPointOffsetParameter(_BEFORE_ALL)
