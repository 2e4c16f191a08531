"""The loads of the accuracy study: balance against quadrature and closed forms, parts, and scenes on cut triangles."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from analysis.compare import triangle_normals
from analysis.studies.accuracy_loads import (
    CUTTABLE,
    FREE,
    HELD,
    balance,
    of_cut_surface,
    part_at,
    resultant,
    scene_of,
    smooth_stress,
)
from analysis.studies.bodies import moments, random_of

# 3 x 2 x 1 m, a corner at (1, 1, 1), outward.
BOX = np.array([[1 + 3 * (i & 1), 1 + (i & 2), 1 + (i >> 2)] for i in range(8)], dtype=float)
SIDES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6],
     [1, 3, 5], [3, 7, 5]]
)  # fmt: skip
# Seven points of a triangle, exact to degree 5 [Radon 1948].
_A, _B = (6 - np.sqrt(15)) / 21, (6 + np.sqrt(15)) / 21
POINTS = [(1 / 3, 1 / 3, 1 / 3, 9 / 40)]
for side, share in ((_A, (155 - np.sqrt(15)) / 1200), (_B, (155 + np.sqrt(15)) / 1200)):
    POINTS += [(*np.roll([1 - 2 * side, side, side], k), share) for k in range(3)]


def resultant_of(terms, X, F):
    """Force and torque of a polynomial stress on all triangles by quadrature, and the sum of its forces' sizes."""
    total, size = np.zeros(6), 0.0
    normals = triangle_normals(X, F)
    for *corners, share in POINTS:
        x = np.einsum("i,tij->tj", corners, X[F])
        force = np.zeros_like(x)
        for power, (xx, yy, zz, yz, xz, xy) in terms:
            stress = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            force += share * np.prod(x ** np.array(power), axis=1)[:, None] * (normals @ stress)
        total += [*force.sum(axis=0), *np.cross(x, force).sum(axis=0)]
        size += np.abs(force).sum()
    return total, size


def test_resultant_is_that_of_a_pulled_side():
    top = SIDES[2:4]  # 6 m2 at z = 2
    load = resultant(BOX, top, np.tile([0, 5.0, 0], (2, 1)))
    np.testing.assert_allclose(load, [0, 30, 0, *np.cross([2.5, 2, 2], [0, 30, 0])], rtol=1e-13)


def test_balance_is_that_of_any_load_wherever_the_body_lies():
    load = np.array([1.0, 2, 3, 4, 5, 6])
    total, _ = resultant_of(balance(BOX, SIDES, load).items(), BOX, SIDES)
    np.testing.assert_allclose(total, -load, rtol=1e-11)


def test_smooth_stress_is_in_equilibrium_and_fills_all_components(ball):
    terms = smooth_stress(random_of("any"))
    assert max(sum(power) for power in terms) == 3  # no more than a scene takes
    X = ball[0] * [0.3, 0.2, 0.5]
    total, size = resultant_of(terms.items(), X, ball[1])
    assert np.abs(total).max() < 1e-12 * size
    assert (np.abs(np.array(list(terms.values()))).max(axis=0) > 0).all()
    assert smooth_stress(random_of("other"))[1, 0, 0][0] != terms[1, 0, 0][0]


def test_part_holds_its_share_about_the_farthest_vertex_or_a_triangle(ball):
    X, F = ball
    part = part_at(X, F, np.array([0, 0, 2.0]), 0.2)
    assert part.centre == pytest.approx([0, 0, 1])
    assert part.is_in.sum() == pytest.approx(0.2 * len(X), abs=15)  # rings of a symmetric ball
    assert (part.is_in == (np.linalg.norm(X - [0, 0, 1], axis=1) < part.radius)).all()
    few = part_at(BOX, SIDES, np.array([1.0, 1, 1]), 0.01)
    assert len(few.triangles(SIDES)) > 0


def balance_of(scene, X, F):
    """Force and torque left of all loads of a scene over their size."""
    volume, first, _ = moments(X, F)
    g = 1000 * np.array(scene.get("gravity", [0, 0, 0]))
    total, size = np.concatenate([volume * g, np.cross(first, g)]), volume * np.abs(g).sum()
    for load in scene["loads"]:
        if "stress" in load:
            more = resultant_of([(row[:3], row[3:]) for row in load["stress"]], X, F)
            total, size = total + more[0], size + more[1]
            continue
        sphere, found = load["region"]["sphere"], []
        for triangle in F:
            if all(np.linalg.norm(X[i] - sphere["center"]) <= sphere["radius"] for i in triangle):
                found.append(triangle)
        assert found
        for a, b, c in found:
            normal = np.cross(X[b] - X[a], X[c] - X[a]) / 2
            force = np.array(load["traction"]) * np.linalg.norm(normal) - load["pressure"] * normal
            total += np.concatenate([force, np.cross((X[a] + X[b] + X[c]) / 3, force)])
            size += np.abs(force).sum()
    return np.abs(total).max() / size


@pytest.mark.parametrize("load", FREE)
def test_free_bodies_are_in_balance(load, ball):
    X, F = ball[0] * [0.5, 0.3, 0.2] + [1e-3, 0, 0], ball[1]
    scene = tomllib.loads(scene_of(load, "any", Path("ball.ply"), X, F))
    assert "supports" not in scene
    assert scene["loads"]
    assert balance_of(scene, X, F) < 1e-10
    if load != "smooth":
        del scene["loads"][-1]
        assert balance_of(scene, X, F) > 1e-3


def test_opposite_pulls_of_parts_of_unequal_area_are_equal_forces(ball):
    X, F = ball[0] * [0.5, 0.3, 0.2], ball[1]
    X = np.where(X[:, :1] > 0, [1.5, 0.5, 0.5], 1.0) * X  # one end is longer and thinner
    scene = tomllib.loads(scene_of("opposite", "any", Path("ball.ply"), X, F))
    forces, areas = [], []
    for pull in scene["loads"][:2]:
        sphere = pull["region"]["sphere"]
        is_in = np.linalg.norm(X - sphere["center"], axis=1) <= sphere["radius"]
        areas.append(np.linalg.norm(triangle_normals(X, F[is_in[F].all(axis=1)]), axis=1).sum())
        forces.append(np.array(pull["traction"]) * areas[-1])
    assert abs(areas[0] / areas[1] - 1) > 0.1
    np.testing.assert_allclose(forces[0], -forces[1], rtol=1e-9)


@pytest.mark.parametrize("load", HELD)
def test_a_part_of_the_others_is_held_and_something_moves_them(load, ball):
    X, F = ball[0] * [0.5, 0.3, 0.2], ball[1]
    scene = tomllib.loads(scene_of(load, "any", Path("ball.ply"), X, F))
    held, *moved = scene["supports"]
    assert not any(held.get("displacement", [0]))
    assert bool(moved) == (load == "held_moved") and bool(moved or scene.get("loads") or "gravity" in scene)
    for support in moved:
        distance = np.linalg.norm(np.subtract(*(s["region"]["sphere"]["center"] for s in (held, support))))
        assert distance > held["region"]["sphere"]["radius"] + support["region"]["sphere"]["radius"]


def test_name_alone_draws_a_load(ball):
    scenes = [scene_of("held_gravity", name, Path("ball.ply"), *ball) for name in ("a", "a", "b")]
    assert scenes[0] == scenes[1] != scenes[2]


@pytest.mark.parametrize("load", CUTTABLE)
def test_cut_surface_is_the_same_body_held_at_the_same_edges(load, ball):
    X, F = ball
    text = scene_of(load, "any", Path("ball.ply"), X, F)
    cut, finer, triangles = of_cut_surface(text, Path("cut.ply"), X, F)
    assert (finer[: len(X)] == X).all()
    assert len(triangles) == 4 * len(F) and len(finer) == len(X) + 3 * len(F) / 2
    assert moments(finer, triangles)[0] == pytest.approx(moments(X, F)[0], rel=1e-12)
    normals = triangle_normals(finer, triangles)
    assert np.einsum("ti,ti->t", normals, np.tile(triangle_normals(X, F), (4, 1))).min() > 0

    def held(scene, points):
        """By displacement, the points that a scene's supports hold."""
        found = {}
        for support in tomllib.loads(scene).get("supports", []):
            sphere = support["region"]["sphere"]
            near = np.linalg.norm(points - sphere["center"], axis=1) <= sphere["radius"]
            found.setdefault(tuple(support.get("displacement", [0.0] * 3)), set()).update(
                np.flatnonzero(near)
            )
        return found

    before, after = held(text, X), held(cut, finer)
    assert before.keys() == after.keys()
    for moved, vertices in before.items():
        assert {i for i in after[moved] if i < len(X)} == vertices
        edges = {
            frozenset(edge) for a, b, c in F for edge in ((a, b), (b, c), (c, a)) if set(edge) <= vertices
        }
        assert len(after[moved]) == len(vertices) + len(edges)
    assert tomllib.loads(cut)["surface"]["file"] == "cut.ply"
    assert tomllib.loads(cut).get("loads") == tomllib.loads(text).get("loads")
