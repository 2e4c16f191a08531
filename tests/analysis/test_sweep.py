"""Sweeps over programs that stand in for the solvers: points run once, failures are rows, a kill loses nothing."""

import csv
import os
import random
import signal

import pytest
from pages import fetched
from solvers import ERRORS, calls, make_solvers, wait_for_calls

from analysis.__main__ import parse_arguments
from analysis.points import Point, Store
from analysis.runs import RunError
from analysis.sweep import finding, parse_grid, points_of, sweep

GRID = {"material.nu": list(ERRORS), "network.multiplicity": ["3", "5"]}


@pytest.fixture
def programs(ball, tmp_path):
    return make_solvers(tmp_path / "home", ball)


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('name = "synthetic"\n')
    return file


def run(scene, folder, programs, grid=GRID, **options):
    return sweep(
        scene, grid, folder, is_quiet=True, store=Store(folder / "points", programs=programs), **options
    )


def test_grid_is_every_combination():
    grid = parse_grid(["a=1,2", "gravity=[0,1],[2,3]", "name=x"])
    assert grid == {"a": ["1", "2"], "gravity": ["[0,1]", "[2,3]"], "name": ["x"]}
    assert points_of(grid)[1] == {"a": "1", "gravity": "[2,3]", "name": "x"}
    assert len(points_of(grid)) == 4


@pytest.mark.parametrize(
    "settings, message", [(["a"], "expected KEY=VALUE"), (["a=1", "a=2"], "stands twice")]
)
def test_settings_that_are_no_grid_are_refused(settings, message):
    with pytest.raises(RunError, match=message):
        parse_grid(settings)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b"])
def test_share_that_is_none_is_refused(text):
    with pytest.raises(SystemExit):
        parse_arguments(["sweep", "--part", text])


def test_table_holds_the_errors_of_the_runs(scene, programs, tmp_path):
    run(scene, tmp_path / "out", programs)
    with (tmp_path / "out" / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    for row in rows:
        assert float(row["displacement_error_l2"]) == pytest.approx(ERRORS[row["material.nu"]], rel=1e-9)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "10 % at best" in page and "40 % at worst" in page
    assert not fetched(page)


def test_motions_keep_their_frames(scene, programs, tmp_path):
    run(scene, tmp_path / "out", programs, {"material.nu": ["0.25"]})
    scene.write_text('[time]\nmode = "dynamic"\n')
    run(scene, tmp_path / "out", programs, {"material.nu": ["0.25"]})
    assert ["output.frames_every" in call for call in calls(programs)] == [True, True, False, False]


def test_finished_points_never_run_again(scene, programs, tmp_path):
    run(scene, tmp_path / "out", programs)
    assert len(calls(programs)) == 6 + 3  # the reference does not read network.multiplicity
    run(scene, tmp_path / "out", programs)
    assert len(calls(programs)) == 9
    run(
        scene,
        tmp_path / "out",
        programs,
        {"material.nu": ["0.25", "0.3"], "network.multiplicity": ["5", "8"]},
    )
    assert len(calls(programs)) == 9 + 2


@pytest.mark.parametrize("changed", ["scene", "program", "threads"])
def test_what_a_result_depends_on_makes_it_run_again(changed, scene, programs, tmp_path, monkeypatch):
    point = Point("massspring", scene)
    before = Store(tmp_path / "out", programs=programs).key(point)
    if changed == "scene":
        scene.write_text("gravity = [0, 0, 1]\n")
    elif changed == "program":
        programs = programs.rename(tmp_path / "rebuilt")
        (programs / "massspring").write_text("another")
    else:
        monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert Store(tmp_path / "out", programs=programs).key(point) != before


def test_surface_file_counts_with_what_it_holds(programs, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text('[surface]\nfile = "a.obj"\n')
    (tmp_path / "a.obj").write_text("v 0 0 0")
    (tmp_path / "b.obj").write_text("v 0 0 1")
    store = Store(tmp_path / "out", programs=programs)
    other = Point("massspring", scene, (f"surface.file={tmp_path / 'b.obj'}",))
    assert store.key(Point("massspring", scene)) != store.key(other)
    with pytest.raises(RunError, match="c.obj: No such file"):
        store.key(Point("massspring", scene, ("surface.file=c.obj",)))


def test_failed_point_is_a_row_with_its_message(scene, programs, tmp_path):
    rows = run(scene, tmp_path / "out", programs, {"material.nu": ["0.6", "0.3", "diverge", "stuck"]})
    assert [row["status"] for row in rows] == ["failed", "ok", "diverged", "not_converged"]
    assert rows[0]["message"] == "massspring: scene.toml: material.nu = 0.6, expected less than 0.5"
    assert [row["message"] for row in rows[2:]] == ["massspring: gave no result", "massspring: step 2 of 5"]
    assert "3 of 4 points gave no result" in finding("synthetic", ["material.nu"], rows)
    assert "expected less than 0.5" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    "nu, status, message",
    [("far", "not_converged", ""), ("touched", "failed", "exit status 3")],
)
def test_references_point_that_is_not_solved_says_how_it_ended(nu, status, message, scene, programs, tmp_path):
    outcome = Store(tmp_path / "out", programs=programs).run(Point("fem_reference", scene, (f"material.nu={nu}",)))
    assert (outcome.status, outcome.message) == (status, message)


def test_point_that_takes_too_long_is_stopped(ball, scene, tmp_path):
    programs = make_solvers(tmp_path / "slow", ball, seconds=60)
    outcome = Store(tmp_path / "out", time_limit=0.2, programs=programs).run(Point("massspring", scene))
    assert outcome.status == "time limit"
    assert outcome.wall < 30


def test_shares_of_two_machines_make_the_whole_table(scene, programs, tmp_path):
    run(scene, tmp_path / "whole", programs)
    n_calls = len(calls(programs))
    for part in ((1, 2), (2, 2)):
        run(scene, tmp_path / "shared", programs, part=part)
    assert not (tmp_path / "shared" / "sweep.csv").exists()
    run(scene, tmp_path / "shared", programs)
    assert len(calls(programs)) == 2 * n_calls
    assert (tmp_path / "shared" / "sweep.csv").read_text() == (tmp_path / "whole" / "sweep.csv").read_text()


def test_killed_sweep_continues_to_the_same_table(ball, scene, tmp_path):
    programs = make_solvers(tmp_path / "home", ball, seconds=0.03)
    run(scene, tmp_path / "whole", programs)
    n_points = len(calls(programs))
    moments = random.Random(4)
    n_killed = 0
    for _ in range(3):  # of nine points
        child = os.fork()
        if child == 0:
            run(scene, tmp_path / "killed", programs)
            os._exit(0)
        wait_for_calls(programs, len(calls(programs)) + moments.randint(2, 3), moments.uniform(0, 0.1))
        os.kill(child, signal.SIGKILL)
        n_killed += os.WIFSIGNALED(os.waitpid(child, 0)[1])
    assert n_killed > 1
    files = (tmp_path / "killed" / "points").glob("*/outcome.json")
    finished = {file: file.stat().st_mtime_ns for file in files if ".part" not in file.parent.name}
    assert finished
    run(scene, tmp_path / "killed", programs)
    assert {file: file.stat().st_mtime_ns for file in finished} == finished
    assert len(calls(programs)) <= 2 * n_points + n_killed
    assert not list((tmp_path / "killed" / "points").glob("*.part*"))
    assert (tmp_path / "killed" / "sweep.csv").read_text() == (tmp_path / "whole" / "sweep.csv").read_text()
