"""Scaling, cost and the paper's table, on numbers whose answer is known."""

import functools
import inspect
import json
import re
import subprocess
import sys
import time

import numpy as np
import pytest
from solvers import calls, make_solvers

from analysis.__main__ import parse_arguments
from analysis.execute import solver
from analysis.paths import PROGRAMS, ROOT, SCENES
from analysis.run_store import Outcome, Store
from analysis.studies import command, cost, paper, scaling
from analysis.studies.result import Result, alone


def test_slope_is_the_exponent():
    x = [1e3, 1e4, 1e5]
    assert scaling.slope(x, [3e-6 * value**1.5 for value in x]) == pytest.approx(1.5)


def sizes(exponent):
    """The first line, with a solve of 50 steps that takes 1e-6 s n^exponent a step, and 6 springs a node."""
    records = [
        {
            "n_nodes": n,
            "n_springs": 6 * n,
            "peak_memory": 100 * n,
            "seconds": {"mesh": 1e-5 * n, "setup": 1e-6 * n, "solve": 50e-6 * n**exponent},
        }
        for n in (10**3, 10**4, 10**5)
    ]
    return [scaling.Size(scaling.LINES[0], [Outcome("ok", "", 1, 1, 0, record=record)]) for record in records]


def test_scaling_states_slopes_and_lemma_1():
    measured = sizes(1.25)
    assert measured[0].blocks_per_node == 13
    assert measured[2].seconds("solve") == pytest.approx(1e-6 * 1e5**1.25)
    words = scaling.finding(measured)
    assert "explicit step of springs, uniform" in words and "1.25" in words
    assert "13.0 to 13.0 blocks a node" in words
    head, rows = scaling.table(measured)
    steps = [row[head.index("slope to the row before")] for row in rows]
    assert steps == ["-", "1.00", "1.00"] * 2 + ["-", "1.25", "1.25"]
    _, grown = scaling.table_of_exponents(measured)
    assert grown == [["springs, uniform", "explicit step", "1000 to 100000", "1.25", "0.1"]]


def test_scaling_takes_the_blocks_that_a_run_counts_itself():
    coupled, *_ = (line for line in scaling.LINES if line.model == "node_averaged")
    seconds = {"mesh": 1.0, "setup": 1.0, "solve": 1.0}
    record = {"n_nodes": 10, "n_springs": 0, "n_patches": 40, "peak_memory": 1, "seconds": seconds}

    def cells(record):
        head, rows = scaling.table([scaling.Size(coupled, [Outcome("ok", "", 1, 1, 0, record=record)])])
        return {row[head.index("blocks a node")] for row in rows}

    assert cells(record | {"n_blocks": 270}) == {"27.00"}
    assert cells(record) == {"-"}


def points_of(line):
    return np.array(line.get_xdata(), dtype=float), np.array(line.get_ydata(), dtype=float)


def test_scaling_draws_seconds_memory_and_blocks_over_the_nodes(drawn):
    nodes = np.array([1e3, 1e4, 1e5])
    springs, elements = drawn(scaling).plot_seconds(sizes(1.25)).axes
    expected = {
        "sampling and PCP (1.00)": 1e-5 * nodes,
        "set-up (1.00)": 1e-6 * nodes,
        "explicit step (1.25)": 1e-6 * nodes**1.25,
    }
    lines = {line.get_label().partition(": ")[2]: points_of(line) for line in springs.lines}
    assert set(lines) == set(expected) and not elements.lines
    for name, (x, y) in lines.items():
        np.testing.assert_allclose(x, nodes)
        np.testing.assert_allclose(y, expected[name])
    (line,) = scaling.plot_memory(sizes(1.25)).axes[0].lines
    np.testing.assert_allclose(points_of(line), [nodes, 100 * nodes / 1e6])
    (line,) = scaling.plot_lemma(sizes(1.25)).axes[0].lines
    np.testing.assert_allclose(points_of(line), [nodes, 13 * nodes])
    assert line.get_label() == "PCP network (1.000)"


def test_scaling_takes_the_median_of_each_stage_and_the_largest_memory():
    runs = [
        {"peak_memory": byte, "seconds": {"setup": setup, "solve": 50 * setup}}
        for setup, byte in ((1, 5), (9, 7), (2, 6))
    ]
    size = scaling.Size(scaling.LINES[0], [Outcome("ok", "", 1, 1, 0, record=record) for record in runs])
    assert (size.seconds("setup"), size.seconds("solve"), size.memory) == (2, 2, 7)


class Recording:
    """A store that runs nothing: large bodies fail, and requests are listed."""

    def __init__(self):
        self.requests = []

    def run(self, request):
        self.requests.append(request)
        is_large = "surface.n_vertices=3600" in request.overrides
        return Outcome(
            "failed" if is_large else "ok", "too large" if is_large else "", 1, 1, 0, record={"n_nodes": 7}
        )


def test_scaling_fills_bodies_with_the_nodes_asked_for(tmp_path):
    store = Recording()
    # Eight times the nodes in the body have four times the vertices on its surface.
    measured = scaling.measure(tmp_path / "bar.toml", store, [1400, 8 * 1400, 2e6], 2, is_quiet=True)
    vertices = [int(request.overrides[0].partition("=")[2]) for request in store.requests]
    n = len(scaling.LINES)
    huge = round(900 * (2e6 / 1400) ** (2 / 3))
    # All methods by turns, what failed only once, and of the largest body an explicit step and the statics alone.
    assert vertices == [900] * n + [3600] * n + [huge] * 2 + [900] * n + [huge] * 2
    assert [request.repetition for request in store.requests] == [0] * (2 * n + 2) + [1] * (n + 2)
    assert [size.message for size in measured if size.message] == ["failed: too large"] * n
    assert {len(size.outcomes) for size in measured} == {0, 2}


def test_scaling_tells_seconds_of_networks_by_their_nodes(monkeypatch):
    asked = []

    def benchmarks_of(program, filter_):
        asked.append(filter_)
        return [{"name": f"whole/{n}", "cpu_time": n / 4, "time_unit": "ms"} for n in (1000, 10000)]

    monkeypatch.setattr(scaling, "benchmarks_of", benchmarks_of)
    assert scaling.table_of_networks(1e4) == (
        ["internal nodes", "1,000", "10,000"],
        [["seconds", "0.25", "2.5"]],
    )
    assert asked == ["^whole/(1000|10000)$"]


def test_scaling_keeps_what_failed_as_a_row():
    failed = scaling.Size(scaling.LINES[0], [], "failed: out of memory")
    assert scaling.table([failed])[1][0][-1] == "failed: out of memory"


def test_instructions_are_read_from_valgrind():
    assert cost.instructions_of("==1== \n==1== I   refs:      96,227,314\n") == 96227314
    with pytest.raises(ValueError, match="counted nothing"):
        cost.instructions_of("no such tool")


def test_cost_is_what_a_part_adds():
    costs = [
        cost.Cost(cost.ALONE, 2e6),
        cost.Cost("a", 3e6),
        cost.Cost("b", 2e6),
        cost.Cost("c", None, "failed: no c"),
    ]
    assert cost.shares(costs) == [("a", 0.5), ("b", 0.0)]
    assert cost.table(costs)[1] == [
        [cost.ALONE, "2e+06", "-", ""],
        ["a", "3e+06", "+50.0 %", ""],
        ["b", "2e+06", "+0.0 %", ""],
        ["c", "-", "-", "failed: no c"],
    ]
    words = cost.finding(costs)
    assert "a +50 %" in words and "below 1 % stay b" in words and "No result: c" in words


@pytest.mark.skipif(not (PROGRAMS / "massspring").exists(), reason="massspring is not built")
@pytest.mark.parametrize("part", cost.PARTS)
def test_springs_run_the_scene_of_every_part(part, tmp_path):
    (tmp_path / "cost.toml").write_text(cost.SCENE)
    overrides = (f"time.end={2 * cost.STEP}", *cost.PARTS[part])
    words = solver(PROGRAMS / "massspring", tmp_path / "cost.toml", tmp_path / "out", overrides, ("--quiet",))
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_cost_draws_what_a_part_adds(drawn):
    costs = [cost.Cost("a", 3e6), cost.Cost(cost.ALONE, 2e6), cost.Cost("b", 1.5e6)]
    (axes,) = drawn(cost).plot(costs).axes
    assert [bar.get_width() for bar in axes.patches] == [50, -25]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]


def test_cost_of_a_step_is_without_the_start(tmp_path, monkeypatch):
    monkeypatch.setattr(cost, "PARTS", {cost.ALONE: (), "gravity": ("gravity=[0, -9.81, 0]",)})

    class Counted:
        """5 million instructions to start, 2 or 3 million a step of 0.1 ms."""

        def run(self, request):
            n = round(float(request.overrides[0].partition("=")[2]) / 1e-4)
            count = 5_000_000 + (3_000_000 if len(request.overrides) > 1 else 2_000_000) * n
            (tmp_path / "messages.txt").write_text(f"==1== I   refs:      {count:,}\n")
            return Outcome("ok", "", 1, 1, 0, tmp_path)

    costs = cost.measure(tmp_path / "cost", Counted(), is_quiet=True)
    assert costs == [cost.Cost(cost.ALONE, 2e6), cost.Cost("gravity", 3e6)]


def test_every_part_is_a_row_even_where_all_fail(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball)
    (programs / "massspring").write_text("#!/bin/sh\necho 'error: no' >&2\nexit 1\n")
    costs = cost.measure(tmp_path / "cost", Store(tmp_path / "runs", programs=programs), is_quiet=True)
    assert [c.part for c in costs] == list(cost.PARTS)
    assert all(c.message for c in costs)
    assert not calls(programs)


def test_table_1_sets_measured_beside_published():
    rows = [
        {"run_name": f"ball/{scheme}/soft/repeats:3", "FPS": rate, "nodes": 662, "springs": 3499}
        for scheme, rates in {
            "explicit_euler": (66.5, 70, 60),
            "symplectic_euler": (67, 66, 68),
            "implicit_euler": (14.2, 14, 15),
            "minimising_euler": (3, 2, 4),
        }.items()
        for rate in rates
    ]
    head, body = paper.table_1(rows)
    euler, symplectic, implicit = (
        ["66.5", "60 to 70", "33.25"],
        ["67", "66 to 68"],
        ["14.2", "14 to 15", "1.42"],
    )
    assert body[0] == ["ball", "662", "3499", "3535", *euler, *symplectic, *implicit, "3", "2 to 4"]
    assert all(len(row) == len(head) for row in body)
    assert body[1][1] == "-"
    assert "2 to 2 times" in paper.finding((head, body)) and "10 to 10 times implicitly" in paper.finding(
        (head, body)
    )
    assert "1.0%" in paper.finding((head, body))


def test_benchmark_is_measured_once_for_a_program(tmp_path):
    program = tmp_path / "bench"
    result = json.dumps(
        {"benchmarks": [{"run_type": "iteration", "run_name": "a"}, {"run_type": "aggregate"}]}
    )
    program.write_text(f"#!/bin/sh\necho $@ >> {tmp_path}/log\necho '{result}'\n")
    program.chmod(0o755)
    for _ in range(2):
        assert paper.benchmark(program, tmp_path / "out", 3) == [{"run_type": "iteration", "run_name": "a"}]
    (words,) = (tmp_path / "log").read_text().splitlines()
    paper.benchmark(program, tmp_path / "out", 4)
    assert "repetitions=4" in (tmp_path / "log").read_text().splitlines()[1]
    wanted = re.compile(words.split("--benchmark_filter=")[1].split()[0])
    assert wanted.search("ball/implicit_euler/soft") and wanted.search("head/explicit_euler/soft")
    assert not wanted.search("scale/symplectic_euler/soft/1000000")  # minutes


def test_figure_11_draws_what_ran_and_says_what_did_not(ball, tmp_path):
    assert all((SCENES / f"{name}.toml").exists() for name in paper.FIGURE_11)
    scenes = [tmp_path / f"{name}.toml" for name in ("sinks", "breaks", "sticks")]
    for number, scene in enumerate(scenes):
        scene.write_text(f"gravity = [0, 0, {number}]")
    programs = make_solvers(tmp_path / "home", ball)
    wrapped = programs / "massspring"
    real = wrapped.rename(programs / "real")
    wrapped.write_text(
        f"#!/bin/sh\ncase $1 in *breaks*) echo 'error: torn' >&2; exit 1;;\n"
        f"*sticks*) exec {real} $@ --set material.nu=stuck;; esac\nexec {real} $@\n"
    )
    wrapped.chmod(0o755)
    text = real.read_text().replace("os.path.basename(sys.argv[0])", "'massspring'")
    real.write_text(text)
    strips, (head, rows) = paper.figure_11(scenes, Store(tmp_path / "runs", programs=programs), tmp_path)
    assert list(strips) == ["sinks"] and strips["sinks"].stat().st_size > 1000
    assert [row[:2] for row in rows] == [["sinks", "ok"], ["breaks", "failed"], ["sticks", "not_converged"]]
    assert rows[1][-1] == "torn" and rows[2][-1] == "step 2 of 5" and len(rows[0]) == len(head)


def at(line, x):
    return np.interp(x, *points_of(line))


def test_figure_9_draws_how_far_a_spring_collapses(drawn):
    lines = {line.get_label(): line for line in drawn(paper).figure_9().axes[0].lines}
    assert set(lines) == {f"R = {R}" for R in (0.1, 0.3, 0.5, 0.9)}
    # R of the length at the pivot, half of that one smallest side away, a fifth of it at four; between 200 points.
    for R in (0.1, 0.9):
        assert at(lines[f"R = {R}"], [0, 1, 4]) == pytest.approx([1 - R, 1 - R / 2, 1 - R / 5], abs=1e-3)


def test_figure_10_draws_warps_and_their_speeds(drawn):
    time, speed = drawn(paper).figure_10().axes
    shown = {line.get_label(): at(line, [0, 0.5, 1]) for line in time.lines}
    middle = {"constant": 0.5, "elastic": 0.5, "explode": 0.9526, "custom": 0.1 + 0.7 * 2 / 3}
    assert shown == {name: pytest.approx([0, value, 1], abs=1e-3) for name, value in middle.items()}
    fastest = {line.get_label(): points_of(line)[1].max() for line in speed.lines}
    # Of a parabola's derivative 6 t (1 - t), of an exponential's 6 / (1 - exp(-6)) and of the steepest of three pieces.
    assert fastest == {
        "constant": pytest.approx(1), "elastic": pytest.approx(1.5, rel=0.02),
        "explode": pytest.approx(6, rel=0.02), "custom": pytest.approx(0.7 / 0.3),
    }  # fmt: skip


def test_timed_studies_wait_for_each_other(tmp_path):
    code = "import sys; from pathlib import Path; from analysis.studies.result import alone\n"
    code += "with alone(False, Path(sys.argv[1])): pass"
    with alone(lock_file=tmp_path / "lock"):
        words = [sys.executable, "-c", code, str(tmp_path / "lock")]
        other = subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, text=True)
        assert "waiting for it to end" in other.stderr.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(0.5)
    assert other.wait(30) == 0


@pytest.mark.parametrize("name", command.STUDIES)
def test_every_study_speaks_within_ten_seconds_and_every_ten_after(name, tmp_path, monkeypatch, capsys):
    """One that says nothing, while a tenth of a second stands for ten."""
    assert inspect.signature(command.reminders).parameters["pause"].default <= 10
    monkeypatch.setattr(command, "reminders", functools.partial(command.reminders, pause=0.1))

    def measure(*_):
        time.sleep(0.35)
        return Result("Name", "Found.", [])

    monkeypatch.setitem(command.STUDIES, name, command.STUDIES[name]._replace(measure=measure))
    monkeypatch.setattr(command, "protocol_of", lambda *_: {})
    assert command.main(parse_arguments(["study", name, "--out", str(tmp_path)])) == 0
    assert capsys.readouterr().err.count(f"{name}: ") >= 2
