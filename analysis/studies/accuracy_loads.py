"""Scenes of the accuracy study: bodies under loads whose places, directions and shapes a name draws.

A body is free, and what pulls it is balanced by a smooth traction all over its surface, or a part of it is held. Parts are
spheres about the vertex that lies farthest in some direction. Everything is linear, so that magnitudes mean nothing.
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..compare import triangle_normals
from ..runs import Array
from .bodies import moments, random_of

FREE = ("smooth", "gravity", "pressed", "opposite")
HELD = ("held_gravity", "held_pressed", "held_pulled", "held_moved")
#: Loads that mean the same on a surface whose triangles are cut in four.
CUTTABLE = ("smooth", "held_gravity", "held_moved")
_SCENE = """
[material]
E = 1e12 # Pa, at which floppy networks, too, stay at small strain
law = "small_strain"

[time]
load_steps = 1

[network]
estimate = false

[output]
frames_every = 0
"""
_HELD, _LOADED = 0.15, 0.1  # shares of the vertices
_GRAVITY, _STRESS, _MOVED = 100.0, 1e5, 1e-4  # m/s2, Pa, m
_DENSITY = 1000.0  # kg/m3, the scene's own
_DEGREE = 3  # of a smooth stress, the highest that a scene takes
_ALL = "box = { low = [-1, -1, -1], high = [2, 2, 2] }, relative = true"
_POINT = 1e-6  # m: the radius of a sphere that holds one vertex
Terms = dict[
    tuple[int, ...], Array
]  #: of a polynomial stress: exponents of a monomial, and its six components (Pa)


def resultant(X: Array, F: Array, tractions: Array) -> Array:
    """Force and torque about the origin (6) of a traction (m, 3) on each triangle."""
    forces = np.linalg.norm(triangle_normals(X, F), axis=1)[:, None] * tractions
    return np.concatenate([forces.sum(axis=0), np.cross(X[F].mean(axis=1), forces).sum(axis=0)])


def balance(X: Array, F: Array, load: Array) -> Terms:
    """A stress whose tractions all over the surface balance a force and torque about the origin.

    Its divergence is a + w x r, so that tractions resist like the body's own inertia.
    """
    volume, first, second = moments(X, F)
    turn = np.cross(np.eye(3), first)  # turn @ w = first x w
    inertia = np.trace(second) * np.eye(3) - second
    a, w = np.linalg.solve(np.block([[volume * np.eye(3), -turn], [turn, inertia]]), -load).reshape(2, 3)
    terms: Terms = defaultdict(lambda: np.zeros(6))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for coefficient, axes in ((a[i], [i]), (w[j], [i, k]), (-w[k], [i, j])):
            terms[tuple(int(axis in axes) for axis in range(3))][i] += coefficient
    return terms


def smooth_stress(random: np.random.Generator) -> Terms:
    """Terms of a random polynomial stress in equilibrium, from three functions of stress [Maxwell 1870]."""
    terms: Terms = defaultdict(lambda: np.zeros(6))
    powers = [p for p in np.ndindex(*[_DEGREE + 3] * 3) if 2 <= sum(p) <= _DEGREE + 2]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for power in powers:
            # The higher a power, the less it is of a body whose coordinates are about a half.
            coefficient = random.normal() * 2.0 ** sum(power)
            for first, second, component, sign in ((j, j, i, 1), (i, i, j, 1), (i, j, 3 + k, -1)):
                left = list(power)
                factor = sign * coefficient
                for axis in (first, second):
                    factor *= left[axis]
                    left[axis] -= 1
                if factor:
                    terms[tuple(left)][component] += _STRESS * factor
    return terms


@dataclass(frozen=True)
class Part:
    """The vertices within a sphere."""

    centre: Array
    radius: float
    is_in: Array  #: by vertex

    def triangles(self, F: Array) -> Array:
        return F[self.is_in[F].all(axis=1)]

    @property
    def region(self) -> str:
        return f"region = {{ sphere = {{ center = {_list(self.centre)}, radius = {self.radius!r} }} }}\n"


def part_at(X: Array, F: Array, direction: Array, share: float) -> Part:
    """About the vertex farthest in a direction: a share of the vertices, more where these hold no triangle."""
    top = X[(X @ direction).argmax()]
    distances = np.linalg.norm(X - top, axis=1)
    ordered = np.sort(distances)
    radius = max(ordered[round(share * len(X))], distances[F].max(axis=1).min())
    beyond = ordered[np.searchsorted(ordered, radius * (1 + 1e-6))]
    radius = float(radius + beyond) / 2  # no vertex lies on the sphere
    return Part(top, radius, distances < radius)


def scene_of(load: str, name: str, file: Path, X: Array, F: Array) -> str:
    """The scene of a load on the surface of a file; name: what draws it."""
    random = random_of(name)
    direction, oblique = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
    is_held, kind = load.startswith("held_"), load.removeprefix("held_")
    near = part_at(X, F, direction, _HELD if is_held else _LOADED)
    far = part_at(X, F, -direction, _HELD if kind == "moved" else _LOADED)
    parts = [f'[surface]\nfile = "{file}"\n{_SCENE}']
    force = np.zeros(6)  # to be balanced where nothing is held

    def pull(part: Part, traction: Array, pressure: float = 0) -> None:
        parts.append(f"[[loads]]\n{part.region}traction = {_list(traction)}\npressure = {pressure}\n")
        on = part.triangles(F)
        normals = triangle_normals(X, on)
        unit = normals / np.linalg.norm(normals, axis=1)[:, None]
        force[:] += resultant(X, on, traction - pressure * unit)

    if is_held:
        parts.append(_support(near))
    if kind == "gravity":
        volume, first, _ = moments(X, F)
        weight = _DENSITY * volume * _GRAVITY * oblique
        parts.insert(0, f"gravity = {_list(_GRAVITY * oblique)}\n")
        if not is_held:  # it hangs
            force[:] = [*weight, *np.cross(first / volume, weight)]
            pull(near, -weight / _area(X, near.triangles(F)))
    elif kind == "smooth":
        parts.append(_stressed(smooth_stress(random)))
    elif kind == "moved":
        parts.append(_support(far, _MOVED * oblique))
    elif kind == "pressed":
        pull(far, np.zeros(3), _STRESS)
    else:
        pull(far, _STRESS * oblique)
        if not is_held:
            shared = _area(X, far.triangles(F)) / _area(X, near.triangles(F))
            pull(near, -_STRESS * shared * oblique)
    if not is_held and force.any():
        parts.append(_stressed(balance(X, F, force)))
    return "\n".join(parts)


def of_cut_surface(scene: str, file: Path, X: Array, F: Array) -> tuple[str, Array, Array]:
    """The same scene on that surface with triangles cut in four, which a file is to hold: supports hold the same edges.

    The first vertices stay what they were.
    """
    edges, place = np.unique(
        np.sort(F[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0, return_inverse=True
    )
    middles = len(X) + place.reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = F.T, middles.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.vstack([X, X[edges].mean(axis=1)])
    head, *supports = scene.split("[[supports]]\n")
    lines = [re.sub(r'file = ".*"', f'file = "{file}"', head)]
    for support in supports:
        region, rest = support.split("\n", 1)
        sphere = tomllib.loads(region)["region"]["sphere"]
        held = np.linalg.norm(X - sphere["center"], axis=1) < sphere["radius"]
        for x in finer[np.concatenate([held, held[edges].all(axis=1)])]:
            lines.append(f"region = {{ sphere = {{ center = {_list(x)}, radius = {_POINT} }} }}\n{rest}")
    return "[[supports]]\n".join(lines), finer, np.vstack([np.column_stack(t) for t in corners])


def _area(X: Array, F: Array) -> float:
    return float(np.linalg.norm(triangle_normals(X, F), axis=1).sum())


def _list(values: Array) -> str:
    return str([float(value) for value in values])


def _support(part: Part, displacement: Array | None = None) -> str:
    moved = "" if displacement is None else f"displacement = {_list(displacement)}\n"
    return f'[[supports]]\n{part.region}components = "xyz"\n{moved}'


def _stressed(terms: Terms) -> str:
    """The traction of a stress all over the surface."""
    rows = ",\n".join(f"  {[*power, *map(float, stress)]}" for power, stress in terms.items())
    return f"[[loads]]\nregion = {{ {_ALL} }}\nstress = [\n{rows},\n]\n"
