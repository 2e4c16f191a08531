"""Sweeps over programs that stand in for the solvers: runs made once, failures are rows, a kill loses nothing."""

import csv
import json
import os
import platform
import random
import signal
import subprocess
from pathlib import Path

import pytest
from pages import fetched
from solvers import ERRORS, calls, make_solvers, wait_for_calls
from synthetic import write_run

from analysis import grid as sweeps
from analysis.__main__ import parse_arguments
from analysis.grid import finding, measure, parse_grid, settings_of, sweep
from analysis.run_store import Outcome, RunRequest, Store
from analysis.runs import RunError

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
        scene, grid, folder, is_quiet=True, store=Store(folder / "runs", programs=programs), **options
    )


def test_grid_is_every_combination():
    grid = parse_grid(["a=1,2", "gravity=[0,1],[2,3]", "name=x"])
    assert grid == {"a": ["1", "2"], "gravity": ["[0,1]", "[2,3]"], "name": ["x"]}
    assert settings_of(grid)[1] == {"a": "1", "gravity": "[2,3]", "name": "x"}
    assert len(settings_of(grid)) == 4


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
    assert "runs they are off by at most 5 %" in page
    assert not fetched(page)


def test_seconds_of_a_sweep_are_without_the_springs_estimate(scene, programs, tmp_path):
    record = programs.parent / "massspring_0.25" / "run.json"
    values = json.loads(record.read_text())
    values["seconds"]["estimate"] = 5.0
    record.write_text(json.dumps(values))
    (row,) = run(scene, tmp_path / "out", programs, {"material.nu": ["0.25"]})
    assert row["seconds_massspring"] == row["seconds_fem_reference"] == pytest.approx(1)


def test_plot_has_a_line_for_each_value_beside_the_longest(drawn):
    rows = [
        {
            "a": a,
            "b": b,
            "status": "ok" if a != "3" else "failed",
            sweeps.FIGURES[0]: 0.01 * float(a) * float(b),
        }
        for a in ("2", "1", "3")
        for b in ("1", "10")
    ]
    (axes,) = drawn(sweeps).plot(["a", "b"], rows).axes
    lines = {line.get_label(): line for line in axes.lines}
    assert set(lines) == {"b = 1", "b = 10"} and axes.get_xlabel() == "a"
    for label, factor in (("b = 1", 1), ("b = 10", 10)):
        assert list(lines[label].get_xdata()) == [1, 2, 3]
        assert lines[label].get_ydata() == pytest.approx([factor, 2 * factor, float("nan")], nan_ok=True)


def test_motions_keep_their_frames(scene, programs, tmp_path):
    run(scene, tmp_path / "out", programs, {"material.nu": ["0.25"]})
    scene.write_text('[time]\nmode = "dynamic"\n')
    run(scene, tmp_path / "out", programs, {"material.nu": ["0.25"]})
    assert ["output.frames_every" in call for call in calls(programs)] == [True, True, False, False]


@pytest.mark.parametrize("mode, other, keeps", [("dynamic", "static", True), ("static", "dynamic", False)])
def test_mode_of_time_that_a_sweep_sets_decides_on_frames(mode, other, keeps, scene, programs, tmp_path):
    scene.write_text(scene.read_text() + f'\n[time]\nmode = "{other}"\n')
    run(scene, tmp_path / "set", programs, {"time.mode": [mode]})
    assert {"output.frames_every" in call for call in calls(programs)} == {not keeps}


@pytest.mark.parametrize(
    "damage",
    [
        lambda run: (run / "frames" / "frame_000001.vtu").unlink(),
        lambda run: os.truncate(run / "curves.csv", 60),
        lambda run: os.truncate(run / "run.json", 60),
        lambda run: (run / "outcome.json").write_text(""),
    ],
)
def test_damaged_run_of_a_sweep_is_made_again(damage, scene, programs, tmp_path):
    grid = {"material.nu": ["0.25"]}
    first = run(scene, tmp_path / "out", programs, grid)
    (springs,) = (
        file.parent
        for file in (tmp_path / "out" / "runs").glob("*/run.json")
        if '"massspring"' in file.read_text()
    )
    damage(springs)
    assert run(scene, tmp_path / "out", programs, grid) == first
    assert len(calls(programs)) == 3


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


INPUTS = {
    "scene.toml": """name = "first"
gravity = [0, 0, -9]
surface = { file = "ball.obj" }
network = { multiplicity = 3 }
reference = { degree = 1 }
comparison = { calibrations = ["lloyd"] }
playback = { fps = 25 }
obstacles = [{ plane = { point = [0, 0, 0] } }, { mesh = { file = "wall.obj" } }]
""",
    "ball.obj": "v 0 0 1",
    "wall.obj": "v 0 0 2",
    "other.obj": "v 0 0 3",
    **{f"bin/{name}": "build 1" for name in ("massspring", "fem_reference", "gmsh_worker", "tetgen_worker")},
}
SPRINGS, ELEMENTS, NEITHER = {"massspring"}, {"fem_reference"}, set()
BOTH = SPRINGS | ELEMENTS


@pytest.fixture
def inputs(tmp_path):
    folder = tmp_path / "inputs"
    (folder / "bin").mkdir(parents=True)
    for name, text in INPUTS.items():
        (folder / name).write_text(text)
        os.utime(folder / name, (0, 0))  # a change to the same size shows, however fast the test
    return folder


def keys(inputs, *overrides, **more):
    store = Store(inputs.parent / "runs", programs=inputs / "bin")
    scene = inputs / "scene.toml"
    return {program: store.key(RunRequest(program, scene, overrides, **more)) for program in BOTH}


def changed(before, after):
    return {program for program in BOTH if before[program] != after[program]}


@pytest.mark.parametrize(
    "file, old, new, whose",
    [
        ("scene.toml", "-9", "-8", BOTH),
        ("scene.toml", '"ball.obj"', '"other.obj"', BOTH),
        ("scene.toml", "point = [0, 0, 0]", "point = [0, 0, 1]", BOTH),
        ("scene.toml", "multiplicity = 3", "multiplicity = 5", SPRINGS),
        ("scene.toml", "degree = 1", "degree = 2", ELEMENTS),
        ("scene.toml", "first", "second", NEITHER),
        ("scene.toml", "lloyd", "affine", NEITHER),
        ("scene.toml", "fps = 25", "fps = 50", NEITHER),
        ("scene.toml", "gravity", "# a comment\ngravity", NEITHER),
        ("ball.obj", "v 0 0 1", "v 0 0 4", BOTH),
        ("wall.obj", "v 0 0 2", "v 0 0 4", BOTH),
        ("other.obj", "v 0 0 3", "v 0 0 4", NEITHER),
        ("bin/massspring", "1", "2", SPRINGS),
        ("bin/fem_reference", "1", "2", ELEMENTS),
        ("bin/gmsh_worker", "1", "2", BOTH),
        ("bin/tetgen_worker", "1", "2", BOTH),
    ],
)
def test_results_depend_on_what_files_hold(file, old, new, whose, inputs):
    before = keys(inputs)
    text = (inputs / file).read_text()
    assert old in text
    (inputs / file).write_text(text.replace(old, new))
    assert changed(before, keys(inputs)) == whose


@pytest.mark.parametrize(
    "override, whose",
    [
        ("material.nu=0.4", BOTH),
        ("network.multiplicity=5", SPRINGS),
        ("reference.degree=2", ELEMENTS),
        ("name=second", NEITHER),
        ("comparison.calibrations=[]", NEITHER),
        ("playback.fps=50", NEITHER),
    ],
)
def test_results_depend_on_overrides(override, whose, inputs):
    key, _, value = override.partition("=")
    assert changed(keys(inputs), keys(inputs, override)) == whose
    assert changed(keys(inputs, override), keys(inputs, f"{key}={value}1")) == whose


@pytest.mark.parametrize(
    "more", [{"options": ("--converge", "2")}, {"prefix": ("valgrind",)}, {"repetition": 1}]
)
def test_runs_of_other_words_or_repetitions_are_kept_apart(more, inputs):
    assert changed(keys(inputs), keys(inputs, **more)) == BOTH


@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "DEAL_II_NUM_THREADS"])
def test_results_depend_on_threads(name, inputs, monkeypatch):
    before = keys(inputs)
    monkeypatch.setenv(name, "7")
    assert changed(before, keys(inputs)) == BOTH


@pytest.mark.parametrize(
    "override, left",
    [
        ("surface.file={}", "ball.obj"),
        ('surface.file="{}"', "ball.obj"),
        ('surface={{ file = "{}" }}', "ball.obj"),
        ("obstacles.1.mesh.file={}", "wall.obj"),
        ('obstacles=[{{ mesh = {{ file = "{}" }} }}]', "wall.obj"),
    ],
)
def test_files_of_overrides_count_instead_of_the_scenes(override, left, inputs):
    words = override.format(inputs / "other.obj")
    before = keys(inputs, words)
    (inputs / left).unlink()
    assert changed(before, keys(inputs, words)) == NEITHER
    (inputs / "other.obj").write_text("v 0 0 4")
    assert changed(before, keys(inputs, words)) == BOTH


def test_a_generated_shape_needs_no_file(inputs):
    (inputs / "ball.obj").unlink()
    keys(inputs, 'surface.file=""', "surface.shape=ball")
    with pytest.raises(RunError, match=r"ball.obj: No such file"):
        keys(inputs)


def test_failed_point_is_a_row_with_its_message(scene, programs, tmp_path):
    rows = run(scene, tmp_path / "out", programs, {"material.nu": ["0.6", "0.3", "diverge", "stuck"]})
    assert [row["status"] for row in rows] == ["failed", "ok", "diverged", "not_converged"]
    assert rows[0]["message"] == "massspring: scene.toml: material.nu = 0.6, expected less than 0.5"
    assert [row["message"] for row in rows[2:]] == ["massspring: gave no result", "massspring: step 2 of 5"]
    assert "3 of 4 runs gave no result" in finding("synthetic", ["material.nu"], rows)
    assert "expected less than 0.5" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    "nu, status, message",
    [("far", "not_converged", ""), ("touched", "failed", "exit status 3")],
)
def test_references_point_that_is_not_solved_says_how_it_ended(
    nu, status, message, scene, programs, tmp_path
):
    outcome = Store(tmp_path / "out", programs=programs).run(
        RunRequest("fem_reference", scene, (f"material.nu={nu}",))
    )
    assert (outcome.status, outcome.message) == (status, message)


def test_program_is_given_the_scene_the_options_and_the_overrides(scene, programs, tmp_path):
    (programs / "massspring").write_text('#!/bin/sh\necho "error: $*" >&2\nexit 1\n')
    request = RunRequest("massspring", scene, ("material.nu=0.3",), ("--no-diagnostics",))
    words = Store(tmp_path / "out", programs=programs).run(request).message.split()
    assert words[0] == str(scene)
    assert words[1] == "--out" and Path(words[2]).is_relative_to(tmp_path / "out")
    assert words[3:] == ["--no-diagnostics", "--set", "material.nu=0.3", "--quiet"]


@pytest.mark.parametrize(
    "lines, message",
    [("error: first|error: last|goodbye", "last"), ("one|two", "two"), ("", "exit status 4")],
)
def test_message_of_a_failed_point_is_its_last_error(lines, message, scene, programs, tmp_path):
    text = "".join(f"echo '{line}' >&2\n" for line in lines.split("|") if line)
    (programs / "massspring").write_text(f"#!/bin/sh\n{text}exit 4\n")
    outcome = Store(tmp_path / "out", programs=programs).run(RunRequest("massspring", scene))
    assert (outcome.status, outcome.message) == ("failed", message)


def test_point_that_takes_too_long_is_stopped(ball, scene, tmp_path):
    programs = make_solvers(tmp_path / "slow", ball, seconds=20)
    outcome = Store(tmp_path / "out", time_limit=0.2, programs=programs).run(RunRequest("massspring", scene))
    assert (outcome.status, outcome.message) == ("time limit", "stopped after 0.2 s")
    assert outcome.wall < 15


def test_point_stopped_early_runs_again_with_more_time(ball, scene, tmp_path):
    programs = make_solvers(tmp_path / "slow", ball, seconds=0.5)
    stores = [Store(tmp_path / "out", time_limit, programs) for time_limit in (0.1, 60, 0.1)]
    statuses = [store.run(RunRequest("massspring", scene)).status for store in stores]
    assert statuses == ["time limit", "ok", "ok"]  # what has been solved is not run again in less time


def test_only_what_dead_processes_left_is_cleared(tmp_path):
    dead = subprocess.Popen(["true"])
    dead.wait()
    left, busy = (tmp_path / f"a.part-{platform.node()}-{number}" for number in (dead.pid, os.getpid()))
    elsewhere, whole = tmp_path / f"a.part-another.machine-{dead.pid}", tmp_path / "a"
    for folder in (left, busy, elsewhere, whole):
        folder.mkdir()
        (folder / "run.json").write_text("{}")
    Store(tmp_path)
    assert [folder.exists() for folder in (left, busy, elsewhere, whole)] == [False, True, True, True]


def test_time_left_is_told_of_runs_that_are_made_and_not_of_those_that_are_kept(
    scene, programs, tmp_path, capsys
):
    for says in (True, False):
        store = Store(tmp_path / "runs", programs=programs)
        sweep(scene, GRID, tmp_path / str(says), is_quiet=False, store=store)
        assert ("left]" in capsys.readouterr().err) == says


def test_command_makes_the_share_that_it_names(scene, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(sweeps, "sweep", lambda *words: asked.append(words) or [])
    words = [
        "sweep",
        str(scene),
        "--set",
        "material.nu=0.25,0.3",
        "--out",
        str(tmp_path),
        "--part",
        "2/3",
        "--quiet",
    ]
    assert sweeps.main(parse_arguments(words)) == 0
    assert asked == [(scene, {"material.nu": ["0.25", "0.3"]}, tmp_path, (2, 3), True)]


def test_shares_of_two_machines_make_the_whole_table(scene, programs, tmp_path):
    run(scene, tmp_path / "whole", programs)
    n_calls = len(calls(programs))
    for part in ((1, 2), (2, 2)):
        run(scene, tmp_path / "shared", programs, part=part)
    assert not (tmp_path / "shared" / "sweep.csv").exists()
    assert len(calls(programs)) == 2 * n_calls  # nothing is left to be run
    run(scene, tmp_path / "shared", programs)
    assert len(calls(programs)) == 2 * n_calls
    assert (tmp_path / "shared" / "sweep.csv").read_text() == (tmp_path / "whole" / "sweep.csv").read_text()


def test_killed_sweep_continues_to_the_same_table(ball, scene, tmp_path):
    programs = make_solvers(tmp_path / "home", ball, seconds=0.03)
    run(scene, tmp_path / "whole", programs)
    n_points = len(calls(programs))
    moments = random.Random(4)
    n_killed = 0
    for _ in range(3):  # of nine runs
        child = os.fork()
        if child == 0:
            run(scene, tmp_path / "killed", programs)
            os._exit(0)
        wait_for_calls(programs, len(calls(programs)) + moments.randint(2, 3), moments.uniform(0, 0.1))
        os.kill(child, signal.SIGKILL)
        n_killed += os.WIFSIGNALED(os.waitpid(child, 0)[1])
    assert n_killed > 1
    files = (tmp_path / "killed" / "runs").glob("*/outcome.json")
    finished = {file: file.stat().st_mtime_ns for file in files if ".part" not in file.parent.name}
    assert finished
    run(scene, tmp_path / "killed", programs)
    assert {file: file.stat().st_mtime_ns for file in finished} == finished
    assert len(calls(programs)) <= 2 * n_points + n_killed
    assert not list((tmp_path / "killed" / "runs").glob("*.part*"))
    assert (tmp_path / "killed" / "sweep.csv").read_text() == (tmp_path / "whole" / "sweep.csv").read_text()


def test_rigid_motion_of_a_free_body_is_no_error(ball, tmp_path):
    write_run(tmp_path / "massspring", *ball, lambda X: 0.012 * X + [0.1, 0, 0])
    more = {"program": "fem_reference", "is_free": True, "free_motions": [[1, 0, 0, 0, 0, 0]]}
    write_run(tmp_path / "fem_reference", *ball, lambda X: 0.01 * X, **more)
    (tmp_path / "scene.toml").write_text("")

    class Known:
        def run(self, request):
            return Outcome("ok", "", 1, 1, 0, folder=tmp_path / request.program)

    row = measure(Known(), tmp_path / "scene.toml", {"material.nu": "0.3"})
    assert row["displacement_error_l2"] == pytest.approx(0.2)
