"""Results that other programs left: CalculiX's .frd, FEBio's log of node data, and VTK files with a displacement."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from . import foreign_vtk
from .paths import ROOT
from .runs import Array, Run, RunError, load_run

_VTK = (".vtk", ".vtu", ".vtp")
_FEBIO = ("x", "y", "z", "ux", "uy", "uz")


@dataclass(frozen=True, eq=False)
class Result:
    """Displacement of nodes at the end of a run of any program.

    rests: where the nodes may lie at rest, each (n, 3) in m: a VTK file does not say whether its points are moved;
    u: (n, 3), m; F: triangles of the surface, None where the file holds none; run: of this project.
    """

    name: str
    rests: tuple[Array, ...]
    u: Array
    F: Array | None = None
    run: Run | None = None


def read_result(path: Path) -> Result:
    """Reads a folder of a run, .frd, .vtk, .vtu, .vtp, or else a log of FEBio's node data.

    Raises RunError for a file that is missing, damaged, or without positions or displacement.
    """
    if path.is_dir():
        run = load_run(path, may_stop=True)
        return Result(str(path), (run.last.X,), run.last.u, run.last.F, run)
    if not path.is_file():  # pipes and devices may never end
        raise RunError(
            f"{path}: missing, expected the folder of a run, .frd, .vtk, .vtu, .vtp or FEBio's node data"
        )
    read = _read_vtk if path.suffix in _VTK else _read_frd if path.suffix == ".frd" else _read_febio
    result = read(path)
    if not all(np.isfinite(values).all() for values in (*result.rests, result.u)):
        raise RunError(f"{path}: a position or displacement is not finite")
    return result


def _read_vtk(file: Path) -> Result:
    """By a process of its own, which may crash or never end."""
    with TemporaryDirectory() as folder:
        out = Path(folder) / "result.npz"
        command = [
            "setpriv",
            "--pdeathsig",
            "KILL",
            sys.executable,
            "-m",
            foreign_vtk.__name__,
            str(file),
            str(out),
        ]
        paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
        one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        waiting = 10 * foreign_vtk.seconds_of(file)
        try:
            done = subprocess.run(
                command, env=os.environ | one_thread | {"PYTHONPATH": paths}, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, timeout=waiting, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise RunError(
                f"{file}: VTK did not read it in {waiting:.0f} s, expected an undamaged file"
            ) from None
        if done.returncode == 1:
            raise RunError(f"{file}: {done.stdout[:1000].decode(errors='replace').strip()}")
        if done.returncode != 0:
            raise RunError(
                f"{file}: VTK's reader fails on it ({done.returncode}), expected an undamaged file"
            )
        with np.load(out) as arrays:
            x, u = arrays["x"], arrays["u"]
            F = arrays["F"]
    return Result(str(file), (x, x - u), u, F if len(F) else None)


def _read_frd(file: Path) -> Result:
    """Nodes and the last displacement of an ASCII file: records -1 of 5 or 10 and then 12 characters a field."""
    positions: dict[int, list[float]] = {}
    displacements: dict[int, list[float]] = {}
    into: dict[int, list[float]] | None = None
    place = str(file)
    try:
        for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1):
            place = f"{file}:{number}: '{line.strip()[:60]}'"
            kind = line[:6].split()
            if kind[:1] == ["2C"]:
                into = positions
            elif kind[:1] == ["-4"]:
                into = None
                if line[5:13].strip() == "DISP":
                    displacements.clear()  # of an earlier step
                    into = displacements
            elif kind[:1] == ["-3"]:
                into = None
            elif line[:3] == " -1" and into is not None:
                if len(line) < 49:
                    raise ValueError
                into[int(line[3:13])] = [float(line[at : at + 12]) for at in (13, 25, 37)]
        if into is not None:
            raise RunError(f"{file}: ends within its nodes or displacements, expected a whole file")
    except ValueError:
        raise RunError(f"{place}, expected a node and three numbers") from None
    if not positions or positions.keys() != displacements.keys():
        raise RunError(
            f"{file}: {len(positions)} nodes and {len(displacements)} displacements, expected as many of both in ASCII "
            "(*NODE FILE with U)"
        )
    nodes = sorted(positions)
    X, u = (np.array([values[node] for node in nodes]) for values in (positions, displacements))
    return Result(str(file), (X,), u)


def _read_febio(file: Path) -> Result:
    """The last step of node_data with data="x;y;z;ux;uy;uz" written to a file of its own."""
    asked = f'expected FEBio\'s <node_data data="{";".join(_FEBIO)}" file="...">'
    names: list[str] = []
    rows: list[list[float]] = []
    place = str(file)
    try:
        text = file.read_text(errors="replace")
        for number, line in enumerate(text.splitlines(), 1):
            place = f"{file}:{number}: '{line.strip()[:60]}'"
            if line.startswith("*"):
                if match := re.match(r"\*Data\s*=\s*(.*)", line):
                    names, rows = match[1].strip().split(";"), []
            elif line.strip() and names:
                rows.append([float(word) for word in re.split(r"[\s,;]+", line.strip())])
                if len(rows[-1]) != 1 + len(names):
                    raise ValueError
        if not text.endswith("\n"):
            raise RunError(f"{place}: the last line has no end, expected a whole file")
        if not set(_FEBIO) <= set(names) or not rows:
            raise RunError(f"{file}: data {';'.join(names) or 'none'}, {asked}")
        table = np.array(rows)[:, 1:]  # the first word is the node's number
        x, u = (table[:, [names.index(name) for name in part]] for part in (_FEBIO[:3], _FEBIO[3:]))
    except (ValueError, IndexError):
        raise RunError(f"{place}, {asked}") from None
    return Result(str(file), (x - u,), u)
