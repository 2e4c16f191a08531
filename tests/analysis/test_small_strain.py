"""Rotation and strain of surfaces whose deformation is known, and what they cost an answer of small strain."""

import numpy as np
import pytest

from analysis.small_strain import deformation_of, stays_below


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_a_turned_ball_has_its_angle_and_a_blown_up_one_its_strain(ball):
    X, F = ball
    found = deformation_of(X, F, X @ turned(0.3).T - X)
    assert found.rotation == pytest.approx(0.3, rel=1e-6)
    found = deformation_of(X, F, 0.02 * X)
    assert found.strain == pytest.approx(0.02, rel=1e-9)
    assert found.rotation == pytest.approx(0, abs=1e-7)


def test_a_small_rotation_of_linear_theory_strains_nothing(ball):
    X, F = ball
    found = deformation_of(X, F, np.cross([0, 0, 0.1], X))
    assert found.strain == pytest.approx(0, abs=1e-12)
    # Of the triangles that lie across the axis the angle is atan 0.1, of those along it less.
    assert found.rotation == pytest.approx(np.arctan(0.1), rel=1e-3)


def test_strain_is_the_largest_along_the_surface_in_any_direction(ball):
    X, F = ball
    found = deformation_of(X, F, X * [0.01, -0.03, 0.01])
    assert found.strain == pytest.approx(0.03, rel=0.01)  # on all triangles but those that face y
    X, F = strip()
    assert deformation_of(X, F, 0.02 * X[:, [1]] * [1, 0, 0]).strain == pytest.approx(0.01)  # of simple shear


def strip():
    """Of 100 squares in the plane of x and y."""
    x = np.arange(101.0)
    X = np.vstack([np.column_stack([x, 0 * x, 0 * x]), np.column_stack([x, 0 * x + 1, 0 * x])])
    F = np.array([t for k in range(100) for t in ((k, k + 1, 101 + k), (k + 1, 102 + k, 101 + k))])
    return X, F


def test_a_twentieth_of_the_surface_may_do_what_it_likes():
    """The first few squares stretch far more than the others."""
    X, F = strip()
    for n, strain in ((4, 0.01), (6, 0.5)):
        u = 0 * X
        u[:, 0] = 0.01 * X[:, 0] + 0.49 * np.minimum(X[:, 0], n)
        assert deformation_of(X, F, u).strain == pytest.approx(strain)


def test_large_triangles_count_with_their_area():
    """Of a weight of 13, 4 lies at 1, another 1 at 2, and the rest, which stands first, at 3."""
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([8.0, 4.0, 1.0])
    for share, least in ((0.3, 1), (4 / 13, 1), (0.35, 2), (5 / 13, 2), (0.4, 3), (0.9, 3)):
        assert stays_below(values, weights, share) == least


def test_error_is_that_of_a_cantilever_bent_far():
    """By an end load P L^2 / (E I) = 1: its slope is x - x^2 / 2 in linear theory, which bends it by 0.3333 L.

    The elastica of the same load bends by 0.3017 L.
    """
    x = np.linspace(0, 1, 51)
    X = np.vstack([np.column_stack([x, 0 * x, z + 0 * x]) for z in (0, 0.1)])
    F = np.array([t for k in range(50) for t in ((k, k + 1, 51 + k), (k + 1, 52 + k, 51 + k))])
    u = np.column_stack([0 * X[:, 0], X[:, 0] ** 2 / 2 - X[:, 0] ** 3 / 6, 0 * X[:, 0]])
    found = deformation_of(X, F, u)
    assert found.strain == pytest.approx(0, abs=1e-12)
    assert found.error(is_collapse=False) == pytest.approx(0.3333 / 0.3017 - 1, rel=0.1)


def test_strain_that_the_scene_prescribes_costs_nothing(ball):
    X, F = ball
    shrunk = deformation_of(X, F, -0.02 * X)
    assert shrunk.error(is_collapse=False) == pytest.approx(0.02)
    assert shrunk.error(is_collapse=True) == pytest.approx(0, abs=1e-12)
