"""The bodies of the accuracy study: sound surfaces, the same wherever they are made, in halves that stay what they are."""

import hashlib
import os
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
import pyvista as pv

from analysis.paths import ROOT
from analysis.studies import bodies as made
from analysis.studies.bodies import (
    _PRISMS,
    FAMILIES,
    Body,
    _circle,
    _fine,
    _is_usable,
    _prism,
    _shape,
    bodies,
    moments,
    random_of,
    triangulate,
    write_body,
)


def test_every_body_stands_once_and_only_prisms_are_kept_as_they_are_drawn():
    names = [body.name for body in bodies()]
    assert len(set(names)) == len(names) == 3 * (3 * len(FAMILIES) + len(_PRISMS))
    drawn = {body.family for body in bodies() if body.triangulation == "cad"}
    assert drawn == {make.__name__ for make in _PRISMS}


def test_halves_are_those_of_a_hash_and_no_triangulation_leaves_its_half():
    halves = Counter(body.is_held_out for body in bodies())
    assert min(halves.values()) > 0.4 * halves.total()
    for family in FAMILIES:
        for seed in (1, 2, 3):
            odd = int(hashlib.sha256(f"{family}-{seed}".encode()).hexdigest()[:2], 16) % 2
            assert {Body(family, seed, way).is_held_out for way in ("coarse", "cad")} == {bool(odd)}
    # What has been learnt from stays so, whatever is added.
    assert not Body("plate", 1, "even").is_held_out
    assert Body("tube", 1, "even").is_held_out


@pytest.mark.parametrize("family", FAMILIES)
def test_bodies_are_closed_and_as_large_as_they_are_said_to_be(family, tmp_path):
    # Needles of prisms take seconds to cut.
    body = Body(family, 1, "cad" if FAMILIES[family] in _PRISMS else "coarse")
    surface = pv.read(write_body(body, tmp_path))
    X, F = surface.points.astype(float), surface.regular_faces
    assert surface.is_manifold and surface.n_open_edges == 0
    assert len(X) - 3 * len(F) / 2 + len(F) <= 2  # Euler's number of one component
    volume, first, _ = moments(X, F)
    assert volume > 0
    raw = FAMILIES[family](random_of(f"{family}-1"))
    assert volume == pytest.approx(raw.volume, rel=0.25)
    np.testing.assert_allclose(np.ptp(X, axis=0).max(), 1, rtol=1e-6)
    np.testing.assert_allclose(first / volume, 0, atol=1e-6)


def test_body_is_the_same_anywhere(tmp_path):
    body = Body("anchor", 2, "graded")
    one = write_body(body, tmp_path / "a").read_bytes()
    _shape.cache_clear()
    _fine.cache_clear()
    assert one == write_body(body, tmp_path / "b").read_bytes()
    assert one != write_body(Body("anchor", 3, "coarse"), tmp_path / "a").read_bytes()


def test_body_is_made_anew_where_what_makes_it_has_changed(tmp_path, monkeypatch):
    body = Body("bracket", 2, "cad")
    file = write_body(body, tmp_path)
    file.write_text("kept")
    assert write_body(body, tmp_path).read_text() == "kept"
    monkeypatch.setattr(made, "_hash_of_source", lambda: "changed")
    assert len(pv.read(write_body(body, tmp_path)).points) > 0


def test_shape_is_the_same_whatever_a_processor_can_do():
    code = "from analysis.studies.bodies import _shape\n"
    code += "print([_shape(family, 1).points.tobytes() for family in ('anchor', 'plate', 'tube')])"
    plain = {
        "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX2 FMA3",
        "OPENBLAS_CORETYPE": "Sandybridge",
    }
    one, other = (
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, **of},
            cwd=ROOT,
            check=True,
            stdout=subprocess.PIPE,
        )
        for of in ({}, plain)
    )
    assert one.stdout == other.stdout


def test_prism_has_the_volume_of_its_polygon_less_its_holes():
    outline = np.array([[0, 0], [2, 0], [2, 1], [0, 1]], dtype=float)
    prism = _prism([outline, _circle(0.5, 0.5, 0.2), _circle(1.5, 0.5, 0.3)], 0.5)
    polygons = sum(12 * r**2 * np.sin(2 * np.pi / 24) for r in (0.2, 0.3))
    assert prism.volume == pytest.approx((2 - polygons) * 0.5 / 2**3, rel=1e-9)  # its longest side is 1 m
    assert prism.n_points == 2 * (4 + 24 + 24)


@pytest.mark.parametrize("height, is_usable", [(0.02, False), (0.2, True)])
def test_triangles_folded_onto_their_neighbours_are_not_usable(height, is_usable):
    """Those of a cone meet its base at 1 and 11 degrees."""
    cone = pv.Cone(height=height, radius=1, resolution=24).triangulate().clean()
    assert _is_usable(cone) == is_usable


def test_triangulations_differ_as_they_are_called():
    raw = FAMILIES["bracket"](random_of("bracket-1"))
    assert triangulate(Body("bracket", 1, "cad")) == raw

    def lengths(way: str):
        surface = triangulate(Body("bracket", 1, way))
        corners = surface.points[surface.regular_faces]
        return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)

    coarse, graded = map(lengths, ("coarse", "graded"))
    assert len(coarse) < len(graded)
    assert graded.max() / np.median(graded) > 2 * coarse.max() / np.median(coarse)


def test_moments_are_those_of_a_box():
    box = pv.Box((0, 2, 0, 1, 0, 3)).triangulate()
    volume, first, second = moments(np.asarray(box.points, dtype=float), box.regular_faces)
    assert volume == pytest.approx(6)
    np.testing.assert_allclose(first, 6 * np.array([1, 0.5, 1.5]), rtol=1e-12)
    expected = 6 * np.outer([1, 0.5, 1.5], [1, 0.5, 1.5]) + np.diag(6 * np.array([4, 1, 9]) / 12)
    np.testing.assert_allclose(second, expected, rtol=1e-12)
