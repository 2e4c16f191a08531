"""Measures of shape against closed forms, and independent of how vertices are numbered."""

import numpy as np
import pytest
import pyvista as pv
import shapely
from scipy.stats import wasserstein_distance

from analysis.shape_measures import (
    curvature_histogram,
    earth_movers_distance,
    mass_properties,
    mean_curvatures,
    shared_edges,
    silhouette_differences,
    surface_distance,
)
from analysis.silhouette import silhouette

SIZE = np.array([1.0, 2.0, 0.5])


def box(size=(1, 1, 1), at=(0, 0, 0), n=1):
    """Its middle at a point, n by n squares a side."""
    mesh = pv.Box(level=n - 1).triangulate().clean()
    return np.array(mesh.points, dtype=float) / 2 * size + at, np.array(mesh.regular_faces)


def sphere(radius=1.0, at=(0, 0, 0), nsub=4):
    mesh = pv.Icosphere(radius=1, nsub=nsub)
    X = np.array(mesh.points, dtype=float)
    return radius * X / np.linalg.norm(X, axis=1, keepdims=True) + at, np.array(mesh.regular_faces)


def torus(ring=1.0, tube=0.4, n=96):
    """Points at equal angles; with them the angle around the tube, 0 outside."""
    around, about = np.meshgrid(*[np.arange(n) * 2 * np.pi / n] * 2, indexing="ij")
    distance = ring + tube * np.cos(about)
    X = np.stack(
        [distance * np.cos(around), distance * np.sin(around), tube * np.sin(about)], axis=-1
    ).reshape(-1, 3)
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index, np.roll(index, -1, 0), np.roll(index, (-1, -1), (0, 1)), np.roll(index, -1, 1)
    F = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return (X, F), about.ravel()


def renumbered(surface):
    """The same body: vertices, triangles and the first corner of each in another order."""
    X, F = surface
    random = np.random.default_rng(5)
    order = random.permutation(len(X))
    place = np.argsort(order)
    turned = np.array([np.roll(triangle, random.integers(3)) for triangle in place[F]])
    return X[order], turned[random.permutation(len(F))]


def rotation():
    q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def test_box_has_the_volume_area_centre_and_inertia_of_its_formulas():
    a, b, c = SIZE
    R, at = rotation(), np.array([70.0, -3, 5])
    X, F = box(SIZE, n=3)
    found = mass_properties((X @ R.T + at, F))
    assert found.volume == pytest.approx(a * b * c)
    assert found.area == pytest.approx(2 * (a * b + b * c + c * a))
    assert found.centre == pytest.approx(at)
    of_axes = a * b * c / 12 * np.diag([b * b + c * c, c * c + a * a, a * a + b * b])
    assert found.inertia == pytest.approx(R @ of_axes @ R.T, abs=1e-9)


def test_ellipsoid_approaches_its_formulas_with_the_square_of_the_edges():
    a, b, c = SIZE
    volume = 4 / 3 * np.pi * a * b * c
    inertia = volume / 5 * np.array([b * b + c * c, c * c + a * a, a * a + b * b])
    errors = []
    for nsub in (3, 4):
        X, F = sphere(nsub=nsub)
        found = mass_properties((X * SIZE, F))
        assert np.linalg.norm(found.centre) < 1e-12
        errors.append([found.volume / volume - 1, *(np.diag(found.inertia) / inertia - 1)])
        assert found.inertia - np.diag(np.diag(found.inertia)) == pytest.approx(np.zeros((3, 3)), abs=1e-3)
    assert np.abs(errors[1]).max() < 0.01
    assert np.divide(*errors) == pytest.approx([4] * 4, rel=0.03)


def test_a_cavity_is_left_out():
    outer, (X, F) = box((2, 2, 2)), box((1, 1, 1), at=(0.25, 0, 0))
    found = mass_properties((np.vstack([outer[0], X]), np.vstack([outer[1], F[:, ::-1] + len(outer[0])])))
    assert found.volume == pytest.approx(7) and found.area == pytest.approx(30)
    assert found.centre == pytest.approx([-0.25 / 7, 0, 0])
    about_x = 8 * 8 / 12 - 2 / 12
    about_y = 8 * 8 / 12 - 2 / 12 - 0.25**2 - 7 * (0.25 / 7) ** 2
    assert np.diag(found.inertia) == pytest.approx([about_x, about_y, about_y])


def test_distance_of_a_tilted_plane_is_uniform():
    square = (
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    tilted = square[0] + np.outer(square[0][:, 0], [0, 0, 0.3]), square[1]
    found = surface_distance(tilted, square, n=40).there
    assert found.mean == pytest.approx(0.15) and found.largest == pytest.approx(0.3)
    assert found.quantile_95 == pytest.approx(0.95 * 0.3, abs=0.3 / 40)


def test_areas_weigh_distances():
    """Half of a square lies a metre off, in one pair of triangles, the other half touches, in two hundred."""
    x = np.concatenate([[0, 0.5], np.linspace(0.5, 1, 101)])
    height = np.where(np.arange(len(x)) < 2, 1.0, 0.0)
    X = np.concatenate([np.stack([x, np.full(len(x), y), height], axis=1) for y in (0.0, 1.0)])
    k = np.delete(np.arange(len(x) - 1), 1)
    F = np.concatenate(
        [np.stack([k, k + 1, k + 1 + len(x)], 1), np.stack([k, k + 1 + len(x), k + len(x)], 1)]
    )
    plane = (
        np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], dtype=float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    found = surface_distance((X, F), plane).there
    assert found == pytest.approx((0.5, 1, 1))


def test_distance_of_a_shifted_box_is_that_of_its_formula():
    d = 0.25
    found = surface_distance(box(n=16), box(at=(d, 0, 0), n=16))
    # The hindmost face lies d off, the foremost as far as its borders at most, the sides where they stick out.
    mean = (2 * d + 4 / 3 * d**3) / 6
    for side in (found.there, found.back):
        assert side.mean == pytest.approx(mean, rel=1e-3)
        assert side.quantile_95 == pytest.approx(d) and side.largest == pytest.approx(d)
    assert found.mean == pytest.approx(mean, rel=1e-3)


def test_distance_is_told_both_ways():
    found = surface_distance(box(), box((3, 3, 3)), n=20)
    assert found.there == pytest.approx((1, 1, 1))
    assert found.back.largest == found.hausdorff == pytest.approx(np.sqrt(3))
    side = np.linspace(-1.5, 1.5, 401)
    x, y = (np.maximum(np.abs(k) - 0.5, 0) for k in np.meshgrid(side, side))
    outside = np.sqrt(1 + x**2 + y**2).ravel()
    assert found.back.mean == pytest.approx(outside.mean(), rel=5e-3)
    assert found.quantile_95 == found.back.quantile_95 == pytest.approx(np.quantile(outside, 0.95), rel=5e-3)


def test_spheres_within_each_other_are_as_far_apart_as_their_radii():
    found = surface_distance(sphere(1.0, nsub=3), sphere(1.25, nsub=3))
    for side in (found.there, found.back):
        assert side.mean == pytest.approx(0.25, rel=0.02) and side.largest == pytest.approx(0.25, rel=0.05)


def test_silhouettes_of_a_shifted_box_differ_across_the_shift_alone():
    d = 0.25
    assert silhouette_differences(box(), box(at=(d, 0, 0))) == pytest.approx(
        [0, 2 * d / (1 + d), 2 * d / (1 + d)]
    )
    assert silhouette_differences(box(), box(at=(0, 3, 0))) == pytest.approx([1, 0, 1])  # side by side


def test_silhouettes_of_ellipsoids_differ_by_their_areas():
    X, F = sphere()
    found = silhouette_differences((X, F), (X * [1, 2, 0.5], F))
    # Half axes of the ellipses along y: 0.5 and 1 within the circle; along z: 1 and 2 around it; along x they cross.
    across = np.linspace(0, 1, 100_001)
    shared = 4 * np.trapezoid(np.minimum(np.sqrt(1 - across**2), 0.5 * np.sqrt(1 - across**2 / 4)), across)
    union = 2 * np.pi - shared
    assert found == pytest.approx([1 - shared / union, 0.5, 0.5], abs=3e-3)


def test_a_hole_belongs_to_the_silhouette():
    (X, F), _ = torus()
    disc = pv.Cylinder(radius=1.4, height=0.1, direction=(0, 0, 1), resolution=96).triangulate().clean()
    found = silhouette_differences((X, F), (np.array(disc.points, dtype=float), disc.regular_faces))
    assert found[2] == pytest.approx(0.6**2 / 1.4**2, rel=2e-3)


def test_a_silhouette_of_folds_is_valid_and_covers_their_triangles():
    ball = pv.Sphere(theta_resolution=12, phi_resolution=12).triangulate().clean()
    # Of 4,500 such bodies the one whose triangles had an invalid union.
    X = ball.points + 0.3 * np.random.default_rng(72).standard_normal(ball.points.shape) * 0.2
    F = ball.regular_faces
    covered = silhouette(X, F, np.eye(3))
    assert covered.is_valid
    points = shapely.points(np.random.default_rng(1).uniform(-1, 1, (20_000, 2)))
    hit = np.zeros(len(points), bool)
    for triangle in shapely.polygons(X[F][:, :, :2]):
        hit |= shapely.contains(triangle, points)
    assert (shapely.contains(covered, points) == hit).mean() > 0.9999
    assert covered.area == pytest.approx(4 * hit.mean(), rel=0.02)


def test_curvature_of_a_sphere_is_one_over_its_radius():
    for radius in (0.5, 3.0):
        X, F = sphere(radius)
        curvatures, areas = mean_curvatures((X, F))
        assert curvatures == pytest.approx(np.full(len(X), 1 / radius), rel=2e-3)
        assert areas.sum() == pytest.approx(mass_properties((X, F)).area)
        assert mean_curvatures((X, F[:, ::-1]))[0] == pytest.approx(-curvatures)


def test_curvature_of_ellipsoid_and_torus_is_that_of_their_formulas():
    X, F = sphere(nsub=5)
    X = X * SIZE
    curvatures, areas = mean_curvatures((X, F))
    a, b, c = SIZE
    normal = ((X / SIZE**2) ** 2).sum(axis=1)
    exact = (a**2 + b**2 + c**2 - (X**2).sum(axis=1)) / (2 * (a * b * c) ** 2 * normal**1.5)
    assert np.average(np.abs(curvatures - exact), weights=areas) < 0.01 * np.average(exact, weights=areas)
    ring, tube = 1.0, 0.4
    surface, about = torus(ring, tube)
    curvatures, areas = mean_curvatures(surface)
    exact = (ring + 2 * tube * np.cos(about)) / (2 * tube * (ring + tube * np.cos(about)))
    assert exact.min() < 0.5 < 1.5 < exact.max()
    assert np.average(np.abs(curvatures - exact), weights=areas) < 0.01 * np.average(exact, weights=areas)


def test_hollows_have_a_negative_curvature():
    surface, about = torus(1.0, 0.7)  # at the hole it curves in more than out
    curvatures, _ = mean_curvatures(surface)
    assert (curvatures[np.cos(about) < -0.9] < 0).all() and (curvatures[np.cos(about) > 0] > 0).all()


def test_obtuse_triangles_share_out_their_whole_area():
    X = np.array([[0, 0, 0], [4, 0, 0], [2, 0.5, 0], [2, 0.2, 1]], dtype=float)
    surface = X, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    areas = mean_curvatures(surface)[1]
    assert (areas > 0).all() and areas.sum() == pytest.approx(mass_properties(surface).area)


def test_a_triangle_without_area_changes_nothing():
    X, F = sphere(nsub=3)
    middle = (X[F[0, 0]] + X[F[0, 1]]) / 2
    # One triangle is cut at the middle of an edge, and the gap that this leaves is filled by one of three points in a line.
    a, b, c = F[0]
    m = len(X)
    cut = np.array([[a, m, c], [m, b, c], [a, b, m]])
    curvatures, areas = mean_curvatures((np.vstack([X, middle]), np.vstack([cut, F[1:]])))
    expected, _ = mean_curvatures((X, F))
    far = ~np.isin(np.arange(m), F[0])
    assert np.isfinite(curvatures).all() and areas.sum() == pytest.approx(mass_properties((X, F)).area)
    assert curvatures[:-1][far] == pytest.approx(expected[far])


def test_histograms_of_spheres_are_one_bin_each_and_as_far_apart_as_their_curvatures():
    edges = np.linspace(0, 3, 301)
    first, second = (curvature_histogram(sphere(radius), edges) for radius in (1.0, 0.5))
    assert first.sum() == pytest.approx(1)
    assert first[98:102].sum() == pytest.approx(1) and second[198:202].sum() == pytest.approx(1)
    assert earth_movers_distance(first, second, edges) == pytest.approx(1, abs=0.02)
    beyond = curvature_histogram(sphere(0.1), edges)
    assert beyond[-1] == pytest.approx(1)


def test_areas_weigh_histograms():
    """Of two spheres, one of twice the radius and a sixteenth of the vertices, the larger has four fifths of the area."""
    (X, F), (Y, G) = sphere(2.0, nsub=3), sphere(1.0, at=(9, 0, 0), nsub=5)
    both = np.vstack([X, Y]), np.vstack([F, G + len(X)])
    shares = curvature_histogram(both, np.array([0.4, 0.75, 1.1]))
    assert shares == pytest.approx([0.8, 0.2], abs=3e-3)


def test_earth_movers_distance_is_that_of_scipy():
    random = np.random.default_rng(4)
    edges = np.cumsum(random.uniform(0.1, 2, 31))
    first, second = (values / values.sum() for values in random.uniform(size=(2, 30)))
    middles = (edges[1:] + edges[:-1]) / 2
    expected = wasserstein_distance(middles, middles, first, second)
    assert earth_movers_distance(first, second, edges) == pytest.approx(expected)
    assert earth_movers_distance(first, first, edges) == 0


def test_shared_edges_hold_all_but_a_hundredth_of_every_surface():
    surfaces = [sphere(1.0), sphere(0.25), torus()[0]]
    edges = shared_edges(surfaces, 50)
    assert len(edges) == 51 and edges[0] < 0.5 and edges[-1] > 4
    for surface in surfaces:
        curvatures, areas = mean_curvatures(surface)
        inside = (curvatures > edges[0]) & (curvatures < edges[-1])
        assert areas[inside].sum() > 0.98 * areas.sum()
    alone = shared_edges([sphere(2.0)])
    assert (np.diff(alone) > 0).all()


def test_no_measure_depends_on_how_a_body_is_numbered():
    X, F = sphere(nsub=3)
    random = np.random.default_rng(7)
    bumpy = X * (1 + 0.1 * random.uniform(size=(len(X), 1))), F
    other, again = box((1.5, 1.2, 1.4), n=4), renumbered(bumpy)
    for a, b in zip(mass_properties(bumpy), mass_properties(again), strict=True):
        assert a == pytest.approx(b, abs=1e-12)
    for a, b in zip(surface_distance(bumpy, other), surface_distance(again, other), strict=True):
        assert a == pytest.approx(b)
    assert silhouette_differences(bumpy, other) == pytest.approx(silhouette_differences(again, other))
    edges = shared_edges([bumpy, other])
    assert edges == pytest.approx(shared_edges([again, other]))
    assert curvature_histogram(bumpy, edges) == pytest.approx(curvature_histogram(again, edges))
    same = surface_distance(bumpy, again)
    assert same.hausdorff < 1e-6 and silhouette_differences(bumpy, again) == pytest.approx(
        np.zeros(3), abs=1e-9
    )
