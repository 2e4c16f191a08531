"""Points of one triangulation found on another of the same surface."""

import numpy as np
import pytest
from synthetic import write_run

from analysis.runs import RunError, load_run
from analysis.surface_points import nearest_points, on_points_of


def finer(X, F):
    """The same polyhedron, its triangles cut in four."""
    edges, of_corner = np.unique(
        np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1),
        axis=0,
        return_inverse=True,
    )
    ab, bc, ca = len(X) + of_corner.reshape(3, -1)
    a, b, c = F.T
    parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.concatenate([X, X[edges].mean(axis=1)]), np.concatenate(
        [np.stack(part, axis=1) for part in parts]
    )


def nearest_by_sampling(triangle, point, n=200):
    """The least distance of a point from a triangle, on a grid of its barycentric coordinates."""
    a, b = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    inside = a + b <= 1
    weights = np.stack([a[inside], b[inside], 1 - a[inside] - b[inside]], axis=1)
    return np.linalg.norm(weights @ triangle - point, axis=1).min()


def test_nearest_points_are_those_of_brute_force(ball):
    X, F = ball
    X, F = X * [3, 1, 0.4], F
    random = np.random.default_rng(3)
    P = random.normal(size=(12, 3)) * [2, 1, 0.5]
    found, distances = nearest_points((X, F), (P, np.array([[0, 1, 2]])))
    assert found.weights.sum(axis=1) == pytest.approx(np.ones(12))
    assert found.weights.min() > -1e-9
    for point, distance in zip(P, distances, strict=True):
        brute = min(nearest_by_sampling(X[triangle], point, 40) for triangle in F)
        assert distance <= brute * (1 + 1e-9)
        assert distance == pytest.approx(brute, abs=0.02)


def test_a_linear_field_is_the_same_on_any_triangulation(ball, tmp_path):
    X, F = ball
    A = np.array([[0.1, 0.02, 0], [0, -0.1, 0.03], [0.05, 0, 0.2]])
    coarse = load_run(write_run(tmp_path / "coarse", X, F, lambda X: X @ A))
    fine = load_run(write_run(tmp_path / "fine", *finer(X, F), lambda X: X @ A))
    for run, reference in ((coarse, fine), (fine, coarse)):
        seen = on_points_of(run, reference)
        for k in range(len(run.times)):
            assert seen.frame(k).X is reference.last.X
            assert seen.frame(k).u == pytest.approx(reference.frame(k).u, abs=1e-12)


def test_one_triangulation_is_taken_as_it_is(ball, tmp_path):
    a = load_run(write_run(tmp_path / "a", *ball, lambda X: X))
    b = load_run(write_run(tmp_path / "b", *ball, lambda X: 2 * X))
    assert on_points_of(a, b) is a


def test_a_part_of_a_surface_is_not_the_surface(ball, tmp_path):
    """Every point of the one lies on the other, but not the other way round."""
    X, F = ball
    inner = F[X[F].mean(axis=1)[:, 2] < 0.5]
    a = load_run(write_run(tmp_path / "a", X, inner, lambda X: X))
    b = load_run(write_run(tmp_path / "b", X, F, lambda X: X))
    for run, reference in ((a, b), (b, a)):
        with pytest.raises(RunError, match="different surfaces"):
            on_points_of(run, reference)
