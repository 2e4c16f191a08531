"""The one factor on all loads by which a body strains as its scene wants: load_scale.strain.

A trial solve of edge_coupled springs at small strain, which are linear elements, tells how far the given loads strain it.
Both programs then get the factor, and so do equal loads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from .runs import STRAIN_TOO_LARGE, Array, RunError, load_frames
from .small_strain import stays_below

_SHARE = (
    0.99  # of the volume: clamped edges and sharp corners may strain more, and the more the finer the mesh is
)
#: What the trial takes in place of the scene's own.
TRIAL = (
    "network.calibration=edge_coupled",
    'material.law="small_strain"',
    "time.load_steps=1",
    "network.estimate=false",
    "output.curves=true",
)
OPTIONS = ("--no-diagnostics", "--checked")
_LESS = 1e-3  # times the load of a trial that strains too much

#: Makes a trial run with these overrides: its status, and its folder.
Trial = Callable[[tuple[str, ...]], tuple[str, Path]]


def wanted_strain(scene: dict[str, Any], overrides: Sequence[str]) -> float | None:
    """The strain for which a factor is to be found, by a scene as written and its overrides; None where there is none."""
    found = dict(scene.get("load_scale", {}))
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("load_scale.strain", "load_scale.factor"):
            found[key.partition(".")[2]] = float(value)
    return None if "factor" in found else found.get("strain")


def factor_override(wanted: float, trial: Trial) -> str | None:
    """KEY=VALUE of the factor; None where the trial ends with another status than ok.

    A load that strains too much for small strain is lessened until it does not. Raises RunError where it strains nothing.
    """
    load = 1.0
    while True:
        status, folder = trial((f"load_scale.factor={load}", *TRIAL))
        if status != STRAIN_TOO_LARGE:
            break
        load *= _LESS
    if status != "ok":
        return None
    measured = strain_of(folder) / load
    if not measured > 0:
        raise RunError(f"load_scale.strain = {wanted}: the loads strain nothing, see {folder}")
    return f"load_scale.factor={wanted / measured:.6g}"


def strain_of(folder: Path) -> float:
    """Of a run's last frame with tetrahedra: what all but a hundredth of the volume stays below."""
    grid = load_frames(folder).grid(-1)
    X, u = (np.asarray(grid.point_data[name], dtype=float) for name in ("rest_position", "displacement"))
    return strain_in(X, grid.cells_dict[pv.CellType.TETRA], u)


def strain_in(X: Array, T: Array, u: Array) -> float:
    """The largest principal strain, by magnitude, that all but a hundredth of the volume stays below.

    X, u: (n, 3) rest points and displacement (m); T: (m, 4) tetrahedra.
    """
    edges, changes = X[T[:, 1:]] - X[T[:, :1]], u[T[:, 1:]] - u[T[:, :1]]
    gradients = np.linalg.solve(edges, changes)
    strains = np.linalg.eigvalsh((gradients + gradients.transpose(0, 2, 1)) / 2)
    return stays_below(np.abs(strains).max(axis=1), np.abs(np.linalg.det(edges)), _SHARE)
