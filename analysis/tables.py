"""An experiment as pandas tables and plots, for Python sessions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pyvista as pv
from matplotlib.figure import Figure

from .compare import deformation, displacement_at, vertex_areas
from .comparison import Comparison
from .comparison_figures import plot
from .drawing.bodies import Body
from .drawing.bodies_aside import bodies_aside
from .drawing.plots import figure_of
from .methods import REFERENCE, label_of
from .runs import Array, Frame, RunError
from .verdict import total


def table_of(comparison: Comparison) -> pd.DataFrame:
    """A row for every model, the reference last, and a column for every figure; seconds leave out an estimate's."""
    values = comparison.as_json()
    rows = dict(values["models"]) | ({REFERENCE: values["reference"]} if comparison.reference else {})
    flat = {name: _flat(row) for name, row in rows.items()}
    if comparison.reference:
        flat[REFERENCE] |= {
            "status": comparison.reference.stopped or "ok",
            "tip_displacement": values["reference"]["largest_displacement"],
        }
    return pd.DataFrame.from_dict(flat, orient="index").rename_axis("model")


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Of a model, without tables in the table."""
    more = row.get("diagnostics") or {}
    seconds = {"seconds": total(row["seconds"])} if "seconds" in row else {}
    return {key: value for key, value in row.items() if key != "diagnostics"} | dict(more) | seconds


def nodes_of(comparison: Comparison, name: str | None = None) -> pd.DataFrame:
    """A row for every vertex of the surface, at the last moment that both have reached.

    name: of the model, by default the scene's own. Columns: x y z at rest (m), area (m2), displacement ux uy uz (m); with a
    reference its displacement and error, the length of the difference over the reference's root mean square. Of a free body
    rigid motion is removed. Raises RunError for a model that gave no result.
    """
    name = name or comparison.experiment.calibration
    if name not in comparison.runs:
        raise RunError(f"no result of '{name}' (found {', '.join(comparison.runs)})")
    run, reference, is_free = comparison.runs[name], comparison.reference, comparison.experiment.is_free
    time = min([run.times[-1], *([reference.times[-1]] if reference else [])])
    X, F = run.last.X, run.last.F

    def at(source: Any) -> Array:
        return deformation(Frame(X, displacement_at(source, time), F), is_free)

    areas, u = vertex_areas(X, F), at(run)
    columns = dict(zip("xyz", X.T, strict=True)) | {"area": areas}
    columns |= dict(zip(("ux", "uy", "uz"), u.T, strict=True))
    if reference:
        v = at(reference)
        columns |= dict(zip(("ux_reference", "uy_reference", "uz_reference"), v.T, strict=True))
        mean = np.sqrt(np.average((v**2).sum(axis=1), weights=areas))
        columns["error"] = np.linalg.norm(u - v, axis=1) / mean
    return pd.DataFrame(columns).rename_axis("vertex")


def figure_of_plots(comparison: Comparison) -> Figure:
    """The plots of the report, which a notebook shows. Raises RunError where no method gave a result."""
    plots = plot(comparison)
    if not plots:
        raise RunError("no method gave a result, so there is nothing to plot")
    return figure_of(plots)


def scene_of_bodies(comparison: Comparison, name: str | None = None) -> pv.Plotter:
    """The deformed bodies side by side, the reference first and the model painted with its error, cameras linked."""
    name = name or comparison.experiment.calibration
    nodes = nodes_of(comparison, name)
    X, F = nodes[["x", "y", "z"]].to_numpy(), comparison.runs[name].last.F
    u = nodes[["ux", "uy", "uz"]].to_numpy()
    if not comparison.reference:
        return bodies_aside({label_of(name): Body(X, F, u)})
    v = nodes[["ux_reference", "uy_reference", "uz_reference"]].to_numpy()
    error = 100 * nodes["error"].to_numpy()
    return bodies_aside({label_of(REFERENCE): Body(X, F, v), label_of(name): Body(X, F, u, error)})
