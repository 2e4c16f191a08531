"""Seconds before and after, on numbers whose answer is known."""

import json

import pytest

from analysis.__main__ import parse_arguments
from analysis.paths import ROOT
from analysis.run_store import Outcome
from analysis.runs import RunError
from analysis.studies import benchmarks, command, kernels
from analysis.studies.kernels import Case, Timed, Tree


@pytest.fixture
def trees(tmp_path):
    return [Tree("v1", tmp_path / "v1"), Tree("now", tmp_path / "now", ("network.estimate=false",))]


def test_runs_alternate_between_the_trees_and_their_least_seconds_count(trees, tmp_path, monkeypatch):
    case = Case("a step", "massspring", "bar_bend", ("time.step=1",), ("setup", "solve"), n_steps=4)
    broken = Case("no end", "fem_reference", "bar_bend")
    monkeypatch.setattr(kernels, "CASES", [case, broken])
    asked = []
    seconds = {("v1", 0): 8.0, ("now", 0): 3.0, ("v1", 1): 9.0, ("now", 1): 2.0}

    class Fake:
        def __init__(self, folder, time_limit, programs):
            assert time_limit == 7 and programs == tmp_path / folder.name / "build" / "bin"
            self.tree = folder.name

        def run(self, request):
            asked.append((self.tree, request.program, request.repetition))
            assert request.scene == tmp_path / self.tree / "analysis" / "scenes" / "bar_bend.toml"
            if request.program == "fem_reference":
                return Outcome("time limit", "stopped", 7, 7, 0)
            assert ("network.estimate=false" in request.overrides) == (self.tree == "now")
            assert request.overrides[0] == "time.step=1" and request.options == ("--no-diagnostics",)
            solve = seconds[self.tree, request.repetition]
            record = {"seconds": {"mesh": 100, "setup": 1, "solve": solve}}
            return Outcome("ok", "", 200, solve + 50, 0, record=record)

    monkeypatch.setattr(kernels, "Store", Fake)
    step, unended = kernels.measure_runs(trees, tmp_path, 2, 7, is_quiet=True)
    assert asked == [
        (tree, program, repetition)
        for repetition in (0, 1)
        for program in ("massspring", "fem_reference")
        for tree in ("v1", "now")
    ]
    assert step.seconds == {"v1": 9 / 4, "now": 3 / 4} and step.cpu == {"v1": 58, "now": 52}
    assert kernels.ratio(step, trees) == 3
    assert unended.message == "now: time limit: stopped" and kernels.ratio(unended, trees) is None
    head, rows = kernels.table_of_runs([step, unended], trees)
    assert rows[0] == ["a step", "2.25", "0.75", "58", "52", "3.00", ""]
    assert rows[1] == ["no end", "-", "-", "-", "-", "-", "now: time limit: stopped"]
    assert all(len(row) == len(head) for row in rows)


def test_kernels_stand_beside_the_limit_of_the_present_tree(trees, monkeypatch):
    def benchmarks_of(program, _filter):
        if program.name == "bench_reference":
            return []
        is_now = "now" in program.parts
        forces = {"name": "forces", "cpu_time": 2.0 if is_now else 6.0, "time_unit": "us", "over_limit": 1.4}
        return [forces, {"name": "new", "cpu_time": 20.0, "time_unit": "ms"}] if is_now else [forces]

    monkeypatch.setattr(kernels, "benchmarks_of", benchmarks_of)
    forces, new = kernels.measure_kernels(trees, 2, is_quiet=True)
    assert forces.seconds == pytest.approx({"v1": 6e-6, "now": 2e-6}) and forces.over_limit == 1.4
    assert kernels.table_of_kernels([forces, new], trees)[1] == [
        ["forces", "6", "2", "3.00", "1.40"],
        ["new", "-", "20000", "-", "-"],
    ]
    words = kernels.finding([], [forces, new], trees)
    assert words == "Kernels take 1.4 (forces) to 1.4 (forces) times their limit."


def test_finding_names_the_least_and_the_most_gain(trees):
    runs = [Timed("a", {"v1": 4, "now": 2}), Timed("b", {"v1": 9, "now": 1}), Timed("c", {"now": 1})]
    assert kernels.finding(runs, [], trees) == "Since v1 runs are 2.0 (a) to 9.0 (b) times as fast."
    assert "--against" in kernels.finding(runs, [], trees[1:])


def test_benchmarks_that_fail_or_are_not_there_are_left_out(tmp_path):
    program = tmp_path / "bench"
    one = {"run_type": "iteration", "cpu_time": 1}
    found = [
        one | {"name": "good"},
        one | {"name": "bad", "error_occurred": True},
        {"name": "good_BigO", "run_type": "aggregate"},
    ]
    program.write_text(f"#!/bin/sh\necho '{json.dumps({'benchmarks': found})}'\n")
    program.chmod(0o755)
    assert [b["name"] for b in benchmarks.benchmarks_of(program, "^good")] == ["good"]
    program.write_text("#!/bin/sh\necho 'Failed to match any benchmarks against regex: ^x' >&2\n")
    assert benchmarks.benchmarks_of(program, "^x") == []


def test_a_commit_that_there_is_not_is_an_error(tmp_path):
    with pytest.raises(RunError, match=r"--against nowhere: .*nowhere"):
        kernels.build_at("nowhere", tmp_path, is_quiet=True)


def test_every_case_names_a_scene_and_overrides_that_its_program_reads():
    for case in kernels.CASES:
        assert Tree("now", ROOT).scene(case.scene).exists()
        assert all("=" in override for override in case.overrides)


def test_an_option_that_means_nothing_to_a_study_is_refused():
    for words, what in (
        (["cost", "--quick"], "study cost takes no --quick"),
        (["scaling", "x.toml"], "study scaling takes no scene"),
        (["paper", "--against", "v1"], "study paper takes no --against, which is for kernels"),
        (["accuracy", "--time-limit", "3"], "--time-limit, which is for kernels, work-precision"),
    ):
        with pytest.raises(RunError, match=what):
            command.main(parse_arguments(["study", *words]))


@pytest.mark.parametrize("option", ["--repetitions", "--count", "--workers"])
@pytest.mark.parametrize("value", ["0", "-3", "2.5"])
def test_numbers_of_things_are_whole_and_at_least_one(option, value, capsys):
    with pytest.raises(SystemExit, match="2"):
        parse_arguments(["study", "survey", f"{option}={value}"])
    assert f"argument {option}: '{value}', expected a number from 1" in capsys.readouterr().err
