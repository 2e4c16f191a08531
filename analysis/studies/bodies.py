"""Bodies that nobody chose: families of shapes whose measures a seed draws, each triangulated in four ways.

Half of them, picked by a hash of their name, are there to learn from. The other half is measured for final tables only.
Prisms are polygons with holes, drawn out; all others are level sets of a distance. A body's longest side is 1 m.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mapbox_earcut as earcut
import numpy as np
import pyacvd
import pyvista as pv

from ..runs import Array

SEEDS = (1, 2, 3)
TRIANGULATIONS = ("coarse", "even", "graded", "cad")
#: Vertices that a triangulation starts from; a body that needs more gets more.
_VERTICES = {"coarse": 300, "even": 1200, "graded": 800}
_FINE = 0.02  # longest edge of what they are chosen from, over the longest side
_GRID = 60  # cells of a level set along the longest side
_ROUND = 24  # corners of a circle

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
    def is_kept_back(self) -> bool:
        """By family and seed, so that no triangulation of a judged body was learnt from."""
        return hashlib.sha256(f"{self.family}-{self.seed}".encode()).digest()[0] % 2 == 1


def bodies() -> list[Body]:
    return [Body(family, seed, way) for family in FAMILIES for seed in SEEDS for way in TRIANGULATIONS]


def write_body(body: Body, folder: Path) -> Path:
    """The file of a body's surface, made where it is not there yet."""
    file = folder / f"{body.name}.ply"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        # A string's own hash differs from run to run.
        random = np.random.default_rng([body.seed, *body.family.encode()])
        part = file.with_suffix(".part.ply")
        triangulate(FAMILIES[body.family](random), body.triangulation).save(part)
        part.rename(file)
    return file


def triangulate(raw: pv.PolyData, way: str) -> pv.PolyData:
    """A closed surface anew; "cad" keeps it as it is, with its needles."""
    if way == "cad":
        return raw
    fine = raw.subdivide_adaptive(max_edge_len=_FINE, max_n_passes=12).clean()
    n = _VERTICES[way]
    while n < fine.n_points:
        if way == "graded" or n > 3 * _VERTICES[way]:  # flat parts get long triangles, bent ones short
            found = fine.decimate(1 - 2 * n / fine.n_cells, volume_preservation=True)
        else:
            clusters = pyacvd.Clustering(fine)
            clusters.cluster(n)
            found = clusters.create_mesh()
        found = _normalised(found)
        if found.is_manifold and found.n_open_edges == 0:
            return found
        n = 3 * n // 2  # too few for its thin parts
    return fine


def _normalised(surface: pv.PolyData) -> pv.PolyData:
    surface = surface.triangulate().clean().compute_normals(auto_orient_normals=True, point_normals=False)
    points = surface.points.astype(float)
    return pv.PolyData((points - points.min(axis=0)) / np.ptp(points, axis=0).max(), surface.faces)


def _circle(x: float, y: float, radius: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def _prism(outline: Array, holes: list[Array], height: float) -> pv.PolyData:
    """A polygon, its holes cut out, drawn out; its faces are cut along the polygon's own corners alone."""
    loops = [outline, *holes]
    ends = np.cumsum([len(loop) for loop in loops])
    flat = np.vstack(loops)
    n = len(flat)
    face = earcut.triangulate_float64(flat, ends.astype(np.uint32)).reshape(-1, 3)
    here = np.arange(n)
    following = here + 1
    following[ends - 1] = ends - [len(loop) for loop in loops]
    sides = np.vstack([np.column_stack([here, following, following + n]), np.column_stack([here, following + n, here + n])])
    both = np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (0, height)])
    return _normalised(pv.PolyData.from_regular_faces(both, np.vstack([face, face + n, sides])))


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
    for a, b in zip(points[:-1], points[1:], strict=True):
        np.minimum(nearest, _to_segment(x, a, b), out=nearest)
    return nearest


def plate(random: np.random.Generator) -> pv.PolyData:
    width, thickness = random.uniform(0.4, 1), random.uniform(0.05, 0.12)
    columns, rows = random.integers(2, 5), random.integers(1, 4)
    pitch = np.array([1 / columns, width / rows])
    radius = random.uniform(0.15, 0.38) * pitch.min()
    holes = [_circle(*((np.array([i, j]) + 0.5) * pitch), radius) for i in range(columns) for j in range(rows)]
    return _prism(np.array([[0, 0], [1, 0], [1, width], [0, width]]), holes, thickness)


def bracket(random: np.random.Generator) -> pv.PolyData:
    """An angle with a hole near its corner."""
    leg, thick, depth = random.uniform(0.5, 1), random.uniform(0.1, 0.2), random.uniform(0.2, 0.6)
    gusset = random.uniform(0.1, 0.3)
    outline = [[0, 0], [1, 0], [1, thick], [thick + gusset, thick], [thick, thick + gusset], [thick, leg], [0, leg]]
    return _prism(np.array(outline), [_circle(0.8 * thick, 0.8 * thick, 0.4 * thick)], depth)


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
    """A pipe, open at both ends, that bends."""
    bend, outer = random.uniform(0.5, 2.2), random.uniform(0.1, 0.18)
    inner = random.uniform(0.5, 0.75) * outer
    angle = np.linspace(0, bend, 40)
    axis = np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle]) / bend
    ends = [(axis[0], axis[0] - axis[1]), (axis[-1], axis[-1] - axis[-2])]

    def distance(x: Array) -> Array:
        d = _to_curve(x, axis)
        beyond = [(x - p) @ (n / np.linalg.norm(n)) for p, n in ends]
        near = [np.where(np.linalg.norm(x - p, axis=1) < 2 * outer, b, -1) for b, (p, _) in zip(beyond, ends, strict=True)]
        return np.maximum.reduce([d - outer, inner - d, *near])

    return _level_set(distance, axis.min(axis=0) - 1.3 * outer, axis.max(axis=0) + 1.3 * outer)


def knot(random: np.random.Generator) -> pv.PolyData:
    p, q = [(2, 3), (3, 2), (2, 5)][random.integers(3)]
    radius = random.uniform(0.05, 0.08) * (2 if q < 5 else 1.5)
    t = np.linspace(0, 2 * np.pi, 160)
    r = 1 + 0.45 * np.cos(q * t)
    curve = np.column_stack([r * np.cos(p * t), r * np.sin(p * t), 0.45 * np.sin(q * t)])
    return _level_set(lambda x: _to_curve(x, curve) - radius, curve.min(axis=0) - 2 * radius, curve.max(axis=0) + 2 * radius)


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
    waves = [(random.uniform(2, 7, 3), random.uniform(0, 2 * np.pi), random.uniform(0.03, 0.12)) for _ in range(6)]

    def distance(x: Array) -> Array:
        r = np.linalg.norm(x, axis=1)
        direction = x / np.maximum(r, 1e-9)[:, None]
        return r - 0.6 - sum(a * np.sin(direction @ k + phase) for k, phase, a in waves)

    return _level_set(distance, np.full(3, -1.4), np.full(3, 1.4))


FAMILIES: dict[str, Callable[[np.random.Generator], pv.PolyData]] = {
    f.__name__: f for f in (plate, bracket, anchor, tube, knot, branching, sheet, lump)
}
