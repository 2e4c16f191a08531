"""Reads a VTK file of another program in a process of its own: VTK crashes, hangs and takes all memory on damaged ones.

    python -m analysis.foreign_vtk FILE.vtk OUT.npz

leaves points x (n, 3), displacement u (n, 3) and triangles F (m, 3) of the surface, none where the file holds no cell.
Memory and time are limited by the file's size. Started by foreign.read_result.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

DISPLACEMENTS = ("displacement", "displacements", "disp", "u")  # names of arrays, in any case
_START, _BYTE = 10, 5e-7  # s of computing, and for each byte
_MEMORY, _MEMORY_OF_BYTE = (
    6_000_000_000,
    60,
)  # bytes of address space, half of which the libraries' threads reserve


def seconds_of(file: Path) -> float:
    """Of computing that reading a file may take."""
    return _START + _BYTE * file.stat().st_size


def limit(file: Path) -> None:
    """Bounds this process."""
    seconds, memory = round(seconds_of(file)), _MEMORY + _MEMORY_OF_BYTE * file.stat().st_size
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def read(file: Path, out: Path) -> None:
    """Raises ValueError where the file is damaged or holds no displacement."""
    import numpy as np
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    is_cut = file.suffix == ".vtk" and _is_cut_text(file)
    said = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(said)
    mesh = pv.read(file)
    if is_cut or said.GetOutput().strip():
        first = "its last line has no end" if is_cut else " ".join(said.GetOutput().split())[:200]
        raise ValueError(f"damaged or cut: {first}")
    names = {name.lower(): name for name in mesh.point_data}
    name = next((names[name] for name in DISPLACEMENTS if name in names), None)
    if name is None or mesh.point_data[name].shape != (mesh.n_points, 3):
        found = ", ".join(mesh.point_data) or "none"
        raise ValueError(f"arrays {found}, expected 'displacement' of 3 components at points")
    parts = [mesh.faces, mesh.lines] if isinstance(mesh, pv.PolyData) else []
    corners = (
        mesh.cell_connectivity
        if isinstance(mesh, pv.UnstructuredGrid)
        else np.concatenate([pv.CellArray(part).connectivity_array for part in parts])
        if parts
        else np.empty(0, int)
    )
    if len(corners) and not (corners.min() >= 0 and corners.max() < mesh.n_points):
        raise ValueError(f"a cell has point {corners.max()}, expected 0 to {mesh.n_points - 1}")
    mesh.point_data["of_point"] = np.arange(mesh.n_points)
    surface = mesh.extract_surface(algorithm="dataset_surface").triangulate()
    F = np.asarray(surface.point_data["of_point"])[surface.regular_faces] if surface.n_cells else []
    np.savez(out, x=np.asarray(mesh.points, float), u=np.asarray(mesh.point_data[name], float), F=F)


def _is_cut_text(file: Path) -> bool:
    data = file.read_bytes()
    return b"ASCII" in data[:1000].upper().splitlines()[2:3] and not data.endswith(b"\n")


def main(words: list[str]) -> int:
    file, out = map(Path, words)
    limit(file)
    try:
        read(file, out)
    except MemoryError:
        print("announces more than a file of its size holds")
        return 1
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
