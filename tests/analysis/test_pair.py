"""Any two results on one surface: who reads them, how they are matched, and what is refused."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from pages import fetched
from PIL import Image
from synthetic import write_run

from analysis.__main__ import parse_arguments
from analysis.foreign import read_result
from analysis.pair import curves_of, main, match
from analysis.runs import RunError

STRETCH, NU, SIZE = 0.01, 0.3, 1 / 3


def stretched(X):
    """Displacement of a bar pulled along z, free to contract."""
    return STRETCH * np.array([-NU, -NU, 1]) * X


@pytest.fixture(scope="module")
def cube():
    """Rest points (27, 3) and hexahedra of a cube of 2 x 2 x 2 elements, and the triangles of its surface."""
    grid = pv.ImageData(dimensions=(3, 3, 3), spacing=(SIZE / 2,) * 3).cast_to_unstructured_grid()
    hexahedra = grid.cells_dict[pv.CellType.VOXEL][:, [0, 1, 3, 2, 4, 5, 7, 6]]
    grid.point_data["number"] = np.arange(27)
    surface = grid.extract_surface(algorithm="dataset_surface").triangulate()
    return np.array(grid.points, dtype=float), hexahedra, surface.point_data["number"][surface.regular_faces]


def write_vtk(file, X, F, u, is_moved=False):
    mesh = pv.PolyData.from_regular_faces(X + u if is_moved else X, F)
    mesh.point_data["displacement"] = u
    mesh.save(file)
    return file


def write_febio(file, X, u, separator=" "):
    """As FEBio's DataRecord does: six digits, a block for each step."""
    text = ""
    for step, share in ((1, 0.5), (2, 1)):
        text += f"*Step  = {step}\n*Time  = {share:g}\n*Data  = x;y;z;ux;uy;uz\n"
        for node, (x, v) in enumerate(zip(X, share * u, strict=True), 1):
            text += separator.join([str(node), *(f"{value:g}" for value in (*(x + v), *v))]) + "\n"
    file.write_text(text)
    return file


@pytest.mark.skipif(not shutil.which("ccx"), reason="needs CalculiX")
def test_calculix_pulls_a_bar_as_the_closed_form_says(cube, tmp_path):
    X, hexahedra, F = cube
    number = 7 * np.arange(1, 28)  # with gaps, as meshers leave them
    constrained = [(number[i], c + 1) for i in range(27) for c in range(3) if X[i, c] == 0]
    pulled = number[X[:, 2] == X[:, 2].max()]

    def step(share):
        loads = [f"{node}, 3, 3, {share * STRETCH * SIZE:.9e}" for node in pulled]
        return ["*STEP", "*STATIC", "*BOUNDARY", *loads, "*NODE FILE", "U", "*EL FILE", "S", "*END STEP"]

    lines = [
        "*NODE, NSET=ALL",
        *(f"{n}, {', '.join(map(repr, x.tolist()))}" for n, x in zip(number, X, strict=True)),
    ]
    lines += ["*ELEMENT, ELSET=BODY, TYPE=C3D8"]
    lines += [f"{e}, {', '.join(map(str, number[cell]))}" for e, cell in enumerate(hexahedra, 1)]
    lines += [
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"1e5, {NU}",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=M",
        "*BOUNDARY",
    ]
    lines += [*(f"{node}, {c}, {c}" for node, c in constrained), *step(0.5), *step(1)]
    (tmp_path / "job.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "-i", "job"], cwd=tmp_path, check=True, capture_output=True)
    exact = read_result(write_vtk(tmp_path / "exact.vtp", X, F, stretched(X)))
    for pair in (
        match(read_result(tmp_path / "job.frd"), exact),
        match(exact, read_result(tmp_path / "job.frd")),
    ):
        values = pair.as_json()
        assert values["displacement_error_max"] < 1e-5  # six digits
        assert values["n_vertices"] == 26  # the node within belongs to no triangle
        volume = (1 + STRETCH) * (1 - NU * STRETCH) ** 2 - 1
        assert values["of_model"]["volume_change"] == pytest.approx(volume, rel=1e-4)


@pytest.mark.parametrize("separator", [" ", ", "])
def test_febios_log_holds_moved_points_and_its_last_step_counts(separator, cube, tmp_path):
    X, _, F = cube
    log = read_result(write_febio(tmp_path / "nodes.txt", X, stretched(X), separator))
    assert log.rests[0] == pytest.approx(X, abs=1e-6)
    assert log.u == pytest.approx(stretched(X), rel=1e-5)
    exact = read_result(write_vtk(tmp_path / "exact.vtp", X, F, stretched(X)))
    assert match(log, exact).as_json()["displacement_error_max"] < 1e-5


@pytest.mark.parametrize("is_moved", [True, False])
@pytest.mark.parametrize("suffix", ["vtp", "vtk"])
def test_points_of_a_vtk_file_may_be_at_rest_or_moved(suffix, is_moved, ball, tmp_path):
    X, F = ball
    mixed = np.random.default_rng(1).permutation(len(X))
    place = np.argsort(mixed)
    file = write_vtk(tmp_path / f"model.{suffix}", X[mixed], place[F], 0.012 * X[mixed], is_moved)
    reference = read_result(write_run(tmp_path / "run", X, F, lambda X: 0.01 * X))
    values = match(read_result(file), reference).as_json()
    assert values["displacement_error_l2"] == pytest.approx(0.2, rel=1e-5)
    assert values["of_model"]["volume_change"] == pytest.approx(1.012**3 - 1, rel=1e-4)


def test_solid_of_a_vtk_file_is_compared_on_its_surface(cube, tmp_path):
    X, hexahedra, _ = cube
    for name, factor in (("model", 1.5), ("reference", 1)):
        solid = pv.UnstructuredGrid({pv.CellType.HEXAHEDRON: hexahedra}, X)
        solid.point_data["U"] = factor * stretched(X)
        solid.save(tmp_path / f"{name}.vtu")
    values = match(*(read_result(tmp_path / f"{name}.vtu") for name in ("model", "reference"))).as_json()
    assert values["n_vertices"] == 26
    assert values["displacement_error_l2"] == pytest.approx(0.5)


def test_two_runs_are_compared_over_all_that_they_hold(ball, tmp_path, capsys):
    folders = [
        write_run(tmp_path / name, *ball, lambda X, size=size: size * X)
        for name, size in (("model", 0.012), ("reference", 0.01))
    ]
    words = ["compare", *map(str, folders), "--out", str(tmp_path / "out")]
    assert main(parse_arguments(words)) == 0
    assert "by 20 % (at worst 20 %, rigid motion removed)" in capsys.readouterr().out
    values = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert values["runs"]["volume_change_error"] == pytest.approx(0.2, rel=0.01)
    report = (tmp_path / "out" / "report.html").read_text()
    assert "by 20 % (at worst 20 %" in report and not fetched(report)
    # Both bodies, the reference first; the scale, the spread of the error, and the curves.
    assert report.count("data:image/png") == 2 and report.count("data:image/svg+xml") == 3
    reference, model = (f"<b>{folder}</b>" for folder in reversed(folders))
    assert report.index(reference) < report.index(model) and "error 20 %" in report
    assert (tmp_path / "out" / "view.html").exists() and 'href="view.html"' in report
    pictures = [
        np.asarray(Image.open(file).convert("RGB"), dtype=int)[260, 240]
        for file in (tmp_path / "out" / "body_fem_reference.png", tmp_path / "out" / "body_model.png")
    ]
    assert np.ptp(pictures[0]) < 20 and np.ptp(pictures[1]) > 100  # clay, and the colour of 20 %


def test_rigid_motion_that_supports_leave_free_is_removed_from_two_runs(ball, tmp_path):
    """Of a body that rolls along x alone the shift along x means nothing, that along y does."""
    record = {"is_free": True, "free_motions": [[1, 0, 0, 0, 0, 0]]}
    folders = [
        write_run(tmp_path / name, *ball, lambda X, shift=shift: 0.01 * X + shift, **record)
        for name, shift in (("model", np.array([0.7, 0.02, 0])), ("reference", np.array([0.1, 0, 0])))
    ]
    for folder in folders:
        (folder / "scene.toml").write_text('[[supports]]\ncomponents = "yz"\n')
    pair = match(*map(read_result, folders))
    assert pair.as_json()["displacement_error_l2"] == pytest.approx(2, rel=1e-6)
    assert pair.as_json()["runs"]["displacement_error_l2"] == pytest.approx(2, rel=1e-6)


def test_rigid_motion_of_a_free_run_is_removed_from_a_file_too(ball, tmp_path):
    X, F = ball
    run = write_run(tmp_path / "run", X, F, stretched)
    run.joinpath("scene.toml").write_text("[time]\nmode = 'static'\n")
    file = read_result(write_vtk(tmp_path / "moved.vtp", X, F, stretched(X) + np.array([0.1, 0, 0])))
    for pair in (match(file, read_result(run)), match(read_result(run), file)):
        assert pair.as_json()["displacement_error_max"] < 1e-6
        assert pair.as_json()["rigid_motion_removed"]


def test_tip_of_both_is_the_vertex_that_the_reference_moves_farthest(ball, tmp_path):
    X, F = ball
    top, bottom = X[:, 2].argmax(), X[:, 2].argmin()
    u, v = np.zeros_like(X), np.zeros_like(X)
    u[top], u[bottom], v[top], v[bottom] = [0, 0, 0.01], [0, 0, 0.03], [0, 0, 0.02], [0, 0, 0.004]
    files = [read_result(write_vtk(tmp_path / f"{name}.vtp", X, F, w)) for name, w in (("u", u), ("v", v))]
    values = match(*files).as_json()
    assert values["of_model"]["tip_displacement"] == pytest.approx(0.01, rel=1e-6)
    assert values["of_reference"]["tip_displacement"] == pytest.approx(0.02, rel=1e-6)


def test_curves_of_two_runs_are_drawn_as_they_were_written(drawn, ball, tmp_path):
    from analysis.drawing import plots

    times = np.linspace(0, 1, 3)
    for name, factor in (("model", 0.02), ("reference", 0.01)):
        write_run(tmp_path / name, *ball, lambda X, factor=factor: factor * X, times, calibration="affine")
    drawn(plots)
    runs = [read_result(tmp_path / name) for name in ("model", "reference")]
    volumes, *_ = curves_of(match(*runs)).axes
    drawn_lines = {line.get_label(): line.get_ydata()[-1] for line in volumes.lines}
    assert drawn_lines[runs[0].name] == pytest.approx(100 * (1.02**3 - 1))
    assert drawn_lines[runs[1].name] == pytest.approx(100 * (1.01**3 - 1))
    foreign = read_result(write_vtk(tmp_path / "end.vtp", *ball, 0.01 * ball[0]))
    assert curves_of(match(foreign, runs[1])) == ""


def test_vertices_without_a_node_are_counted(ball, tmp_path):
    X, F = ball
    moved = X.copy()
    moved[[3, 50, 77]] *= 1.1
    pair = [
        read_result(write_vtk(tmp_path / f"{name}.vtp", points, F, 0.01 * X))
        for name, points in (("model", moved), ("reference", X))
    ]
    with pytest.raises(
        RunError, match=r"3 of 642 vertices of .*reference.vtp have no node of .*model.vtp within"
    ):
        match(*pair)


def test_nodes_shared_by_vertices_are_counted(ball, tmp_path):
    X, F = ball
    doubled = np.vstack([X, X[:2]])
    cracked = np.where(np.arange(len(F))[:, None] == 0, np.where(F < 2, F + len(X), F), F)
    assert (cracked >= len(X)).any()
    reference = read_result(write_vtk(tmp_path / "reference.vtp", doubled, cracked, 0.01 * doubled))
    with pytest.raises(RunError, match=r"vertices of .* share a node of .*, expected one for each"):
        match(read_result(write_febio(tmp_path / "nodes.txt", X, 0.01 * X)), reference)


def test_two_results_without_triangles_are_refused(ball, tmp_path):
    X, _ = ball
    result = read_result(write_febio(tmp_path / "nodes.txt", X, 0.01 * X))
    with pytest.raises(RunError, match="hold nodes alone, expected the surface's triangles in one"):
        match(result, result)


@pytest.mark.parametrize(
    "name, text, message",
    [
        (
            "a.frd",
            "    2C\n -1         1 0.0 x\n",
            r"a.frd:2: '-1         1 0.0 x', expected a node and three numbers",
        ),
        ("a.frd", "    2C\n -1" + f"{1:10d}" + f"{0:12.5E}" * 3 + "\n -3\n", "1 nodes and 0 displacements"),
        (
            "a.txt",
            "*Data  = ux;uy;uz\n1 0 0 0\n",
            r'a.txt: data ux;uy;uz, expected FEBio.s <node_data data="x;y;z;ux',
        ),
        ("a.txt", "*Data  = x;y;z;ux;uy;uz\n1 0 0 a 0 0 0\n", r"a.txt:2: '1 0 0 a 0 0 0', expected FEBio"),
        ("a.txt", "*Data  = x;y;z;ux;uy;uz\n1 0 0 nan 0 0 0\n", "a position or displacement is not finite"),
    ],
)
def test_damaged_file_is_one_error_with_its_place(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(RunError, match=message):
        read_result(tmp_path / name)


@pytest.mark.parametrize("share", [0.9, 0.99, 0.9995])
@pytest.mark.parametrize("binary", [True, False])
def test_cut_vtk_file_is_one_error(binary, share, ball, tmp_path):
    X, F = ball
    mesh = pv.PolyData.from_regular_faces(X, F)
    mesh.point_data["displacement"] = stretched(X)
    file = tmp_path / "a.vtk"
    mesh.save(file, binary=binary)
    assert read_result(file).u == pytest.approx(stretched(X), abs=1e-7)
    os.truncate(file, int(share * file.stat().st_size))
    with pytest.raises(RunError, match=r"a\.vtk: damaged or cut") as told:
        read_result(file)
    assert "\n" not in str(told.value)


_DAMAGE = {
    "NumberOfPoints": ('NumberOfPoints="642"', 'NumberOfPoints="-3"'),
    "NumberOfPolys": ('NumberOfPolys="1280"', 'NumberOfPolys="4000000000"'),
    "NumberOfComponents": ('NumberOfComponents="3"', 'NumberOfComponents="4294967295"'),
    "nested": ("<Piece", "<a>" * 500_000 + "<Piece"),
}


@pytest.mark.parametrize("damage", _DAMAGE)
def test_vtk_file_that_crashes_its_reader_or_takes_all_memory_is_one_error(damage, ball, tmp_path):
    file = write_vtk(tmp_path / "a.vtp", *ball, stretched(ball[0]))
    data, (old, new) = file.read_bytes(), _DAMAGE[damage]
    assert old.encode() in data
    file.write_bytes(data.replace(old.encode(), new.encode()))
    with pytest.raises(RunError, match=r"a\.vtp: ") as told:
        read_result(file)
    assert "\n" not in str(told.value)


def test_corner_beyond_the_points_is_named(ball, tmp_path):
    X, F = ball[0], np.array(ball[1])
    F[3, 1] = 700
    file = tmp_path / "a.vtk"
    corners = "\n".join(" ".join(map(str, (3, *f))) for f in F)
    points, moved = ("\n".join(" ".join(map(repr, map(float, x))) for x in values) for values in (X, 0.1 * X))
    file.write_text(
        f"# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS {len(X)} double\n{points}\n"
        f"POLYGONS {len(F)} {4 * len(F)}\n{corners}\nPOINT_DATA {len(X)}\nVECTORS displacement double\n{moved}\n"
    )
    with pytest.raises(RunError, match=r"a\.vtk: a cell has point 700, expected 0 to 641"):
        read_result(file)


def test_log_cut_within_its_last_number_is_refused(cube, tmp_path):
    X, _, _ = cube
    file = write_febio(tmp_path / "log.txt", X, stretched(X))
    read_result(file)
    os.truncate(file, file.stat().st_size - 3)
    with pytest.raises(RunError, match="the last line has no end"):
        read_result(file)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.vtk")
    for path in (tmp_path / "pipe.vtk", Path("/dev/zero")):
        with pytest.raises(RunError, match="missing, expected the folder of a run"):
            read_result(path)


def test_vtk_file_without_a_displacement_lists_its_arrays(ball, tmp_path):
    mesh = pv.PolyData.from_regular_faces(*ball)
    mesh.point_data["heat"] = np.zeros(mesh.n_points)
    mesh.save(tmp_path / "a.vtp")
    with pytest.raises(RunError, match=r"a.vtp: arrays heat, expected 'displacement' of 3 components"):
        read_result(tmp_path / "a.vtp")
    with pytest.raises(RunError, match=r"nowhere.frd: missing, expected the folder of a run"):
        read_result(tmp_path / "nowhere.frd")


def with_scene(folder, nu, pressure, **method):
    folder.joinpath("scene.toml").write_text(
        f"[material]\nnu = {nu}\n[[loads]]\npressure = {pressure}\n[time]\nmode = 'static'\nload_steps = {method['steps']}\n"
        f"[network]\nk = {method['k']}\n"
    )
    return folder


def test_runs_of_different_problems_are_compared_with_a_warning_that_names_the_keys(ball, tmp_path, capsys):
    a, b, c = (write_run(tmp_path / name, *ball, lambda X: 0.01 * X) for name in "abc")
    with_scene(a, 0.45, 10, steps=5, k=7)
    with_scene(b, 0.25, 20, steps=1, k=8)
    with_scene(c, 0.45, 10, steps=1, k=8)
    main(parse_arguments(["compare", str(a), str(b), "--out", str(tmp_path / "out")]))
    warning = (
        "Warning: two problems are compared, which differ in loads.0.pressure (10 against 20) and "
        "material.nu (0.45 against 0.25)."
    )
    assert warning in capsys.readouterr().out
    assert warning in (tmp_path / "out" / "report.html").read_text()
    main(parse_arguments(["compare", str(a), str(c), "--out", str(tmp_path / "out")]))
    assert "Warning" not in capsys.readouterr().out
    with c.joinpath("scene.toml").open("a") as scene:
        scene.write("[[obstacles]]\nfriction = 0.5\n")
    for one, other in ((a, c), (c, a)):
        main(parse_arguments(["compare", str(one), str(other), "--out", str(tmp_path / "out")]))
        assert "which differ in obstacles.0.friction (" in capsys.readouterr().out
