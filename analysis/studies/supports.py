"""Supports study: where on a body the springs' error sits whose supports move.

Bodies of the accuracy study have a part held while the opposite one is moved. Displacements carry an error far, so strains
tell where it arises: the stretch of each triangle's edges by the difference from quadratic elements, squared and times area.
The elements are refined, and finer where supports end. Triangles at an edge of a support are those within two rings about its
border; others are at a sharp edge, or elsewhere.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ..compare import triangle_normals
from ..progress import say
from ..report import Table
from ..runs import Array, Run, scene_of
from ..surface_points import on_points_of
from ..wording import percent
from .accuracy import SPRINGS, Bench, Case, error_of
from .bodies import bodies
from .result import Result, Section

REGIONS = ("edges of supports", "sharp edges", "elsewhere")
_FAMILIES = ("bracket", "branching", "lump", "plate", "tube")
_SHARP = np.cos(np.radians(30))  # between normals


def regions(X: Array, F: Array, is_held: Array) -> Array:
    """For each triangle, the place of its region in REGIONS. is_held: by vertex."""
    is_mixed = is_held[F].any(axis=1) & ~is_held[F].all(axis=1)
    is_at_support = np.isin(F, F[is_mixed]).any(axis=1)
    normals = triangle_normals(X, F)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    edges = np.sort(F[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    first, second = order[::2], order[1::2]
    is_sharp = np.einsum("ec,ec->e", normals[first // 3], normals[second // 3]) < _SHARP
    is_at_edge = np.isin(F, edges[first[is_sharp]]).any(axis=1)
    return np.where(is_at_support, 0, np.where(is_at_edge, 1, 2))


def error_of_strain(X: Array, F: Array, d: Array) -> Array:
    """Squared stretches of a triangle's edges by a difference d (n, 3) of displacements, times area (m2)."""
    ends = np.roll(F, -1, axis=1)
    along = X[ends] - X[F]
    stretch = (along * (d[ends] - d[F])).sum(axis=2) / (along**2).sum(axis=2)
    result: Array = np.linalg.norm(triangle_normals(X, F), axis=1) * (stretch**2).sum(axis=1)
    return result


def shares(run: Run, reference: Run) -> tuple[Array, Array]:
    """Of all area, and of the squared error of strain, in each region (3)."""
    end = reference.last
    is_held = np.zeros(len(end.X), bool)
    for support in scene_of(reference)["supports"]:
        sphere = support["region"]["sphere"]
        is_held |= np.linalg.norm(end.X - sphere["center"], axis=1) < sphere["radius"]
    of = regions(end.X, end.F, is_held)
    error = error_of_strain(end.X, end.F, on_points_of(run, reference).last.u - end.u)
    area = np.linalg.norm(triangle_normals(end.X, end.F), axis=1)
    in_area, in_error = (np.bincount(of, value, len(REGIONS)) / value.sum() for value in (area, error))
    return in_area, in_error


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: one body."""
    bench = Bench(folder)
    seen: dict[str, Case] = {}
    for body in bodies():
        if not body.is_held_out and body.family in _FAMILIES and body.triangulation == "coarse":
            seen.setdefault(body.family, Case(body, "held_moved", "0.25"))
    head = ["body", "error", *(f"{region}: {of}" for region in REGIONS for of in ("area", "error"))]
    rows, at_supports = [], []
    for case in list(seen.values())[: 1 if arguments.quick else None]:
        say(case.name, arguments.quiet)
        scene, _ = bench.scenes(case)
        finest, _ = bench.references(scene, case)
        springs = bench.run(
            "massspring", scene, case.nu, f"network.calibration={SPRINGS}", "network.estimate=false"
        )
        area, error = shares(springs, finest)
        at_supports.append(error[0])
        cells = [percent(value, 2) for both in zip(area, error, strict=True) for value in both]
        rows.append([case.body.name, percent(error_of(springs, finest), 2), *cells])
    found: Table = (head, rows)
    finding = (
        f"Of the squared error of strain, {percent(float(np.median(at_supports)), 2)} sit at edges of supports, "
        f"in the median over {len(rows)} bodies."
    )
    return Result(
        "Supports that move", finding, [Section("Where the error sits", [], {}, {"supports": found})]
    )
