"""Makes an even, closed surface of any triangles (CAD, scans, soups) within a tolerance.

The hull of the tetrahedra of fTetWild [Hu, Schneider, Wang, Zorin & Panozzo 2020].
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from .paths import PROGRAMS, write_text
from .runs import Array, RunError
from .wording import significant

FOLDER = "remeshed"  #: in that of a run: surfaces of their body's name, and beside each what was done
N_VERTICES = 2000  #: that a surface gets where no edge is asked for, about
TOLERANCE = 2e-3  #: of the diagonal of the body's box, where none is asked for
SECONDS = 120  #: of computing, after which fTetWild is stopped: what is no body is worked on for minutes

_APART = 0.1  # of a fan's size, by which its vertex leaves that of another that it touches

STOP_ENERGY = 50.0  #: of the worst tetrahedron, by fTetWild's measure: only their surface is wanted, which is even before


@dataclass(frozen=True)
class Remeshed:
    """What has become of a surface; lengths in its own unit.

    before, after: what `meshing check --json` says of the surface mended exactly and of the new one; to_old, to_new: the
    largest distance of vertices and middles of triangles of the one surface to the other; n_parted: vertices and edges at
    which parts touched that have been set apart.
    """

    before: dict[str, Any]
    after: dict[str, Any]
    edge: float
    tolerance: float
    to_old: float
    to_new: float
    n_parted: int = 0

    @property
    def text(self) -> str:
        def row(name: str, key: str) -> str:
            values = [report.get(key) for report in (self.before, self.after)]
            cells = ["-" if value is None else f"{value:.6g}" for value in values]
            return f"{name:24}{cells[0]:>14}{cells[1]:>14}"

        return "\n".join(
            [
                f"{'':24}{'before':>14}{'after':>14}",
                row("vertices", "vertices"),
                row("triangles", "faces"),
                row("worst aspect", "worst_aspect"),
                row("volume", "volume"),
                row("area", "area"),
                f"edge wanted {self.edge:.4g}, tolerance {self.tolerance:.4g}",
                f"new surface from old at most {self.to_old:.4g}, old from new at most {self.to_new:.4g}",
                *([f"set apart at {self.n_parted} vertices and edges"] if self.n_parted else []),
            ]
        )


def remesh(
    surface: Path,
    out: Path,
    edge: float | None = None,
    tolerance: float | None = None,
    limit: int = SECONDS,
) -> Remeshed:
    """Writes an even, closed surface (.obj or .off) near any triangles; nothing is written unless it is usable.

    edge, tolerance: in the file's unit; absent: of N_VERTICES and TOLERANCE; limit: CPU seconds. Raises RunError naming
    file and reason where the file cannot be read, fTetWild gives nothing, or `meshing check` refuses what it gives.
    """
    for name, value in (("--edge", edge), ("--tolerance", tolerance)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise RunError(f"{name} {value}, expected a length > 0")
    if out.suffix.lower() not in (".obj", ".off"):
        raise RunError(f"{out}: expected a name that ends in .obj or .off")
    with tempfile.TemporaryDirectory(prefix="remesh_") as name:
        folder = Path(name)
        old = folder / "old.off"
        # It mends exactly what can be, so that parts turned inside out count as solid; its reader names faults of files.
        mended = _meshing("repair", str(surface), str(old))
        if not old.exists():
            raise RunError(mended.stderr.strip().removeprefix("error: "))
        X, F = read_off(old)
        if not len(F):
            raise RunError(f"{surface}: no triangle, expected a surface")
        edge = edge or default_edge(X, F)
        tolerance = tolerance or TOLERANCE * float(np.linalg.norm(np.ptp(X, axis=0)))
        before = checked(old)
        x, f, n_parted = opened(*_tetwild(surface, folder, X, F, edge, tolerance, limit), tolerance)
        new = folder / f"new{out.suffix}"
        write_surface(new, x, f)
        after = checked(new)
        if n_split := after["split_vertices"]:
            n_parted += n_split
            x, f = parted(x, f, tolerance)
            write_surface(new, x, f)
            after = checked(new)
        if after["problems"]:
            raise RunError(
                f"{surface}: remeshed within {tolerance:.3g}, it is no surface of a body: {after['problems'][0]}; "
                "another --edge or --tolerance may help"
            )
        write_text(out, new.read_text())
    return Remeshed(before, after, edge, tolerance, _distance(x, f, X, F), _distance(X, F, x, f), n_parted)


def opened(X: Array, F: Array, most: float) -> tuple[Array, Array, int]:
    """Points (n, 3) and triangles (m, 3), outward, whose edges have two each, and at how many they had more.

    Each wedge of the body at such an edge gets a middle of its own, drawn into the wedge by `most` at most.
    """
    points, triangles = list(X), F.tolist()
    n_opened = 0
    while sides := _shared_edge(triangles):
        n_opened += 1
        a, b = sides[0][1:3]
        along = points[b] - points[a]
        across = points[sides[0][3]] - points[a]
        across = across - along * (across @ along) / (along @ along)
        up = np.cross(along, across) / np.linalg.norm(along)
        angle = [math.atan2(d @ up, d @ across) for d in (points[side[3]] - points[a] for side in sides)]
        normals = [np.cross(points[q] - points[p], points[r] - points[p]) for _, p, q, r in sides]
        forward = [k for k, side in enumerate(sides) if side[1] == a]
        backward = [k for k, side in enumerate(sides) if side[1] == b]
        for k in forward:  # the body lies at lesser angles, up to the next triangle
            other = min(backward, key=lambda j: (angle[k] - angle[j]) % (2 * math.pi))
            inward = -sum(normals[j] / np.linalg.norm(normals[j]) for j in (k, other))
            size = float(np.linalg.norm(inward)) or 1.0
            way = min(_APART * float(np.linalg.norm(along)), most) / size * inward
            for f, p, q, r in (sides[k], sides[other]):
                triangles[f] = [p, len(points), r]
                triangles.append([len(points), q, r])
            points.append((points[a] + points[b]) / 2 + way)
    return np.array(points), np.array(triangles), n_opened


def _shared_edge(triangles: list[list[int]]) -> list[tuple[int, int, int, int]]:
    """Of an edge between more than two triangles, as many one way as the other, each with its corners from the edge on."""
    at: dict[tuple[int, int], list[tuple[int, int, int, int]]] = defaultdict(list)
    for f, t in enumerate(triangles):
        for c in range(3):
            p, q, r = t[c], t[(c + 1) % 3], t[(c + 2) % 3]
            at[min(p, q), max(p, q)].append((f, p, q, r))
    for (low, _), sides in at.items():
        if len(sides) > 2 and 2 * sum(side[1] == low for side in sides) == len(sides):
            return sides
    return []


def parted(X: Array, F: Array, most: float) -> tuple[Array, Array]:
    """Points (n, 3) and triangles (m, 3) with a vertex for each fan of triangles, of a surface whose edges have two each.

    Where a vertex had several fans, each draws its own towards its middle, by `most` at most.
    """
    points, triangles = list(X), F.tolist()
    after: list[dict[int, int]] = [
        {} for _ in points
    ]  # of a vertex, the triangle that follows each neighbour
    for f, t in enumerate(triangles):
        for c, v in enumerate(t):
            after[v][t[(c + 1) % 3]] = f
    new = F.copy()
    for v, triangle_after in enumerate(after):
        fans = []
        while triangle_after:
            _, f = triangle_after.popitem()
            fans.append([f])
            while (last := triangles[f][triangles[f].index(v) - 1]) in triangle_after:
                f = triangle_after.pop(last)
                fans[-1].append(f)
        if len(fans) < 2:
            continue
        for number, fan in enumerate(fans):
            way = X[F[fan]].mean(axis=(0, 1)) - X[v]
            place = X[v] + min(_APART, most / float(np.linalg.norm(way))) * way
            if number == 0:
                points[v] = place
                continue
            new[fan] = np.where(F[fan] == v, len(points), new[fan])
            points.append(place)
    return np.array(points), new


def remeshed_of(surface: Path, folder: Path) -> Path:
    """The surface remeshed in the folder, of the same name, with what was done beside it; made once for the same surface.

    Raises RunError as remesh does.
    """
    out = folder / FOLDER / f"{surface.stem}.off"
    record = out.with_suffix(".json")
    wanted = {"surface": str(surface.resolve()), "sha256": sha256(surface.read_bytes()).hexdigest()}
    wanted |= {"by": sha256(Path(__file__).read_bytes()).hexdigest()}
    if out.exists() and record.exists() and json.loads(record.read_text())["wanted"] == wanted:
        return out
    out.parent.mkdir(parents=True, exist_ok=True)
    print(f"remeshing {surface}, which may take {SECONDS} s", file=sys.stderr)
    done = remesh(surface, out)
    print(done.text, file=sys.stderr)
    write_text(record, json.dumps({"wanted": wanted, "done": asdict(done)}, indent=2) + "\n")
    return out


def sentence_of(scene: dict[str, Any], folder: Path) -> str:
    """What a report says of the remeshed surface that a run in this folder used; "" where it used another."""
    file = Path(scene["surface"].get("file", ""))
    if file.parent != (folder / FOLDER).resolve():
        return ""
    record = json.loads(file.with_suffix(".json").read_text())
    done = Remeshed(**record["done"])
    apart = (
        f" Parts that touched were set apart, at {done.n_parted} vertices and edges." if done.n_parted else ""
    )
    return (
        f"Both methods solved a remeshed surface of {done.after['vertices']} vertices. It lies at most "
        f"{significant(done.to_old)} from {record['wanted']['surface']}, and that at most {significant(done.to_new)} "
        f"from it, in the file's unit.{apart}"
    )


def default_edge(X: Array, F: Array) -> float:
    """Edge of N_VERTICES vertices' equilateral triangles over the area of triangles F of points X (n, 3)."""
    area = np.linalg.norm(np.cross(X[F[:, 1]] - X[F[:, 0]], X[F[:, 2]] - X[F[:, 0]]), axis=1).sum() / 2
    return float(math.sqrt(4 / math.sqrt(3) * area / (2 * N_VERTICES)))


def read_off(file: Path) -> tuple[Array, Array]:
    """Points (n, 3) and triangles (m, 3) of an OFF file that `meshing` wrote."""
    _, n, m, _, *values = file.read_text().split()
    n_coordinates = 3 * int(n)
    X = np.array(values[:n_coordinates], dtype=float).reshape(-1, 3)
    F = np.array(values[n_coordinates : n_coordinates + 4 * int(m)], dtype=int).reshape(-1, 4)
    return X, F[:, 1:]


def write_surface(file: Path, X: Array, F: Array) -> None:
    """Points (n, 3) and triangles (m, 3) as .off or .obj, to the last digit."""
    if file.suffix.lower() == ".off":
        lines = ["OFF", f"{len(X)} {len(F)} 0", *(f"{x!r} {y!r} {z!r}" for x, y, z in X.tolist())]
        lines += [f"3 {a} {b} {c}" for a, b, c in F.tolist()]
    else:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in X.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (F + 1).tolist()]
    file.write_text("\n".join(lines) + "\n")


def _meshing(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(PROGRAMS / "meshing"), *words], check=False, capture_output=True, text=True)


def checked(file: Path) -> dict[str, Any]:
    """What `meshing check --json` says of a surface."""
    return json.loads(_meshing("check", str(file), "--json").stdout)


def _tetwild(
    surface: Path, folder: Path, X: Array, F: Array, edge: float, tolerance: float, limit: int
) -> tuple[Array, Array]:
    """The surface of fTetWild's tetrahedra, made in a process of its own, which can be stopped and may crash."""
    given, made = folder / "given.npz", folder / "made.npz"
    np.savez(given, X=X, F=F)
    command = ["prlimit", f"--cpu={limit}:{limit + 1}", "--core=0", sys.executable, "-m", __name__]
    command += [str(given), str(made), repr(edge), repr(tolerance)]
    worker = subprocess.run(command, check=False, capture_output=True, text=True)
    if worker.returncode == -signal.SIGXCPU:
        raise RunError(
            f"{surface}: no surface in {limit} s of remeshing; a longer --edge and a larger --tolerance take less"
        )
    if not made.exists():
        said = worker.stderr.strip().splitlines() or [f"exit status {worker.returncode}"]
        raise RunError(f"{surface}: fTetWild makes no tetrahedra of it: {said[-1]}")
    with np.load(made) as arrays:
        return arrays["X"], arrays["F"]


def work(given: Path, made: Path, edge: float, tolerance: float) -> None:
    """The worker: a box of diagonal 1 at the origin, on one thread as the solvers."""
    from pytetwild.pytetwild import tetrahedralize_pv

    with np.load(given) as arrays:
        X, F = arrays["X"], arrays["F"]
    os.chdir(made.parent)  # fTetWild leaves a file of its own where it runs
    diagonal = float(np.linalg.norm(np.ptp(X, axis=0)))
    middle = (X.min(axis=0) + X.max(axis=0)) / 2
    grid = tetrahedralize_pv(
        pv.PolyData.from_regular_faces((X - middle) / diagonal, F),
        edge_length_abs=edge / diagonal, epsilon=tolerance / diagonal, stop_energy=STOP_ENERGY, num_threads=1,
    )  # fmt: skip
    if not grid.n_cells:
        raise SystemExit("nothing lies inside of it")
    hull = grid.extract_surface(algorithm=None).triangulate()
    np.savez(
        made,
        X=np.asarray(hull.points, dtype=float) * diagonal + middle,
        F=np.asarray(hull.regular_faces, dtype=int),
    )


def _distance(X: Array, F: Array, Y: Array, G: Array) -> float:
    """Largest distance of points X and middles of triangles F to the surface of points Y and triangles G."""
    points = np.vstack([X, X[F].mean(axis=1)])
    _, closest = pv.PolyData.from_regular_faces(Y, G).find_closest_cell(points, return_closest_point=True)
    return float(np.linalg.norm(points - closest, axis=1).max())


def main(arguments: argparse.Namespace) -> int:
    done = remesh(arguments.surface, arguments.out, arguments.edge, arguments.tolerance)
    print(f"{done.text}\n{arguments.out}")
    return 0


if __name__ == "__main__":
    work(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4]))
