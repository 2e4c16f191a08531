"""Exports of a run whose every moment is known, read by VTK's reader of glTF, which knows nothing of ours."""

import json
import struct
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv
from PIL import Image
from synthetic import write_run
from vtkmodules.vtkIOGeometry import vtkGLTFReader

from analysis.__main__ import parse_arguments
from analysis.drawing import export
from analysis.drawing.gltf import frame_weights
from analysis.runs import RunError, load_run

SINGLE = 1e-6  # rounding of glTF's numbers, at a size of one
SCALE = 0.01  # m, a unit of the file


@pytest.fixture
def run(ball, tmp_path):
    """Shrinks to half in 2 s, faster in its middle; frames lie unevenly."""
    times = np.array([0, 0.5, 1, 1.2, 2])
    folder = write_run(tmp_path / "run", *ball, lambda X: X, times, shrunk, calibration="uniform")
    return load_run(folder)


def shrunk(time):
    return -0.5 * (time / 2) ** 2 * (3 - time)


def read_gltf(file, time):
    """Points (n, 3) and triangles at a time of the film."""
    reader = vtkGLTFReader()
    reader.SetFileName(str(file))
    reader.ApplyDeformationsToGeometryOn()
    reader.UpdateInformation()
    assert reader.GetNumberOfAnimations() == 1
    reader.EnableAnimation(0)
    reader.SetFrameRate(0)
    reader.UpdateInformation()
    reader.UpdateTimeStep(time)
    (mesh,) = (
        block for block in pv.wrap(reader.GetOutputDataObject(0)).recursive_iterator() if block.n_cells
    )
    return np.asarray(mesh.points, dtype=float), mesh.regular_faces


def document_of(file):
    """The file's JSON and the bytes that it describes."""
    data = file.read_bytes()
    magic, version, length, size = struct.unpack("<4sIII", data[:16])
    assert (magic, version, length) == (b"glTF", 2, len(data)) and length % 4 == 0
    document, kept = json.loads(data[20 : 20 + size]), data[20 + size + 8 :]
    assert document["buffers"] == [{"byteLength": len(kept)}]
    return document, kept


def exported(run, file, *more):
    words = ["export", str(run.folder), "--seconds", "4", "--out", str(file), *more]
    assert export.main(parse_arguments(words)) == 0
    return file


@pytest.mark.parametrize("is_reversed", [False, True])
def test_another_reader_finds_the_motion(run, ball, tmp_path, is_reversed):
    file = exported(run, tmp_path / "ball.glb", *["--reverse"] * is_reversed)
    for number, time in enumerate(run.times):
        points, triangles = read_gltf(file, 4 - 2 * time if is_reversed else 2 * time)
        np.testing.assert_allclose(points, (1 + shrunk(time)) * ball[0], atol=SINGLE, err_msg=str(number))
        np.testing.assert_array_equal(triangles, ball[1])


def test_a_warp_shows_the_simulation_at_its_times(run, ball, tmp_path):
    file = exported(run, tmp_path / "ball.glb", "--warp", "elastic")
    early = 2 * 0.25**2 * (3 - 2 * 0.25)  # s: a quarter of the film
    points, _ = read_gltf(file, 1)
    size = np.interp(early, run.times, 1 + shrunk(run.times))  # linear between frames
    np.testing.assert_allclose(points, size * ball[0], atol=SINGLE)


def test_points_and_triangles_are_the_files_own(run, ball, tmp_path):
    """A file with z upwards, in centimetres, whose first corner stands in it twice and whose triangles are turned about."""
    X, F = ball
    in_file = np.column_stack([X[:, 0], -X[:, 2], X[:, 1]]) / SCALE + (5, 0, 7)
    points = np.vstack([in_file, in_file[:1]])
    vertices = np.r_[np.arange(len(X)), 0]
    triangles = np.roll(F[::-1], 1, axis=1)
    triangles[triangles[:, 0] == 0, 0] = len(X)
    (run.folder / "scene.toml").write_text('[surface]\nfile = "ball.obj"\n')
    grid = pv.UnstructuredGrid({pv.CellType.TRIANGLE: triangles}, points)
    grid["vertex"] = vertices.astype(float)
    grid.save(run.folder / "surface_file.vtu")

    file = exported(run, tmp_path / "ball.glb")
    body, found = read_gltf(file, 4)
    np.testing.assert_allclose(body, (1 + shrunk(2)) * X[vertices], atol=SINGLE)
    np.testing.assert_array_equal(found, triangles)
    document, data = document_of(file)
    at_rest = np.frombuffer(data, "<f4", 3 * len(points))  # the first accessor, as the mesh says
    assert document["meshes"][0]["primitives"][0]["attributes"] == {"POSITION": 0}
    np.testing.assert_array_equal(at_rest, points.astype(np.float32).ravel())


def test_weights_of_frames_are_shares():
    run = SimpleNamespace(times=np.array([0, 1, 3.0]))
    weights = frame_weights(run, np.array([0, 0.25, 1, 2, 3]))
    expected = [[1, 0, 0], [0.75, 0.25, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1]]
    np.testing.assert_allclose(weights, expected)


def test_every_accessor_lies_in_the_buffer_and_tells_its_bounds(run, tmp_path):
    """What validators of glTF ask for, and few readers need."""
    file = exported(run, tmp_path / "ball.glb")
    document, data = document_of(file)
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        n = accessor["count"] * {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        assert view["byteOffset"] % 4 == 0 and view["byteLength"] == 4 * n
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        values = np.frombuffer(data, kind, n, view["byteOffset"]).reshape(accessor["count"], -1)
        np.testing.assert_array_equal(values.min(axis=0), accessor["min"])
        np.testing.assert_array_equal(values.max(axis=0), accessor["max"])
    n_targets = len(document["meshes"][0]["primitives"][0]["targets"])
    sampler = document["animations"][0]["samplers"][0]
    counts = [document["accessors"][sampler[key]]["count"] for key in ("input", "output")]
    assert counts == [101, 101 * n_targets] and n_targets == len(run.times)


def test_film_plays_for_its_seconds(run, tmp_path):
    file = tmp_path / "ball.gif"
    exported(run, file, "--format", "film", "--fps", "0.5", "--reverse")
    assert Image.open(file).n_frames == 3
    assert list(tmp_path.glob("*.gif")) == [file]


@pytest.mark.parametrize(
    "more, message",
    [
        (["--format", "film"], "expected the extension .gif"),
        (["--fps", "0"], "--fps 0, expected more than 0"),
        (["--seconds", "nan"], "--seconds nan, expected more than 0"),
    ],
)
def test_wrong_options_are_refused(run, tmp_path, more, message):
    words = ["export", str(run.folder), "--out", str(tmp_path / "ball.glb"), *more]
    with pytest.raises(RunError, match=message):
        export.main(parse_arguments(words))


def test_a_folder_of_several_runs_names_them(run):
    with pytest.raises(RunError, match=f"expected one of {run.folder}"):
        export.opened(run.folder.parent)


def test_a_files_surface_that_was_not_kept_is_refused(run, tmp_path):
    (run.folder / "scene.toml").write_text('[surface]\nfile = "ball.obj"\n')
    with pytest.raises(RunError, match=r"surface_file.vtu: missing, run the solver again"):
        exported(run, tmp_path / "ball.glb")
