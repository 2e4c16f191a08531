"""Runs that cannot be trusted are refused in one clear line."""

import json
import shutil

import numpy as np
import pytest
import pyvista as pv
from synthetic import N_STEPS, list_outputs, write_run

from analysis.runs import RunError, load_run


@pytest.fixture
def folder(ball, tmp_path):
    return write_run(tmp_path / "run", *ball, lambda X: 0.1 * X)


@pytest.mark.parametrize("record", [{}, {"n_patches": 5}, {"program": "fem_reference"}])
def test_surface_is_read_as_written(record, ball, tmp_path):
    """With springs, and with tetrahedra, below it."""
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: 0.1 * X, **record))
    assert len(run.times) == N_STEPS + 1
    assert (run.last.F == ball[1]).all()
    assert run.last.X == pytest.approx(ball[0], abs=1e-15)
    assert run.frame(0).u == pytest.approx(0 * ball[0], abs=0)
    assert run.last.u == pytest.approx(0.1 * ball[0], abs=1e-15)


@pytest.mark.parametrize(
    "record, waited", [({"cpu": 8.0, "wall": 10.0}, True), ({"cpu": 9.5, "wall": 10.0}, False), ({}, False)]
)
def test_run_that_waited_for_a_core_says_so(record, waited, ball, tmp_path):
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: 0.1 * X, **record))
    assert run.has_waited == waited


def split(folder):
    """Puts a surface's piece and that of the tetrahedron, in another order, in the place of a run's last frame."""
    whole = load_run(folder).grid(-1)
    n = int(whole.field_data["n_surface"][0])
    corners = whole.cells_dict[pv.CellType.TETRA]
    inner = np.roll(corners[0], 1)
    parts = [
        (np.arange(n), {pv.CellType.TRIANGLE: whole.cells_dict[pv.CellType.TRIANGLE]}),
        (inner, {pv.CellType.TETRA: (corners[:, :, None] == inner).argmax(axis=2)}),
    ]
    name = f"frame_{N_STEPS:06d}"
    for number, (nodes, cells) in enumerate(parts):
        piece = pv.UnstructuredGrid(cells, whole.points[nodes])
        for field in whole.point_data:
            piece[field] = whole[field][nodes]
        piece["node_id"], piece.field_data["n_surface"] = nodes, [n]
        piece.save(folder / "frames" / f"{name}_{number}.vtu")
    pieces = "".join(f'<Piece Source="{name}_{number}.vtu"/>' for number in range(2))
    (folder / "frames" / f"{name}.pvtu").write_text(f"<VTKFile>{pieces}</VTKFile>")
    (folder / "frames" / f"{name}.vtu").unlink()
    pvd = folder / "frames.pvd"
    pvd.write_text(pvd.read_text().replace(f"{name}.vtu", f"{name}.pvtu"))
    list_outputs(folder)
    return whole


def test_frame_in_pieces_is_read_as_a_whole_one(ball, tmp_path):
    folder = write_run(tmp_path / "run", *ball, lambda X: 0.1 * X, program="fem_reference")
    before = load_run(folder).last
    whole, run = split(folder), load_run(folder)
    grid = run.grid(-1)
    assert (grid.points == whole.points).all()
    for kind, cells in whole.cells_dict.items():
        assert (grid.cells_dict[kind] == cells).all()
    for name in ("rest_position", "displacement"):
        assert (grid[name] == whole[name]).all()
    assert (run.last.u == before.u).all() and (run.last.F == before.F).all()


def test_frame_that_lacks_a_piece_is_refused(ball, tmp_path):
    folder = write_run(tmp_path / "run", *ball, lambda X: 0.1 * X, program="fem_reference")
    split(folder)
    (folder / "frames" / f"frame_{N_STEPS:06d}_1.vtu").unlink()
    with pytest.raises(RunError, match=r"frame_000004_1.vtu: missing"):
        _ = load_run(folder).last


def test_half_written_run_is_refused(folder):
    (folder / "run.json").unlink()
    with pytest.raises(RunError, match=r"no run.json, the run is not finished"):
        load_run(folder)


def test_damaged_record_is_refused(folder):
    (folder / "run.json").write_text('{"status": "ok",\n oops')
    with pytest.raises(RunError, match=r"run.json:2: not JSON"):
        load_run(folder)


def test_diverged_run_is_refused(folder):
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(record | {"status": "diverged"}))
    with pytest.raises(RunError, match="status is 'diverged', expected 'ok'"):
        load_run(folder)


def test_missing_frame_is_refused(folder):
    (folder / "frames" / f"frame_{N_STEPS:06d}.vtu").unlink()
    with pytest.raises(RunError, match=r"frame_000004.vtu: missing"):
        _ = load_run(folder).last


def test_cut_frame_is_refused(folder):
    file = folder / "frames" / f"frame_{N_STEPS:06d}.vtu"
    file.write_bytes(file.read_bytes()[:3000])
    list_outputs(folder)
    with pytest.raises(RunError, match=r"frame_000004.vtu: expected 'displacement'"):
        _ = load_run(folder).last


def test_triangle_of_an_internal_node_is_refused(folder):
    file = folder / "frames" / f"frame_{N_STEPS:06d}.vtu"
    grid = pv.read(file)
    grid.field_data["n_surface"] = [641]
    grid.save(file)
    list_outputs(folder)
    with pytest.raises(RunError, match="expected the triangles of 641 surface nodes"):
        _ = load_run(folder).last


def test_nan_in_a_frame_is_refused(folder):
    file = folder / "frames" / f"frame_{N_STEPS:06d}.vtu"
    grid = pv.read(file)
    grid.point_data["displacement"][3, 1] = np.nan
    grid.save(file)
    list_outputs(folder)
    with pytest.raises(RunError, match=r"frame_000004.vtu: displacement is not finite"):
        _ = load_run(folder).last


def test_nan_in_the_curves_is_refused(folder):
    file = folder / "curves.csv"
    lines = file.read_text().splitlines()
    lines[2] = "0.25,0.25,nan,1,1"
    file.write_text("\n".join(lines))
    list_outputs(folder)
    with pytest.raises(RunError, match=r"curves.csv:3: volume = nan, expected a number"):
        load_run(folder)


@pytest.mark.parametrize(
    "rows", ["", "time,load_factor\n0,0\n", "time,volume\n", "time,volume\n0,x\n", "time,volume\n0\n"]
)
def test_damaged_curves_are_refused(folder, rows):
    (folder / "curves.csv").write_text(rows)
    list_outputs(folder)
    with pytest.raises(RunError, match=r"curves.csv"):
        load_run(folder)


def test_missing_curves_are_refused(folder):
    (folder / "curves.csv").unlink()
    with pytest.raises(RunError, match=r"curves.csv: missing, run the solver again"):
        load_run(folder)
    list_outputs(folder)
    with pytest.raises(RunError, match=r"output.curves = true"):
        load_run(folder)


def test_files_of_another_run_are_refused(folder, ball, tmp_path):
    """Whole, but of another displacement; or cut at the end of a line."""
    other = write_run(tmp_path / "other", *ball, lambda X: 0.3 * X)
    frame = f"frames/frame_{N_STEPS:06d}.vtu"
    run = load_run(folder)
    shutil.copy(other / frame, folder / frame)
    with pytest.raises(RunError, match=r"frame_000004.vtu: not the file that run.json lists"):
        _ = run.last
    assert run.frame(0).u == pytest.approx(0 * ball[0], abs=0)
    rows = (folder / "curves.csv").read_text().splitlines(keepends=True)
    (folder / "curves.csv").write_text("".join(rows[:-1]))
    with pytest.raises(RunError, match=r"curves.csv: not the file that run.json lists"):
        load_run(folder)


def test_file_of_another_run_is_refused_though_it_is_as_long(folder):
    file = folder / "curves.csv"
    text = file.read_text()
    file.write_text(text[:-2] + str((int(text[-2]) + 1) % 10) + text[-1])
    with pytest.raises(RunError, match=r"curves.csv: not the file that run.json lists"):
        load_run(folder)


def test_run_that_lists_no_files_is_refused(folder):
    record = json.loads((folder / "run.json").read_text())
    del record["outputs"]
    (folder / "run.json").write_text(json.dumps(record))
    with pytest.raises(RunError, match=r"not the file that run.json lists"):
        load_run(folder)
