"""The comparison of any two results on one surface, be they runs of this project or of another program."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from .compare import (
    Free,
    ModelComparison,
    area_change,
    compare_runs,
    deformation,
    displacement_error,
    free_motions_of,
    vertex_areas,
    volume,
    volume_change,
)
from .comparison_figures import row_of
from .drawing.bodies import Body
from .drawing.plots import Panel, plot_curves
from .drawing.view import Shown
from .folder_lock import locked
from .foreign import Result, read_result
from .methods import REFERENCE
from .paths import ROOT, write_text
from .report import Row, html_table, page, row_figure, svg_figure, text_table
from .runs import Array, Frame, RunError, method_of, scene_of
from .wording import listed, percent, percent_signed, significant, unit_of_length

# Parts of a scene that do not state the problem: how it is solved and shown, and the surface, which is matched by itself.
_NOT_OF_PROBLEM = {"name", "paper", "surface", "network", "reference", "comparison", "playback", "output"}
_OF_TIME = {"mode", "end"}  # the rest is how time is stepped
_SAME_PLACE = 1e-5  # of the largest coordinate and of the body's size: .frd has six digits


@dataclass(frozen=True, eq=False)
class Pair:
    """Two displacements (n, 3) over one surface: rest points X and triangles F, in m."""

    model: Result
    reference: Result
    X: Array
    F: Array
    u: Array
    u_reference: Array
    is_free: Free  #: rigid motion is removed from both
    apart: float  #: m, of matched vertices at most

    def as_json(self) -> dict[str, Any]:
        """Figures: relative displacement errors, and of both the change of volume and area and the tip's displacement (m)."""
        error = displacement_error(self.X, self.F, self.u, self.u_reference, self.is_free)
        values: dict[str, Any] = {
            "model": self.model.name,
            "reference": self.reference.name,
            "displacement_error_l2": error.l2,
            "displacement_error_max": error.max,
            "rigid_motion_removed": self.is_free is not False,
            "n_vertices": len(self.X),
            "largest_distance_of_matched": self.apart,
            "problem_differences": self.problem_differences(),
            "of_model": self._state(self.u),
            "of_reference": self._state(self.u_reference),
        }
        if both := self._runs():
            values["runs"] = asdict(both)
        return values

    def problem_differences(self) -> dict[str, tuple[Any, Any]]:
        """Key of the scene -> its values in the model's and the reference's, where two runs are of different problems."""
        scenes = [scene_of(result.run) for result in (self.model, self.reference) if result.run]
        if len(scenes) < 2 or not all(scenes):
            return {}
        here, there = (_problem_of(scene) for scene in scenes)
        return {
            key: (here.get(key), there.get(key))
            for key in sorted(here.keys() | there.keys())
            if here.get(key) != there.get(key)
        }

    def _runs(self) -> ModelComparison | None:
        if not (self.model.run and self.reference.run):
            return None
        try:
            return compare_runs(self.model.run, self.reference.run, self.is_free)
        except RunError:  # of other loads or another order of vertices: the ends alone are compared
            return None

    def _state(self, u: Array) -> dict[str, float]:
        moved, areas = self.X + u, vertex_areas(self.X, self.F)
        lengths = np.linalg.norm(deformation(Frame(self.X, self.u_reference, self.F), self.is_free), axis=1)
        here = deformation(Frame(self.X, u, self.F), self.is_free)
        return {
            "volume_change": volume(moved, self.F) / volume(self.X, self.F) - 1,
            "area_change": float(vertex_areas(moved, self.F).sum() / areas.sum() - 1),
            "tip_displacement": float(np.linalg.norm(here[lengths.argmax()])),
        }


def _problem_of(scene: dict[str, Any]) -> dict[str, Any]:
    """Key, as in loads.0.pressure -> value."""
    parts = {key: value for key, value in scene.items() if key not in _NOT_OF_PROBLEM}
    parts["time"] = {key: value for key, value in scene.get("time", {}).items() if key in _OF_TIME}
    return dict(_flat(parts, ""))


def _flat(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
        for name, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _flat(part, f"{key}.{name}" if key else str(name))
    else:
        yield key, value


def match(model: Result, reference: Result) -> Pair:
    """Puts two results on one surface: the reference's, or the model's where that has none.

    A vertex of the surface is the nearest node of the other within a hundred-thousandth of the body. Raises RunError where
    neither has a surface, and where vertices find no node of their own.
    """
    holder, other = (reference, model) if reference.F is not None else (model, reference)
    if holder.F is None:
        raise RunError(
            f"{model.name} and {reference.name} hold nodes alone, expected the surface's triangles in one: "
            "the folder of a run or a VTK file"
        )
    used, F = np.unique(holder.F, return_inverse=True)
    F = F.reshape(holder.F.shape)
    tried = [(X[used], *_nearest(X[used], Y)) for X in holder.rests for Y in other.rests]
    X, nodes, distances = min(tried, key=lambda found: float(np.median(found[2])))
    tolerance = _SAME_PLACE * (np.abs(X).max() + np.ptp(X, axis=0).max())
    n_unmatched = int((distances > tolerance).sum())
    if n_unmatched:
        raise RunError(
            f"{n_unmatched} of {len(X)} vertices of {holder.name} have no node of {other.name} within {tolerance:.2g} m "
            f"(the farthest {distances.max():.3g} m away), expected the same surface"
        )
    n_shared = len(nodes) - len(np.unique(nodes))
    if n_shared:
        raise RunError(
            f"{n_shared} vertices of {holder.name} share a node of {other.name}, expected one for each"
        )
    fields = {id(holder): holder.u[used], id(other): other.u[nodes]}
    runs = [result.run for result in (model, reference) if result.run]
    scenes = [scene_of(run) for run in runs]
    held = next((scene for scene in scenes if scene.get("supports") or scene.get("handles")), {})
    is_free = free_motions_of(held, (run.record for run in runs)) if runs else False
    return Pair(
        model, reference, X, F, fields[id(model)], fields[id(reference)], is_free, float(distances.max())
    )


def _nearest(X: Array, Y: Array) -> tuple[Array, Array]:
    """Index of the point of Y nearest to each of X, and its distance."""
    cloud = pv.PolyData(Y)
    nodes = np.array([cloud.find_closest_point(x) for x in X])
    return nodes, np.linalg.norm(Y[nodes] - X, axis=1)


def finding(values: dict[str, Any]) -> str:
    """The comparison in two sentences, behind a warning where the problems differ."""
    differences = [f"{key} ({a} against {b})" for key, (a, b) in values["problem_differences"].items()]
    warning = (
        f"Warning: two problems are compared, which differ in {listed(differences)}. " if differences else ""
    )
    rigid = ", rigid motion removed" if values["rigid_motion_removed"] else ""
    return (
        f"{warning}{values['model']} misses the surface displacement of {values['reference']} by "
        f"{percent(values['displacement_error_l2'])} (at worst {percent(values['displacement_error_max'])}{rigid}). "
        f"{values['n_vertices']} vertices are matched, which lie at most {significant(values['largest_distance_of_matched'])} m "
        "apart."
    )


def table_of(values: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: the model, then the reference."""
    unit, size = unit_of_length(values["of_reference"]["tip_displacement"])
    head = ["", "displacement error", "at worst", "volume change", "area change", f"tip ({unit})"]
    errors = [percent(values[f"displacement_error_{norm}"]) for norm in ("l2", "max")]
    rows = []
    for name, cells in (("model", errors), ("reference", ["-", "-"])):
        state = values[f"of_{name}"]
        changes = [percent_signed(state[key]) for key in ("volume_change", "area_change")]
        rows.append([values[name], *cells, *changes, significant(state["tip_displacement"] / size)])
    return head, rows


def row_of_pair(pair: Pair, folder: Path) -> Row:
    """Draws both bodies at the end into a folder."""
    u, u_reference = (deformation(Frame(pair.X, v, pair.F), pair.is_free) for v in (pair.u, pair.u_reference))
    error = displacement_error(pair.X, pair.F, pair.u, pair.u_reference, pair.is_free)
    difference = np.linalg.norm(u - u_reference, axis=1)
    painted = 100 * error.max * difference / max(difference.max(), 1e-300)
    shown = {
        REFERENCE: Shown(pair.reference.name, "the reference", Body(pair.X, pair.F, u_reference)),
        _key_of(pair.model): Shown(
            pair.model.name, f"error {percent(error.l2)}", Body(pair.X, pair.F, u, painted)
        ),
    }
    return row_of(folder, f"{pair.model.name} against {pair.reference.name}", " at the end", shown)


def _key_of(model: Result) -> str:
    """The method that gives a model its colour, where it has one that is not the reference's."""
    method = method_of(model.run) if model.run else "model"
    return method if method != REFERENCE else "model"


def curves_of(pair: Pair) -> str:
    """SVG: volume and area of two runs over load or time; "" of results that have no curves."""
    model, reference = pair.model.run, pair.reference.run
    if not (model and reference):
        return ""
    runs = {REFERENCE: reference, _key_of(pair.model): model}
    panels = [
        Panel(f"{part} change (%)", 100, {key: change(run) for key, run in runs.items()})
        for part, change in (("volume", volume_change), ("area", area_change))
    ]
    is_dynamic = scene_of(model).get("time", {}).get("mode") == "dynamic"
    labels = {REFERENCE: pair.reference.name, _key_of(pair.model): pair.model.name}
    return plot_curves(panels, "time (s)" if is_dynamic else "load factor (1)", labels).svg()


_EXPLAINED = """<h2>How to read this</h2>
<p><b>Displacement error</b>: root mean square of the difference at the vertices, over the root mean square of the reference's
displacement, both weighted by area and at the end. <b>At worst</b>: the largest difference at a vertex over the same.
<b>Volume and area change</b>: at the end, of what they are at rest. <b>Tip</b>: how far the vertex moves that the reference moves
farthest.</p>"""


def main(arguments: Any) -> int:
    """./testbed compare"""
    results = [read_result(path) for path in (arguments.model, arguments.reference)]
    pair = match(*results)
    values = pair.as_json()
    folder = arguments.out or ROOT / "out" / "compare" / "-".join(
        path.resolve().name for path in (arguments.model, arguments.reference)
    )
    with locked(folder):
        return _write(pair, values, folder)


def _write(pair: Pair, values: dict[str, Any], folder: Path) -> int:
    table = table_of(values)
    parts = [row_figure(row_of_pair(pair, folder)), html_table(*table)]
    if curves := curves_of(pair):
        parts.append(
            svg_figure(curves, "Volume and area, and below the model's difference from the reference.")
        )
    parts.append(_EXPLAINED)
    text = json.dumps(values, indent=2)
    title = f"{Path(pair.model.name).name} against {Path(pair.reference.name).name}"
    write_text(folder / "report.html", page(title, finding(values), parts, {"figures": text}))
    write_text(folder / "comparison.json", text + "\n")
    print(f"{finding(values)}\n\n{text_table(*table)}\n\nreport: {folder / 'report.html'}")
    return 0
