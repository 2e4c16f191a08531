"""The study of verdicts: which cases it draws, and what it counts as right."""

from types import SimpleNamespace

import pytest

from analysis.studies import verdicts
from analysis.studies.verdicts import drawn, finding, holds, table


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


def test_a_verdict_is_judged_by_a_reference_refined_once_more_than_its_own(tmp_path, monkeypatch):
    model = {"seconds": {}, "displacement_error_l2": 0.01, "is_linear": True}
    reference = {"estimated_error_l2": 0.001, "law_error": None}
    ended = SimpleNamespace(
        experiment=SimpleNamespace(n_refinements=1),
        runs={verdicts.SPRINGS: "run"},
        as_json=lambda: {"models": {verdicts.SPRINGS: model}, "reference": reference},
    )
    asked = []
    bench = SimpleNamespace(
        folder=tmp_path,
        scenes=lambda _: ("scene", None),
        elements=lambda _, __, refine: asked.append(refine) or "truth",
    )
    monkeypatch.setattr(verdicts, "run_solvers", lambda _, folder, *__, **___: folder.mkdir(parents=True))
    monkeypatch.setattr(verdicts, "compare", lambda _: ended)
    monkeypatch.setattr(verdicts, "error_of", lambda run, truth: {("run", "truth"): 0.02}[run, truth])
    (found,) = verdicts.measure(bench, drawn(1)[0])
    assert asked == [2]
    assert (found["verdict"], found["error"], found["holds"]) == ("use", "0.02", "True")
