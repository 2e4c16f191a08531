"""Bodies drawn at random: families of shapes whose measures a seed draws, each triangulated in four ways.

Half of them, picked by a hash of their name, are there to learn from. The other half is measured for final tables only.
Prisms are polygons with holes, drawn out; all others are level sets of a distance. A body's longest side is 1 m, and its
centre of volume is the origin.
"""

from __future__ import annotations

import functools
import hashlib
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyacvd
import pyvista as pv

from ..remesh import checked
from ..runs import Array

SEEDS = (1, 2, 3)
TRIANGULATIONS = ("coarse", "even", "graded", "cad")  #: the last of prisms alone, whose corners are few
#: Vertices that a triangulation starts from; a body that needs more gets more.
_VERTICES = {"coarse": 250, "even": 700, "graded": 500}
_N_FINE = 3000  # of the surface that they are chosen from
_GRID = 60  # cells of a level set along the longest side
_ROUND = 24  # corners of a circle
_DIGIT = 2.0**-30  # m, the last of a coordinate
_FOLDED = 170.0  # degrees between normals of neighbours, at most
_MISSED = 0.25  # of the volume, by a triangulation at most

Field = Callable[[Array], Array]


@dataclass(frozen=True)
class Body:
    family: str
    seed: int
    triangulation: str

    @property
    def name(self) -> str:
        return f"{self.family}-{self.seed}-{self.triangulation}"

    @property
    def is_held_out(self) -> bool:
        """By family and seed, so that no triangulation of a judged body was learnt from."""
        return hashlib.sha256(f"{self.family}-{self.seed}".encode()).digest()[0] % 2 == 1


def bodies() -> list[Body]:
    return [
        Body(family, seed, way)
        for family, make in FAMILIES.items()
        for seed in SEEDS
        for way in TRIANGULATIONS
        if way != "cad" or make in _PRISMS
    ]


def write_body(body: Body, folder: Path) -> Path:
    """The file of a body's surface, made where this module has not made it yet."""
    file = folder / _hash_of_source() / f"{body.name}.ply"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        save(triangulate(body), file)
    return file


def save(surface: pv.PolyData, file: Path) -> None:
    """Writes to a temporary name, then renames."""
    part = file.with_suffix(f".{os.getpid()}.ply")
    surface.save(part)
    part.rename(file)


@functools.cache
def _hash_of_source() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]


def random_of(name: str) -> np.random.Generator:
    """Numbers that depend on a name alone."""
    return np.random.default_rng(list(hashlib.sha256(name.encode()).digest()))


@functools.cache
def _shape(family: str, seed: int) -> pv.PolyData:
    return FAMILIES[family](random_of(f"{family}-{seed}"))


@functools.cache
def _fine(family: str, seed: int, is_even: bool) -> pv.PolyData:
    """What triangulations of a shape are chosen from."""
    shape = _shape(family, seed)
    return _even(shape, _N_FINE) if is_even else _cut(shape, np.sqrt(shape.area / _N_FINE))


def triangulate(body: Body) -> pv.PolyData:
    """Its closed surface; "cad" is the shape's own, with its needles."""
    raw, way = _shape(body.family, body.seed), body.triangulation
    if way == "cad":
        return raw
    # Even triangles are none of a grid's slivers; where they do not close, cut ones do.
    for is_even in (True, False):
        fine, n = _fine(body.family, body.seed, is_even), _VERTICES[way]
        while n < fine.n_points:
            # Clusters wider than a part is thick cut through it; collapsed edges do not.
            if way == "graded" or n > 2 * _VERTICES[way]:
                found = _normalised(fine.decimate(1 - 2 * n / fine.n_cells, volume_preservation=True))
            else:
                found = _even(fine, n)
            if _is_usable(found) and abs(found.volume / raw.volume - 1) < _MISSED:
                return found
            n = 3 * n // 2
    return raw


def _cut(surface: pv.PolyData, edge: float) -> pv.PolyData:
    return surface.subdivide_adaptive(max_edge_len=edge, max_n_passes=12).clean()


def _is_usable(surface: pv.PolyData) -> bool:
    """Closed, crosses itself nowhere, and has no triangle folded onto its neighbour."""
    if not surface.is_manifold or surface.n_open_edges > 0:
        return False
    kinds = {"boundary_edges": False, "non_manifold_edges": False, "manifold_edges": False}
    if surface.extract_feature_edges(_FOLDED, **kinds).n_cells > 0:
        return False
    with TemporaryDirectory() as folder:
        file = Path(folder) / "surface.ply"
        surface.save(file)
        return bool(checked(file)["usable"])


def _even(surface: pv.PolyData, n: int) -> pv.PolyData:
    """Triangles of about equal size on n vertices [Valette & Chassery 2004]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what it takes from pyvista
        clusters = pyacvd.Clustering(_cut(surface, np.sqrt(surface.area / n) / 3))
        clusters.cluster(n)
        return _normalised(clusters.create_mesh())


def moments(X: Array, F: Array) -> tuple[float, Array, Array]:
    """Volume (m3), its first moment (m4) and the integral of x x^T (m5) within a closed surface."""
    corners = X[F]  # of tetrahedra from the origin
    volumes = np.linalg.det(corners) / 6
    sums = corners.sum(axis=1)
    second = np.einsum("t,tai,taj->ij", volumes, corners, corners) + np.einsum(
        "t,ti,tj->ij", volumes, sums, sums
    )
    return volumes.sum(), volumes @ sums / 4, second / 20


def _normalised(surface: pv.PolyData) -> pv.PolyData:
    surface = surface.triangulate().clean().compute_normals(auto_orient_normals=True, point_normals=False)
    points, F = surface.points.astype(float), surface.regular_faces
    volume, first, _ = moments(points, F)
    scaled = (points - first / volume) / np.ptp(points, axis=0).max()
    # Processors round differently, and what is chosen from a surface depends on its last digits.
    return pv.PolyData.from_regular_faces(np.round(scaled / _DIGIT) * _DIGIT + 0.0, F)


def _circle(x: float, y: float, radius: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def _prism(loops: list[Array], height: float) -> pv.PolyData:
    """A polygon, its outline and its holes, drawn out; its faces are cut along the polygon's own corners alone."""
    lines, sides, start = [], [], 0
    n = sum(map(len, loops))
    for loop in loops:
        here = np.arange(start, start + len(loop))
        following = np.roll(here, -1)
        lines += [len(loop) + 1, *here, start]
        sides += [
            np.column_stack([here, following, following + n]),
            np.column_stack([here, following + n, here + n]),
        ]
        start += len(loop)
    flat = np.column_stack([np.vstack(loops), np.zeros(n)])
    face = pv.PolyData(flat, lines=lines).triangulate_contours().regular_faces
    both = np.vstack([flat, flat + np.array([0, 0, height])])
    return _normalised(pv.PolyData.from_regular_faces(both, np.vstack([face, face + n, *sides])))


def _level_set(distance: Field, low: Array, high: Array) -> pv.PolyData:
    """Where a distance is zero, within a box."""
    step = np.max(high - low) / _GRID
    counts = np.ceil((high - low) / step).astype(int) + 1
    grid = pv.ImageData(dimensions=counts, spacing=(step,) * 3, origin=low)
    grid["distance"] = distance(np.asarray(grid.points))
    return _normalised(grid.contour([0.0], scalars="distance"))


def _to_segment(x: Array, a: Array, b: Array) -> Array:
    t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1)


def _to_curve(x: Array, points: Array) -> Array:
    nearest = np.full(len(x), np.inf)
    for a, b in pairwise(points):
        np.minimum(nearest, _to_segment(x, a, b), out=nearest)
    return nearest


def plate(random: np.random.Generator) -> pv.PolyData:
    width, thickness = random.uniform(0.4, 1), random.uniform(0.05, 0.12)
    columns, rows = random.integers(2, 5), random.integers(1, 4)
    pitch = np.array([1 / columns, width / rows])
    radius = random.uniform(0.15, 0.35) * pitch.min()
    centres = [((i + 0.5) * pitch[0], (j + 0.5) * pitch[1]) for i in range(columns) for j in range(rows)]
    holes = [_circle(x, y, radius) for x, y in centres]
    return _prism([np.array([[0, 0], [1, 0], [1, width], [0, width]]), *holes], thickness)


def bracket(random: np.random.Generator) -> pv.PolyData:
    """An angle with a hole near its corner."""
    leg, thick, depth = random.uniform(0.5, 1), random.uniform(0.1, 0.2), random.uniform(0.2, 0.6)
    gusset = random.uniform(0.1, 0.3)
    outline = [
        [0, 0],
        [1, 0],
        [1, thick],
        [thick + gusset, thick],
        [thick, thick + gusset],
        [thick, leg],
        [0, leg],
    ]
    return _prism([np.array(outline), _circle(0.8 * thick, 0.8 * thick, 0.4 * thick)], depth)


def anchor(random: np.random.Generator) -> pv.PolyData:
    radius, half = random.uniform(0.04, 0.08), random.uniform(0.7, 1.2)
    angle = np.linspace(-half, half, 20)
    arms = np.column_stack([0.45 * np.sin(angle), 0.5 - 0.45 * np.cos(angle), 0 * angle])
    turn = np.linspace(0, 2 * np.pi, 25)
    ring = np.column_stack([0.12 * np.sin(turn), 1.05 + 0.12 * np.cos(turn), 0 * turn])
    shank = np.array([[0, 0.05, 0], [0, 0.93, 0]])

    def distance(x: Array) -> Array:
        return np.minimum.reduce([_to_curve(x, c) for c in (arms, ring, shank)]) - radius

    return _level_set(distance, np.array([-0.6, -0.1, -0.12]), np.array([0.6, 1.3, 0.12]))


def tube(random: np.random.Generator) -> pv.PolyData:
    """A straight pipe, open at both ends, whose bore may lie off its axis."""
    outer = random.uniform(0.1, 0.18)
    inner = random.uniform(0.5, 0.75) * outer
    return _prism([_circle(0, 0, outer), _circle(random.uniform(0, 0.4) * (outer - inner), 0, inner)], 1)


def knot(random: np.random.Generator) -> pv.PolyData:
    p, q = [(2, 3), (3, 2), (2, 5)][random.integers(3)]
    radius = random.uniform(0.05, 0.08) * (2 if q < 5 else 1.5)
    t = np.linspace(0, 2 * np.pi, 160)
    r = 1 + 0.45 * np.cos(q * t)
    curve = np.column_stack([r * np.cos(p * t), r * np.sin(p * t), 0.45 * np.sin(q * t)])
    low, high = curve.min(axis=0) - 2 * radius, curve.max(axis=0) + 2 * radius
    return _level_set(lambda x: _to_curve(x, curve) - radius, low, high)


def branching(random: np.random.Generator) -> pv.PolyData:
    """A trunk that forks twice."""
    pieces: list[tuple[Array, Array, float]] = []

    def grow(start: Array, direction: Array, length: float, radius: float, levels: int) -> None:
        end = start + length * direction
        pieces.append((start, end, radius))
        if levels:
            for _ in range(2):
                turned = direction + random.uniform(-0.9, 0.9, 3)
                grow(end, turned / np.linalg.norm(turned), 0.75 * length, 0.75 * radius, levels - 1)

    grow(np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.5, random.uniform(0.07, 0.12), 2)
    ends = np.array([p for piece in pieces for p in piece[:2]])

    def distance(x: Array) -> Array:
        # A smooth least of the distances leaves no edge where pieces meet.
        return -0.02 * np.log(sum(np.exp(-(_to_segment(x, a, b) - r) / 0.02) for a, b, r in pieces))

    return _level_set(distance, ends.min(axis=0) - 0.25, ends.max(axis=0) + 0.25)


def sheet(random: np.random.Generator) -> pv.PolyData:
    """Thin and wavy."""
    thickness, height = random.uniform(0.04, 0.07), random.uniform(0.05, 0.2)
    waves = random.uniform(1, 5, 2)
    half = np.array([0.5, random.uniform(0.3, 0.5)])

    def distance(x: Array) -> Array:
        middle = height * np.sin(waves[0] * x[:, 0]) * np.cos(waves[1] * x[:, 1])
        return np.maximum.reduce([np.abs(x[:, 2] - middle) - thickness / 2, *(np.abs(x[:, :2]) - half).T])

    reach = np.array([*(half + 0.05), height + 0.1])
    return _level_set(distance, -reach, reach)


def lump(random: np.random.Generator) -> pv.PolyData:
    """A ball whose radius waves."""
    waves = [
        (random.uniform(2, 7, 3), random.uniform(0, 2 * np.pi), random.uniform(0.03, 0.12)) for _ in range(6)
    ]

    def distance(x: Array) -> Array:
        r = np.linalg.norm(x, axis=1)
        direction = x / np.maximum(r, 1e-9)[:, None]
        return r - 0.6 - sum(a * np.sin(direction @ k + phase) for k, phase, a in waves)

    return _level_set(distance, np.full(3, -1.4), np.full(3, 1.4))


_PRISMS = (plate, bracket, tube)
FAMILIES: dict[str, Callable[[np.random.Generator], pv.PolyData]] = {
    f.__name__: f for f in (plate, bracket, anchor, tube, knot, branching, sheet, lump)
}
