"""Distances, barriers, friction and times of impact of the surface's energies are those of IPC Toolkit."""

import itertools
import json
import os
import subprocess
from typing import Any

import ipctk
import numpy as np
import pytest

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    program = os.environ["SURFACE_ENERGY_VALUES"]  # of the build whose tests run
    return json.loads(subprocess.run([program], check=True, capture_output=True, text=True).stdout)


def points(flat: list[float]) -> np.ndarray:
    return np.reshape(flat, (-1, 3))


def test_barriers_and_their_derivatives_are_the_same(values):
    for case in values["barrier"]:
        kappa, gap, reach = case["kappa"], case["gap"], case["range"]
        assert case["energy"] == pytest.approx(kappa * ipctk.barrier(gap, reach), rel=1e-9)
        # A gap is the difference of lengths a thousand times as long.
        assert case["force"] == pytest.approx(-kappa * ipctk.barrier_first_derivative(gap, reach), rel=1e-9)
        assert case["stiffness"] == pytest.approx(
            kappa * ipctk.barrier_second_derivative(gap, reach), rel=1e-9
        )


def test_friction_is_the_same_below_and_above_the_slip(values):
    for case in values["barrier"]:
        limit = -case["friction"] * case["kappa"] * ipctk.barrier_first_derivative(case["gap"], case["range"])
        expected = limit * ipctk.smooth_friction_f0(case["slid"], case["slip"])
        tolerance = 1e-9 * (case["energy"] + expected)
        assert case["energy_slid"] - case["energy"] == pytest.approx(expected, abs=tolerance)
        slope = limit * ipctk.smooth_friction_f1(case["slid"], case["slip"])
        assert case["friction_force"] == pytest.approx(slope, rel=1e-6)


def test_steps_towards_a_plane_end_at_nine_tenths_of_the_time_of_impact(values):
    n_hits = 0
    for case in values["steps"]:
        x, dx = np.array(case["x"]), np.array(case["dx"])
        hits, time = ipctk.point_static_plane_ccd(
            x, x + dx, np.array(case["point"]), np.array(case["normal"]), conservative_rescaling=1.0
        )
        n_hits += hits
        if hits:
            assert case["step"] == pytest.approx(0.9 * time, rel=1e-9)
        else:
            assert 0.9 <= case["step"] <= 1
    assert 5 < n_hits < len(values["steps"])


def test_pairs_in_touch_their_distances_and_smoothing_are_the_same(values):
    n_edges = n_triangles = 0
    for case in values["pairs"]:
        x, rest, thickness = points(case["x"]), points(case["rest"]), case["thickness"]
        expected = {}
        for a, b in (((0, 1, 2), (3, 4, 5)), ((3, 4, 5), (0, 1, 2))):
            for v in a:
                squared = ipctk.point_triangle_distance(x[v], *x[list(b)])
                expected[(v,), b] = np.sqrt(squared), 1
        for e, f in itertools.product(
            itertools.combinations((0, 1, 2), 2), itertools.combinations((3, 4, 5), 2)
        ):
            i, j, k, m = x[[*e, *f]]
            bound = 1e-2 * np.sum((rest[e[1]] - rest[e[0]]) ** 2) * np.sum((rest[f[1]] - rest[f[0]]) ** 2)
            expected[e, f] = (
                np.sqrt(ipctk.edge_edge_distance(i, j, k, m)),
                ipctk.edge_edge_mollifier(i, j, k, m, bound),
            )
        expected = {pair: value for pair, value in expected.items() if value[0] < thickness}
        found = {}
        for pair in case["pairs"]:
            node = pair["node"]
            split = 2 if (node[0] < 3) == (node[1] < 3) else 1
            n_edges, n_triangles = n_edges + (split == 2), n_triangles + (split == 1)
            key = tuple(sorted(node[:split])), tuple(sorted(node[split:]))
            found[key] = pair["distance"], pair["stiffness"]
        assert set(found) == set(expected)
        energy = 0.0
        for key, (distance, smoothing) in expected.items():
            assert found[key] == pytest.approx((distance, smoothing), rel=1e-7, abs=ROUNDING)
            energy += smoothing * case["stiffness"] / 2 * (thickness - distance) ** 2
        assert case["energy"] == pytest.approx(energy, rel=1e-7)
    assert n_edges > 20
    assert n_triangles > 20


TRIANGLES = ((0, 1, 2), (3, 4, 5))


def pairs_of_triangles() -> list[tuple[bool, list[int]]]:
    """Whether it is one of edges, and its four nodes."""
    pairs = [(False, [v, *b]) for a, b in (TRIANGLES, TRIANGLES[::-1]) for v in a]
    edges = [list(itertools.combinations(t, 2)) for t in TRIANGLES]
    return pairs + [(True, [*e, *f]) for e, f in itertools.product(*edges)]


def test_energy_and_forces_of_the_barrier_between_two_triangles_are_the_same(values):
    n_pairs = {False: 0, True: 0}
    for case in values["self_barrier"]:
        x, rest, reach = points(case["x"]), points(case["rest"]), case["thickness"]
        area = np.repeat([np.linalg.norm(np.cross(b - a, c - a)) / 2 for a, b, c in rest.reshape(2, 3, 3)], 3)
        energy, forces = 0.0, np.zeros((6, 3))
        for is_edges, node in pairs_of_triangles():
            at, before = x[node], rest[node]
            squared = (ipctk.edge_edge_distance if is_edges else ipctk.point_triangle_distance)(*at)
            if squared >= reach**2:
                continue
            n_pairs[is_edges] += 1
            gradient = (
                ipctk.edge_edge_distance_gradient if is_edges else ipctk.point_triangle_distance_gradient
            )(*at)
            d = np.sqrt(squared)
            third = (area[node[0]] + area[node[2]]) / 2 / 3 if is_edges else area[node[0]] / 3
            stiffness = case["kappa"] * third / 4
            b = ipctk.barrier(d, reach)
            by_x = ipctk.barrier_first_derivative(d, reach) / (2 * d) * gradient
            m, dm = 1.0, np.zeros(12)
            if is_edges:
                bound = 1e-2 * np.sum((before[1] - before[0]) ** 2) * np.sum((before[3] - before[2]) ** 2)
                m = ipctk.edge_edge_mollifier(*at, bound)
                dm = ipctk.edge_edge_mollifier_gradient(*at, bound)
            energy += stiffness * m * b
            forces[node] -= stiffness * (m * by_x + b * dm).reshape(4, 3)
        assert case["energy"] == pytest.approx(energy, rel=1e-7)
        assert np.linalg.norm(points(case["forces"]) - forces) <= 1e-6 * np.linalg.norm(forces)
    assert min(n_pairs.values()) > 20


def test_largest_steps_of_two_triangles_end_shortly_before_the_time_of_impact(values):
    ccd = ipctk.TightInclusionCCD(conservative_rescaling=0.999)  # impacts themselves, and not shortly before
    n_hits = 0
    for case in values["self_barrier"]:
        x, dx = points(case["x"]), points(case["dx"])
        impact = almost = 1.0
        for is_edges, node in pairs_of_triangles():
            squared = (ipctk.edge_edge_distance if is_edges else ipctk.point_triangle_distance)(*x[node])
            find = ccd.edge_edge_ccd if is_edges else ccd.point_triangle_ccd
            ends = [*x[node], *(x + dx)[node]]
            hits, time = find(*ends)
            impact = min(impact, time if hits else 1.0)
            hits, time = find(*ends, min_distance=0.12 * min(np.sqrt(squared), case["thickness"]))
            almost = min(almost, time if hits else 1.0)
        n_hits += impact < 1
        assert 0.98 * almost <= case["step"] <= max(impact, almost)
    assert 5 < n_hits < len(values["self_barrier"])
