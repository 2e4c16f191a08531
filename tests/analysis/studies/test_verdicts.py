"""The study of verdicts: which cases it draws, and what it counts as right."""

import csv
from argparse import Namespace
from types import SimpleNamespace

import pytest
from solvers import Backwards

from analysis.run_store import made_by
from analysis.studies import verdicts as module
from analysis.studies.verdicts import drawn, finding, holds, measure, study, table


def test_a_case_is_drawn_for_each_of_twenty_bodies():
    cases = drawn(20)
    assert len({case.body.name for case in cases}) == 20
    assert {case.kind for case in cases} == {"free", "held"}


@pytest.mark.parametrize(
    "verdict, right, wrong",
    [
        ("use", (0.0, 0.05), (0.051, 0.9)),
        ("not", (0.21, 2.0), (0.2, 0.01)),
        ("between", (0.06, 0.2), (0.05, 0.21)),
    ],
)
def test_a_verdict_holds_on_its_side_of_the_bounds(verdict, right, wrong):
    assert all(holds(verdict, error) for error in right)
    assert not any(holds(verdict, error) for error in wrong)


def row(model, verdict, body="a", **more):
    return {"body": body, "model": model, "verdict": verdict, "seconds": "3"} | more


def test_verdicts_are_counted_by_model():
    rows = [
        row("node_averaged", "use", error="0.01", holds="True"),
        row("node_averaged", "use", "b", error="0.06", holds="False", seconds="130"),
        row("node_averaged", "use", "c"),
        row("uniform", "undecided", error="0.2", holds=""),
    ]
    head, lines = table(rows)
    assert head[2:6] == ["cases", "hold", "do not", "unchecked"]
    assert lines == [
        ["node_averaged", "use", "3", "1", "1", "1", "1 %", "6 %"],
        ["uniform", "undecided", "1", "0", "0", "0", "20 %", "20 %"],
    ]
    assert finding(rows) == (
        "1 of 2 verdicts hold, 1 of 4 cannot be decided, and 2 of 3 bodies have theirs within two minutes."
    )


def test_cases_are_made_by_the_engine_and_listed_as_drawn(tmp_path, monkeypatch):
    made = []

    def stand_in(bench, case):
        made.append(case.body.name)
        return [row("node_averaged", "use", case.body.name)]

    monkeypatch.setattr(module, "measure", stand_in)
    with made_by(Backwards()):
        study(Namespace(quick=True, quiet=True), tmp_path)
    bodies = [case.body.name for case in drawn(3)]
    with (tmp_path / "rows.csv").open() as file:
        assert [line["body"] for line in csv.DictReader(file)] == bodies
    assert made == bodies[::-1]


def test_a_pair_is_made_by_the_store_and_its_seconds_are_those_of_its_runs(tmp_path, monkeypatch):
    """Not those in which it waited for others."""
    case, bench = (
        drawn(1)[0],
        SimpleNamespace(folder=tmp_path, store=object(), scenes=lambda _: ("scene", None)),
    )
    model = {"status": "ok", "displacement_error_l2": 0.01}
    models = {"node_averaged": model, "uniform": model}
    values = {"models": models, "reference": {"estimated_error_l2": None}}
    pair = SimpleNamespace(seconds=7.5, n_refinements=2)
    comparison = SimpleNamespace(
        experiment=pair, as_json=lambda: values, runs={name: name for name in models}
    )

    def stand_in(*_, store, **more):
        assert store is bench.store
        return pair

    bench.elements = lambda scene, nu, refine: {3: "finer"}[refine]
    for name, made in {
        "run_solvers": stand_in,
        "compare": lambda found: {pair.seconds: comparison}[found.seconds],
        "has_figures": lambda _: True,
        "verdict_on": lambda *_: "use",
        "error_of": lambda springs, truth: {("node_averaged", "finer"): 0.06, ("uniform", "finer"): 0.01}[
            springs, truth
        ],
    }.items():
        monkeypatch.setattr(module, name, made)
    found = measure(bench, case)
    assert [(row["model"], row["seconds"], row["error"], row["holds"]) for row in found] == [
        ("node_averaged", "7.5", "0.06", "False"),
        ("uniform", "7.5", "0.01", "True"),
    ]
    bench.elements = lambda scene, nu, refine: "finer"
    monkeypatch.setattr(module, "error_of", lambda springs, truth: 0.02)
    assert {row["error"] for row in measure(bench, case)} == {"0.02"}, "what other programs find counts"
