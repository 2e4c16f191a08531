"""Remeshing: of a plate of needles, and of bodies that meet where no simulation can use it."""

import subprocess
import sys
import time

import numpy as np
import pytest
from plate import plate, write_off

from analysis import remesh as remeshing
from analysis.paths import PROGRAMS
from analysis.remesh import boundary_of, remesh, remeshed, separate, surface_file
from analysis.runs import RunError

CUBE = np.array([[x, y, z] for z in (0.0, 1) for y in (0.0, 1) for x in (0.0, 1)])
CUBE_TETS = np.array([[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]])


def volume_of(X, F):
    return np.einsum("ij,ij->", X[F[:, 0]], np.cross(X[F[:, 1]], X[F[:, 2]])) / 6


def n_edges(F):
    """How many triangles each edge has."""
    edges = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def test_boundary_of_a_cube_is_closed_and_outward():
    X, F = boundary_of(CUBE, CUBE_TETS)
    assert len(X) == 8 and len(F) == 12
    assert (n_edges(F) == 2).all()
    assert volume_of(X, F) == pytest.approx(1)


@pytest.mark.parametrize("shift, n_split", [((1, 1, 1), 1), ((1, 1, 0), 2)])
def test_bodies_that_meet_in_a_vertex_or_an_edge_alone_are_separated(shift, n_split):
    both = np.concatenate([CUBE, CUBE + shift])
    points, indices = np.unique(both, axis=0, return_inverse=True)
    tets = indices.ravel()[np.concatenate([CUBE_TETS, CUBE_TETS + 8])]
    V, T, found = separate(points, tets)
    assert found == n_split
    X, F = boundary_of(V, T)
    assert len(X) == 16 and (n_edges(F) == 2).all()
    assert len(np.unique(X, axis=0)) == 16  # readers join equal positions
    assert volume_of(X, F) == pytest.approx(2, rel=0.02)


def test_tetrahedra_that_share_a_face_stay_joined():
    assert separate(CUBE, CUBE_TETS)[2] == 0


def worst_aspect(X, F):
    a, b, c = (X[F[:, k]] for k in range(3))
    longest = np.max([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return (longest**2 / np.linalg.norm(np.cross(b - a, c - a), axis=1)).max()


def test_a_plate_of_needles_becomes_an_even_surface_near_it(tmp_path):
    X, F = plate(n_holes=1, n_sides=1200)
    assert worst_aspect(X, F) > 1000
    source, out = write_off(tmp_path / "plate.off", X, F), tmp_path / "even.off"
    done = remesh(source, out, edge=0.25, tolerance=0.02)
    assert (
        subprocess.run([PROGRAMS / "meshing", "check", out], capture_output=True, check=False).returncode == 0
    )
    assert done.new["worst_aspect"] < 15
    assert done.new["genus"] == 1
    assert done.to_old <= done.tolerance
    assert done.new["volume"] == pytest.approx(0.1 * (1 - np.pi * 0.45**2), rel=0.05)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["even.off", "plate.off"]


@pytest.fixture
def cheap(monkeypatch):
    """fTetWild's place is taken by a cube."""
    calls = []

    def fill(folder, X, F, edge, epsilon, limit, source):
        calls.append(source)
        return CUBE, CUBE_TETS

    monkeypatch.setattr(remeshing, "_fill", fill)
    return calls


def cube_file(folder):
    return write_off(folder / "cube.off", *boundary_of(CUBE, CUBE_TETS))


def test_distance_and_volumes_are_those_of_the_two_surfaces(tmp_path, cheap):
    X, F = boundary_of(CUBE, CUBE_TETS)
    done = remesh(write_off(tmp_path / "box.off", X * [1, 1, 1.5], F), tmp_path / "out.off")
    assert (done.old["volume"], done.new["volume"]) == pytest.approx((1.5, 1))
    assert done.to_new == pytest.approx(0.5)
    assert "33.3 % off" in done.text() and "old to new at most 0.5" in done.text()


def test_an_experiment_remeshes_a_file_once(tmp_path, cheap):
    source, folder = cube_file(tmp_path), tmp_path / "out"
    out, note = remeshed(source, folder, is_quiet=True)
    assert out == folder / "cube_remeshed.off" and "cube.off by remeshing" in note
    assert remeshed(source, folder, is_quiet=True) == (out, note)
    assert len(cheap) == 1
    write_off(source, *boundary_of(2 * CUBE, CUBE_TETS))
    remeshed(source, folder, is_quiet=True)
    assert len(cheap) == 2
    out.write_text("damaged")
    remeshed(source, folder, is_quiet=True)
    assert len(cheap) == 3


def test_the_file_to_remesh_is_that_of_the_scene_or_its_override(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text('[surface]\nfile = "body.off"\n')
    assert surface_file(scene, []) == tmp_path / "body.off"
    assert surface_file(scene, ["surface.file=other.off"]).name == "other.off"
    scene.write_text('[surface]\nshape = "ball"\n')
    with pytest.raises(RunError, match=r"surface.file is missing, expected a file to remesh"):
        surface_file(scene, [])


def test_what_takes_too_long_is_stopped_with_the_limit_and_what_would_help(tmp_path):
    source, out = write_off(tmp_path / "plate.off", *plate(1, 400)), tmp_path / "out.off"
    out.write_text("older")
    start = time.monotonic()
    with pytest.raises(RunError, match=r"took longer than 0.2 s; a longer --edge than"):
        remesh(source, out, limit=0.2)
    assert time.monotonic() - start < 60
    assert out.read_text() == "older"


def test_fill_that_aborts_is_an_error_with_its_last_line(tmp_path, monkeypatch):
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\necho noise >&2\necho 'terminate called: Facet' >&2\nkill -ABRT $$\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    with pytest.raises(RunError, match="fTetWild gave no tetrahedra: terminate called: Facet"):
        remesh(cube_file(tmp_path), tmp_path / "out.off")


def test_result_that_no_simulation_can_use_is_refused(tmp_path, monkeypatch):
    across = np.concatenate([CUBE, CUBE + 0.5])
    tets = np.concatenate([CUBE_TETS, CUBE_TETS + 8])
    monkeypatch.setattr(remeshing, "_fill", lambda *_: (across, tets))
    with pytest.raises(RunError, match=r"no simulation can use: .+ pairs of triangles intersect"):
        remesh(cube_file(tmp_path), tmp_path / "out.off")
    assert [file.name for file in tmp_path.iterdir()] == ["cube.off"]


@pytest.mark.parametrize(
    "options, words",
    [
        ({"edge": -1.0}, "--edge -1.0: expected a length above 0"),
        ({"tolerance": 0.0}, "--tolerance 0.0: expected"),
    ],
)
def test_lengths_that_are_none_are_refused(options, words, tmp_path):
    with pytest.raises(RunError, match=words):
        remesh(cube_file(tmp_path), tmp_path / "out.off", **options)


def test_names_and_files_that_cannot_serve_are_refused(tmp_path):
    with pytest.raises(RunError, match=r"expected a name that ends in .off or .obj"):
        remesh(cube_file(tmp_path), tmp_path / "out.stl")
    with pytest.raises(RunError, match=r"none.off"):
        remesh(tmp_path / "none.off", tmp_path / "out.off")
