"""Synthetic runs: what a solver would leave on disk, for a displacement known in closed form."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyvista as pv

from analysis.compare import vertex_areas, volume
from analysis.outputs import list_of

N_STEPS = 4


def write_run(
    folder: Path,
    X: np.ndarray,
    F: np.ndarray,
    field: Callable[[np.ndarray], np.ndarray],
    times: np.ndarray | None = None,
    amplitude: Callable[[float], float] = lambda time: time,
    **record: object,
) -> Path:
    """Writes a finished run whose displacement is amplitude(time) field(X): linear in time by default.

    record: what run.json says otherwise; with n_patches the springs are coupled ones, on a tetrahedron.
    """
    (folder / "frames").mkdir(parents=True)
    times = np.linspace(0, 1, N_STEPS + 1) if times is None else times
    interior = X[:3] / 2  # a solver's file holds internal nodes behind the surface's
    points = np.vstack([X, interior])
    is_reference, is_coupled = record.get("program") == "fem_reference", "n_patches" in record
    if is_reference or is_coupled:
        within = {pv.CellType.TETRA: np.array([[0, len(X), len(X) + 1, len(X) + 2]])}
    else:
        within = {pv.CellType.LINE: np.array([[0, len(X)], [1, len(X) + 1]])}
    cells = {pv.CellType.TRIANGLE: F, **within}
    sets, rows = [], []
    for step, time in enumerate(times):
        u = amplitude(time) * field(points)
        grid = pv.UnstructuredGrid(cells, points + u)
        grid.point_data["rest_position"], grid.point_data["displacement"] = points, u
        grid.field_data["n_surface"] = [len(X)]
        grid.field_data["TimeValue"] = [time]
        name = f"frames/frame_{step:06d}.vtu"
        grid.save(folder / name)
        sets.append(f'<DataSet timestep="{float(time)!r}" file="{name}"/>')
        kinetic = 1 if 0 < step < len(times) - 1 else 0.25  # a quarter is left at the end
        surface = (points + u)[: len(X)]
        rows.append(f"{time},{time},{volume(surface, F)},{vertex_areas(surface, F).sum()},{kinetic}")
    pvd = f'<VTKFile type="Collection" version="0.1"><Collection>{"".join(sets)}</Collection></VTKFile>'
    (folder / "frames.pvd").write_text(pvd)
    (folder / "curves.csv").write_text(
        "\n".join(["time,load_factor,volume,area,kinetic_energy", *rows]) + "\n"
    )
    default = {
        "status": "ok",
        "program": "massspring",
        "n_nodes": len(points),
        **({} if is_reference else {"n_springs": 0 if is_coupled else 2, "n_patches": 0}),
        "n_dofs": 3 * len(points),
        "seconds": {"mesh": 0.1, "setup": 0.2, "solve": 0.3, "output": 0.4},
    }
    (folder / "run.json").write_text(json.dumps(default | record))
    list_outputs(folder)
    return folder


def list_outputs(folder: Path) -> None:
    """Lists the files of a run in its record, as a solver does: what a test changes then counts as written so."""
    record = json.loads((folder / "run.json").read_text())
    files = [file for file in (folder / "frames.pvd", folder / "curves.csv") if file.exists()]
    files += sorted(folder.glob("frames/*vtu"))
    record["outputs"] = list_of(folder, [file.relative_to(folder).as_posix() for file in files])
    (folder / "run.json").write_text(json.dumps(record))
