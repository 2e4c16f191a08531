"""An even, closed surface near any triangles: the boundary of fTetWild's tetrahedra in an envelope of them [Hu et al. 2020]."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from .paths import PROGRAMS, write_text
from .points import read_toml
from .runs import Array, RunError
from .wording import percent, significant

TIME_LIMIT = 120.0  # s
_N_VERTICES = 2500  # wanted where no edge is given
_SHORTEST = 1 / 30  # of the box's diagonal: time grows with the tetrahedra that fill the box
_TOLERANCE = 1e-3  # of the box's diagonal
_FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))  # of a tetrahedron, outward


@dataclass(frozen=True)
class Remeshed:
    """What remeshing did to a surface; lengths in its own unit."""

    edge: float  #: wanted
    tolerance: float  #: allowed between new and old
    to_old: float  #: farthest point of the new surface from the old one
    to_new: float  #: farthest vertex of the old surface from the new one: parts inside, and holes that were closed
    old: dict[str, Any]  #: as `meshing check --json` tells
    new: dict[str, Any]
    n_split: int  #: vertices where parts of the body had met

    def text(self) -> str:
        """For a terminal."""
        lines = [
            f"{name}: {values['vertices']} vertices, {values['faces']} triangles, volume {_volume(values)}, "
            f"worst aspect {significant(values['worst_aspect']) if 'worst_aspect' in values else 'infinite'}"
            for name, values in (("old", self.old), ("new", self.new))
        ]
        if "volume" in self.old and self.old["volume"] > 0:
            lines.append(f"volume: {percent(abs(self.new['volume'] / self.old['volume'] - 1))} off")
        lines.append(
            f"distance: new to old at most {significant(self.to_old)} (tolerance {significant(self.tolerance)}), "
            f"old to new at most {significant(self.to_new)}"
        )
        if self.n_split:
            lines.append(f"split {self.n_split} vertices at which parts of the body met")
        return "\n".join(lines)


def _volume(values: dict[str, Any]) -> str:
    return significant(values["volume"], 6) if "volume" in values else "none (it is not closed)"


def remesh(
    source: Path,
    out: Path,
    edge: float | None = None,
    tolerance: float | None = None,
    limit: float = TIME_LIMIT,
) -> Remeshed:
    """Writes an even surface (.off or .obj) of what a file's triangles enclose.

    edge: wanted, by default for some 2500 vertices, and no less than a thirtieth of the box's diagonal; tolerance: between
    new and old surface, by default a thousandth of that diagonal; limit: s. Raises RunError where the file cannot be read,
    the time is over, nothing is enclosed, or the result is not usable; then `out` stays as it was.
    """
    if out.suffix not in (".off", ".obj"):
        raise RunError(f"{out}: expected a name that ends in .off or .obj")
    for name, value in (("--edge", edge), ("--tolerance", tolerance)):
        if value is not None and not value > 0:
            raise RunError(f"{name} {value}: expected a length above 0")
    with tempfile.TemporaryDirectory() as folder:
        X, F = _read(source, Path(folder) / "old.off")
        diagonal = float(np.linalg.norm(np.ptp(X, axis=0)))
        edge = edge or max(_edge_for(_N_VERTICES, X, F), _SHORTEST * diagonal)
        tolerance = tolerance or _TOLERANCE * diagonal
        V, T = _fill(Path(folder), X, F, edge, tolerance / diagonal, limit, source)
    V, T, n_split = separate(V, T)
    Y, G = boundary_of(V, T)
    if not len(G):
        raise RunError(
            f"{source}: encloses nothing that is wider than the tolerance, {significant(tolerance)}"
        )
    part = out.with_name(f"{out.stem}.part{out.suffix}")
    try:
        _write(part, Y, G)
        new = _check(part)
        if not new["usable"]:
            raise RunError(
                f"{source}: remeshing left a surface that no simulation can use: {'; '.join(new['problems'])}; try another "
                f"--edge (was {significant(edge)}) or --tolerance (was {significant(tolerance)})"
            )
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)
    to_old, to_new = _distance(Y, G, X, F), _distance(X, F, Y, G)
    return Remeshed(edge, tolerance, to_old, to_new, _check(source), new, n_split)


def surface_file(scene: Path, overrides: Sequence[str]) -> Path:
    """The file of a scene's surface. Raises RunError where it has a generated shape."""
    files = [value for key, _, value in (word.partition("=") for word in overrides) if key == "surface.file"]
    given = read_toml(scene).get("surface", {}).get("file")
    if files:
        return Path(files[-1])
    if not given:
        raise RunError(
            f"{scene}: surface.file is missing, expected a file to remesh: generated shapes are even"
        )
    return scene.parent / given


def remeshed(source: Path, folder: Path, is_quiet: bool) -> tuple[Path, str]:
    """The remeshed surface of a file in an experiment's folder, made where it is not there yet, and a sentence about it."""
    out, record = folder / f"{source.stem}_remeshed.off", folder / "remeshed.json"
    if not source.is_file():
        raise RunError(f"{source}: cannot be read, expected a surface to remesh")
    digest = hashlib.sha256(source.read_bytes() + Path(__file__).read_bytes()).hexdigest()[:16]
    known = json.loads(record.read_text()) if record.exists() else {}
    if known.get("source") != digest or not out.exists() or known.get("made") != _hash_of(out):
        folder.mkdir(parents=True, exist_ok=True)
        if not is_quiet:
            print(f"remeshing {source}, {TIME_LIMIT:g} s at most", file=sys.stderr, flush=True)
        done = remesh(source, out)
        known = {"source": digest, "made": _hash_of(out), "text": done.text(), "note": _note(source, done)}
        write_text(record, json.dumps(known, indent=2) + "\n")
        if not is_quiet:
            print(done.text(), file=sys.stderr, flush=True)
    return out, known["note"]


def _hash_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def _note(source: Path, done: Remeshed) -> str:
    return (
        f"Both solvers took a new surface, made of {source.name} by remeshing: it lies within {significant(done.to_old)} of the "
        f"old one, in the file's unit, and nothing of the old one is farther than {significant(done.to_new)} from it."
    )


def _edge_for(n_vertices: int, X: Array, F: Array) -> float:
    """Of so many vertices in equilateral triangles on the surface."""
    a, b, c = (X[F[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return math.sqrt(2 * float(area) / (math.sqrt(3) * n_vertices))


def _meshing(*words: object) -> subprocess.CompletedProcess[str]:
    command = [str(PROGRAMS / "meshing"), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _check(file: Path) -> dict[str, Any]:
    return json.loads(_meshing("check", file, "--json").stdout)


def _read(file: Path, repaired: Path) -> tuple[Array, Array]:
    """The triangles of a file, without those that bound nothing, by the readers of `meshing`."""
    done = _meshing("repair", file, repaired)
    if not repaired.exists():
        raise RunError(done.stderr.strip().removeprefix("error: "))
    words = repaired.read_text().split()
    n, m = int(words[1]), int(words[2])
    if not m:
        raise RunError(f"{file}: no triangles")
    X = np.array(words[4 : 4 + 3 * n], dtype=float).reshape(n, 3)
    F = np.array(words[4 + 3 * n :], dtype=int).reshape(m, 4)[:, 1:]
    return X, F


def _write(file: Path, X: Array, F: Array) -> None:
    mark = "v " if file.suffix == ".obj" else ""
    lines = [mark + " ".join(map(repr, x)) for x in X.tolist()]
    if file.suffix == ".obj":
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in F.tolist()]
    else:
        lines = ["OFF", f"{len(X)} {len(F)} 0", *lines, *(f"3 {a} {b} {c}" for a, b, c in F.tolist())]
    file.write_text("\n".join(lines) + "\n")


def _fill(
    folder: Path, X: Array, F: Array, edge: float, epsilon: float, limit: float, source: Path
) -> tuple[Array, Array]:
    """fTetWild's tetrahedra, in a process of its own: it prints, may abort, and knows no limit of time."""
    task, found = folder / "task.npz", folder / "found.npz"
    np.savez(task, X=X, F=F, edge=edge, epsilon=epsilon)
    command = [sys.executable, "-m", "analysis.remesh", str(task), str(found)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, check=False, cwd=PROGRAMS.parents[1]
        )
    except subprocess.TimeoutExpired:
        raise RunError(
            f"{source}: remeshing took longer than {significant(limit)} s; a longer --edge than {significant(edge)} or a larger "
            f"--tolerance than {significant(epsilon * float(np.linalg.norm(np.ptp(X, axis=0))))} takes less"
        ) from None
    if not found.exists():
        last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise RunError(f"{source}: fTetWild gave no tetrahedra: {last}")
    with np.load(found) as tets:
        return tets["V"], tets["T"]


def boundary_of(V: Array, T: Array) -> tuple[Array, Array]:
    """Vertices and outward triangles of the faces that one tetrahedron has alone. V (n, 3); T (m, 4), of positive volume."""
    faces = np.concatenate([T[:, face] for face in _FACES]).reshape(-1, 3)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    F = faces[np.sort(first[counts == 1])]
    used, indices = np.unique(F, return_inverse=True)
    return V[used], indices.reshape(F.shape)


def separate(V: Array, T: Array) -> tuple[Array, Array, int]:
    """Gives every part of the body that meets others in a vertex or an edge alone a vertex of its own, moved a little into it.

    Returns vertices, tetrahedra and the number of vertices that were split.
    """
    T = T[:, [0, 2, 1, 3]] if _volumes(V, T).sum() < 0 else T.copy()
    V = list(V)
    n_split = 0
    for v in _suspects(T):
        around = np.flatnonzero((T == v).any(axis=1))
        parts = _joined_by_faces(T[around], v)
        n_split += len(parts) > 1
        for part in parts[1:] if len(parts) > 1 else ():
            tets = around[part]
            V.append(V[v] + _STEP * (np.mean([V[i] for i in T[tets].ravel()], axis=0) - V[v]))
            T[tets] = np.where(T[tets] == v, len(V) - 1, T[tets])
    return np.array(V).reshape(-1, 3), T, n_split


_STEP = 0.01  # of the way to the middle of a vertex's tetrahedra


def _volumes(V: Array, T: Array) -> Array:
    a, b, c, d = (V[T[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def _suspects(T: Array) -> list[int]:
    """Vertices of the boundary around which its triangles are not one fan."""
    faces = np.concatenate([T[:, face] for face in _FACES]).reshape(-1, 3)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    next_of: dict[int, dict[int, int]] = {}
    suspects = set()
    for a, b, c in faces[first[counts == 1]].tolist():
        for v, one, other in ((a, b, c), (b, c, a), (c, a, b)):
            fan = next_of.setdefault(v, {})
            if one in fan:
                suspects.add(v)  # an edge of more than two triangles
            fan[one] = other
    for v, fan in next_of.items():
        at, n = next(iter(fan)), 0
        while n < len(fan):
            at, n = fan.get(at, at), n + 1
            if at == next(iter(fan)):
                break
        if n < len(fan):
            suspects.add(v)
    return sorted(suspects)


def _joined_by_faces(T: Array, v: int) -> list[list[int]]:
    """Groups of tetrahedra around a vertex that are joined by faces at it."""
    by_face: dict[tuple[int, ...], list[int]] = {}
    for t, corners in enumerate(T.tolist()):
        others = sorted(c for c in corners if c != v)
        for k in range(3):
            by_face.setdefault(tuple(others[:k] + others[k + 1 :]), []).append(t)
    neighbours: dict[int, set[int]] = {t: set() for t in range(len(T))}
    for tets in by_face.values():
        for t in tets:
            neighbours[t].update(tets)
    groups, seen = [], set()
    for t in range(len(T)):
        if t in seen:
            continue
        group, stack = [], [t]
        seen.add(t)
        while stack:
            group.append(at := stack.pop())
            new = neighbours[at] - seen
            seen |= new
            stack.extend(new)
        groups.append(sorted(group))
    return groups


def _distance(X: Array, F: Array, to_X: Array, to_F: Array) -> float:
    """The farthest of the vertices and the triangles' middles of a surface from another one."""
    other = pv.PolyData.from_regular_faces(to_X, to_F)
    points = np.concatenate([X[np.unique(F)], X[F].mean(axis=1)])
    _, closest = other.find_closest_cell(points, return_closest_point=True)
    return float(np.linalg.norm(points - closest, axis=1).max())


def _work(task: str, found: str) -> None:
    """What the process of its own does: one thread, so that the same triangles give the same tetrahedra."""
    import pytetwild

    with np.load(task) as given:
        V, T = pytetwild.tetrahedralize(
            given["X"], given["F"].astype(np.int32), edge_length_abs=float(given["edge"]),
            epsilon=float(given["epsilon"]), num_threads=1, quiet=True,
        )  # fmt: skip
    part = Path(found).with_suffix(".part.npz")
    np.savez(part, V=V, T=T)
    part.replace(found)


if __name__ == "__main__":
    _work(*sys.argv[1:])
