"""Surfaces made anew from CAD and from broken scans."""

import itertools
import json
import sys
from collections import Counter

import numpy as np
import pytest
from plates import plate, plate_volume

from analysis import remesh as remeshing
from analysis.__main__ import parse_arguments
from analysis.remesh import Remeshed, read_off, remesh, remeshed_of, sentence_of
from analysis.runs import RunError

TWO_TETRAHEDRA = (  # that share a vertex: closed, but no surface of a body there
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float),
    np.array(
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 4, 5], [0, 6, 4], [0, 5, 6], [4, 6, 5]]
    ),
)  # fmt: skip


def write_obj(file, X, F):
    lines = [f"v {x} {y} {z}" for x, y, z in X] + [f"f {a} {b} {c}" for a, b, c in F + 1]
    file.write_text("\n".join(lines))
    return file


def test_a_plate_of_needles_becomes_an_even_surface_of_the_same_volume(tmp_path):
    file = write_obj(tmp_path / "plate.obj", *plate(2, 24))
    done = remesh(file, tmp_path / "even.off", edge=8, tolerance=0.5)
    assert done.before["volume"] == pytest.approx(plate_volume(2, 24), rel=1e-9)
    assert done.before["worst_aspect"] > 20 * done.after["worst_aspect"]
    assert done.before["sliver_triangles"] > 0 and done.after["sliver_triangles"] == 0
    assert done.after["volume"] == pytest.approx(plate_volume(2, 24), rel=0.02)
    assert max(done.to_old, done.to_new) < 1
    X, F = read_off(tmp_path / "even.off")
    assert (len(X), len(F)) == (done.after["vertices"], done.after["faces"])
    assert np.abs(X[:, 2] - 2.5).max() == pytest.approx(2.5, abs=0.5)


def test_the_generated_plate_is_as_thin_in_its_triangles_as_exported_cad(tmp_path):
    report = remeshing.checked(write_obj(tmp_path / "plate.obj", *plate(4, 48)))
    assert report["worst_aspect"] > 1000 and report["usable"]


def test_a_hole_is_closed(tmp_path, ball):
    X, F = ball
    done = remesh(write_obj(tmp_path / "open.obj", X, F[:-1]), tmp_path / "new.obj", edge=0.5, tolerance=0.05)
    assert "volume" not in done.before
    assert done.after["volume"] == pytest.approx(4 / 3 * np.pi, rel=0.1)


def test_what_closes_a_hole_is_far_from_the_old_surface_all_of_which_is_near_the_new_one(tmp_path, ball):
    X, F = ball
    open_above = F[(F != X[:, 2].argmax()).all(axis=1)]
    done = remesh(
        write_obj(tmp_path / "open.obj", X, open_above), tmp_path / "new.obj", edge=0.3, tolerance=0.02
    )
    assert 2 * done.to_new < done.to_old


def test_what_takes_too_long_is_stopped_and_leaves_nothing(tmp_path, ball):
    file = write_obj(tmp_path / "ball.obj", *ball)
    with pytest.raises(RunError, match=r"ball.obj: no surface in 1 s of remeshing"):
        remesh(file, tmp_path / "new.obj", edge=0.05, tolerance=1e-4, limit=1)
    assert not (tmp_path / "new.obj").exists()


def test_a_result_that_is_no_surface_is_refused_with_the_reason(tmp_path, ball, monkeypatch):
    X, F = TWO_TETRAHEDRA
    monkeypatch.setattr(remeshing, "_tetwild", lambda *_: (X, F[:-1]))
    file = write_obj(tmp_path / "ball.obj", *ball)
    with pytest.raises(RunError, match=r"ball.obj: .*3 edges have one triangle"):
        remesh(file, tmp_path / "new.obj")
    assert not (tmp_path / "new.obj").exists()


def test_parts_that_touch_in_a_vertex_are_set_apart(tmp_path, ball, monkeypatch):
    monkeypatch.setattr(remeshing, "_tetwild", lambda *_: TWO_TETRAHEDRA)
    file = write_obj(tmp_path / "ball.obj", *ball)
    done = remesh(file, tmp_path / "new.off", tolerance=0.01)
    assert done.n_parted == 1 and "set apart at 1 vertices and edges" in done.text
    assert (done.after["vertices"], done.after["components"], done.after["usable"]) == (8, 2, True)
    X, F = read_off(tmp_path / "new.off")
    moved = np.delete(X, range(1, 7), axis=0)
    assert np.linalg.norm(moved, axis=1) == pytest.approx([0.01, 0.01])
    assert sorted(moved.sum(axis=1) > 0) == [False, True]
    np.testing.assert_array_equal(X[1:7], TWO_TETRAHEDRA[0][1:])
    assert [sorted(np.unique(F[part])) for part in (slice(0, 4), slice(4, 8))] in (
        [[0, 1, 2, 3], [4, 5, 6, 7]],
        [[1, 2, 3, 7], [0, 4, 5, 6]],
    )


def boxes(cells):
    """The hull of unit cubes at whole coordinates: points, and triangles that face outward."""
    points, triangles = {}, []
    for cell in cells:
        for axis, side in itertools.product(range(3), (0, 1)):
            step = [0, 0, 0]
            step[axis] = 2 * side - 1
            if tuple(np.add(cell, step)) in cells:
                continue
            corners = []
            for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = [0, 0, 0]
                corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = side, u, v
                corners.append(points.setdefault(tuple(np.add(cell, corner)), len(points)))
            a, b, c, d = corners if side else corners[::-1]
            triangles += [[a, b, c], [a, c, d]]
    return np.array(list(points), dtype=float), np.array(triangles)


@pytest.mark.parametrize(
    "cells, n_edges, n_parts",
    [
        ([(0, 0, 0), (1, 1, 0)], 1, 2),
        ([(0, 0, 0), (1, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)], 1, 1),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], 3, 2),
    ],
)
def test_parts_that_touch_along_edges_are_set_apart(tmp_path, ball, monkeypatch, cells, n_edges, n_parts):
    X, F = boxes(cells)
    _, opened_F, n_opened = remeshing.opened(X, F, 0.01)
    assert n_opened == n_edges
    directed = Counter((t[c], t[(c + 1) % 3]) for t in opened_F.tolist() for c in range(3))
    assert set(directed.values()) == {1} and all((b, a) in directed for a, b in directed)
    monkeypatch.setattr(remeshing, "_tetwild", lambda *_: (X, F))
    done = remesh(write_obj(tmp_path / "ball.obj", *ball), tmp_path / "new.off", tolerance=0.01)
    assert done.after["usable"] and done.after["components"] == n_parts
    assert done.after["volume"] == pytest.approx(len(cells), abs=0.02 * n_edges)
    assert done.after["volume"] < len(cells)  # each middle is drawn into the body


def test_a_surface_of_single_fans_stays_as_it_is(ball):
    X, F = remeshing.parted(*ball, 1)
    np.testing.assert_array_equal(X, ball[0])
    np.testing.assert_array_equal(F, ball[1])


def test_a_worker_that_dies_is_named_by_its_last_line(tmp_path, ball, monkeypatch):
    monkeypatch.setattr(remeshing.sys, "executable", "/bin/false")
    with pytest.raises(RunError, match="fTetWild makes no tetrahedra of it: exit status 1"):
        remesh(write_obj(tmp_path / "ball.obj", *ball), tmp_path / "new.obj")


@pytest.mark.parametrize(
    "options, message",
    [
        ({"edge": -1.0}, "--edge -1.0, expected a length > 0"),
        ({"tolerance": float("nan")}, "--tolerance nan, expected a length > 0"),
        ({"out": "new.stl"}, r"new.stl: expected a name that ends in .obj or .off"),
        ({"surface": "nan.obj"}, "nan.obj:1: 'nan', expected a finite number"),
    ],
)
def test_what_cannot_be_remeshed_is_named(tmp_path, ball, options, message):
    write_obj(tmp_path / "ball.obj", *ball)
    (tmp_path / "nan.obj").write_text("v nan 0 0\n")
    surface, out = options.pop("surface", "ball.obj"), options.pop("out", "new.obj")
    with pytest.raises(RunError, match=message):
        remesh(tmp_path / surface, tmp_path / out, **options)


def test_a_run_remeshes_the_same_surface_once_and_says_so(tmp_path, ball, monkeypatch):
    made = []

    def stand_in(surface, out):
        made.append(surface)
        out.write_text("OFF")
        return Remeshed({"vertices": 9}, {"vertices": 642}, 0.1, 0.01, 0.004, 0.002, 2)

    monkeypatch.setattr(remeshing, "remesh", stand_in)
    file, folder = write_obj(tmp_path / "ball.obj", *ball), tmp_path / "run"
    new = remeshed_of(file, folder)
    assert remeshed_of(file, folder) == new and made == [file]
    assert new.stem == file.stem  # so that report and folder name the body
    sentence = sentence_of({"surface": {"file": str(new)}}, folder)
    assert "642 vertices" in sentence
    assert f"It lies at most 0.004 from {file}, and that at most 0.002 from it" in sentence
    assert "Parts that touched were set apart, at 2 vertices and edges." in sentence
    of_another = remeshed_of(file, tmp_path / "another")
    for other in (file, of_another):
        assert sentence_of({"surface": {"file": str(other)}}, folder) == ""
    file.write_text(file.read_text() + "\n# changed\n")
    remeshed_of(file, folder)
    assert len(made) == 3 and json.loads(new.with_suffix(".json").read_text())["done"]["edge"] == 0.1


def test_the_command_line_takes_lengths():
    arguments = parse_arguments(["remesh", "a.stl", "b.obj", "--edge", "2", "--tolerance", "0.1"])
    assert (arguments.edge, arguments.tolerance) == (2, 0.1)
    assert parse_arguments(["run", "--remesh"]).remesh and not parse_arguments(["run"]).remesh


def test_remeshing_loads_its_mesher_in_the_worker_alone():
    assert "pytetwild" not in sys.modules
