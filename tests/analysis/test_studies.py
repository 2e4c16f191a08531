"""Scaling, cost and the paper's table, on numbers whose answer is known."""

import json
import re
import subprocess
import sys

import pytest
from solvers import calls, make_solvers

from analysis import cost, paper, scaling
from analysis.experiment import ROOT
from analysis.points import Outcome, Store
from analysis.study import SCENES, alone


def test_slope_is_the_exponent():
    x = [1e3, 1e4, 1e5]
    assert scaling.slope(x, [3e-6 * value**1.5 for value in x]) == pytest.approx(1.5)


def sizes(exponent):
    """The first line, with a solve of 50 steps that takes 1e-6 s n^exponent a step, and 6 springs a node."""
    records = [
        {"n_nodes": n, "n_springs": 6 * n, "peak_memory": 100 * n, "seconds": {"mesh": 1e-5 * n, "setup": 1e-6 * n, "solve": 50e-6 * n**exponent}}
        for n in (10**3, 10**4, 10**5)
    ]  # fmt: skip
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
    assert "(1.25)" in scaling.plot_seconds(measured)
    assert "(1.000)" in scaling.plot_lemma(measured)
    assert "MB" in scaling.plot_memory(measured)


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
    assert "added to a step" in cost.plot(costs)


def test_every_part_is_a_row_even_where_all_fail(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball)
    (programs / "massspring").write_text("#!/bin/sh\necho 'error: no' >&2\nexit 1\n")
    costs = cost.measure(tmp_path / "cost", Store(tmp_path / "points", programs=programs), is_quiet=True)
    assert [c.part for c in costs] == list(cost.PARTS)
    assert all(c.message for c in costs)
    assert not calls(programs)


def test_table_1_sets_measured_beside_published():
    rows = [
        {"run_name": f"ball/{scheme}/soft/repeats:3", "FPS": rate, "nodes": 662, "springs": 3499}
        for scheme, rates in {"symplectic_euler": (66.5, 70, 60), "implicit_euler": (14.2, 14, 15)}.items()
        for rate in rates
    ]
    head, body = paper.table_1(rows)
    assert body[0] == ["ball", "662", "3499", "3535", "66.5", "60 to 70", "33.25", "14.2", "14 to 15", "1.42"]
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
    wanted = re.compile(words.split("--benchmark_filter=")[1].split()[0])
    assert wanted.search("ball/implicit_euler/soft") and wanted.search("head/symplectic_euler/soft")
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
    strips, (head, rows) = paper.figure_11(scenes, Store(tmp_path / "points", programs=programs), tmp_path)
    assert list(strips) == ["sinks"] and strips["sinks"].stat().st_size > 1000
    assert [row[:2] for row in rows] == [["sinks", "ok"], ["breaks", "failed"], ["sticks", "not_converged"]]
    assert rows[1][-1] == "torn" and rows[2][-1] == "step 2 of 5" and len(rows[0]) == len(head)


def test_figures_9_and_10_have_their_curves():
    assert all(f"R = {R}" in paper.figure_9() for R in (0.1, 0.9))
    assert all(name in paper.figure_10() for name in ("constant", "elastic", "explode", "custom"))


def test_timed_studies_wait_for_each_other(tmp_path):
    code = "import sys; from pathlib import Path; from analysis.study import SCENES, alone\n"
    code += "with alone(True, Path(sys.argv[1])): pass"
    with alone(lock_file=tmp_path / "lock"):
        other = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "lock")], cwd=ROOT)
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(5)
    assert other.wait(30) == 0
