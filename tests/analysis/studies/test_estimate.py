"""The estimate study: its summary on rows whose answer is known, and the study over a stand-in."""

from types import SimpleNamespace

import numpy as np

from analysis.__main__ import parse_arguments
from analysis.runs import RunError
from analysis.studies import estimate
from analysis.studies.accuracy import cases, cases_of_half
from analysis.studies.command import main
from analysis.studies.estimate import ESTIMATE, finding, measure, table


def row(asked, error, own, kind="free", status="ok", price="1.5"):
    place = {"body": "ball", "kind": kind, "load": "smooth", "nu": "0.25", "asked": asked, "status": status}
    figures = {"n_nodes": "100", "seconds": "2", "price": price, "error": str(error), "estimate": str(own)}
    return place | (figures if status == "ok" else {})


def line_of(rows, kind, asked):
    head, lines = table(rows)
    return next(dict(zip(head, line, strict=True)) for line in lines if line[:2] == [kind, asked])


def test_estimates_are_summed_up_over_their_errors():
    rows = [row(ESTIMATE, 0.1, own) for own in (0.05, 0.1, 0.15, 0.4)] + [
        row(ESTIMATE, 0, 0, status="failed")
    ]
    line = line_of(rows, "free", ESTIMATE)
    assert (line["cases"], line["no result"], line["within two"], line["met"]) == ("4", "1", "75 %", "-")
    assert (line["estimate / error"], line["error"], line["nodes"]) == ("1.25", "10 %", "100")
    assert line["price"] == "1.5"
    assert finding(rows) == "Estimates are within a factor two of the error in 75 % of 4 cases."


def test_a_target_is_met_up_to_half_as_much_again():
    rows = [row("target 0.05", error, 0.05, "held", price="") for error in (0.01, 0.07, 0.08)]
    line = line_of(rows, "held", "target 0.05")
    assert (line["met"], line["price"]) == ("67 %", "-")
    assert line_of(rows, "held", "target 0.1")["within two"] == "-"
    assert finding(rows) == "No estimate was found."


class StandIn:
    """Springs whose displacement is 4 % more than that of the elements, and which say 6 %."""

    def __init__(self, *_):
        self.asked = []

    def scenes(self, _):
        return "scene", None

    def references(self, scene, case):
        self.asked.append((scene, case))
        return self.of(1), self.of(2)

    def run(self, program, scene, nu, *overrides):
        if "network.target_error=0.03" in overrides:
            raise RunError("too large")
        found = self.of(1.04)
        if "network.estimate=true" not in overrides:  # its seconds are those of the nodes that are added
            del found.record["seconds"]["estimate"]
        return found

    @staticmethod
    def of(size):
        X = np.eye(3)
        last = SimpleNamespace(X=X, u=size * np.diag([1.0, 2.0, 4.0]), F=np.array([[0, 1, 2]]))
        record = {
            "n_nodes": 3,
            "seconds": {"solve": 1.0, "mesh": 0.5, "estimate": 3.0},
            "estimated_error": 0.06,
            "is_free": False,
        }
        return SimpleNamespace(last=last, record=record)


def test_each_question_is_a_row_beside_the_refined_reference():
    case, bench = cases()[0], StandIn()
    rows = measure(bench, case)
    assert [row["asked"] for row in rows] == [ESTIMATE, "target 0.1", "target 0.05", "target 0.03"]
    assert bench.asked == [("scene", case)] and rows[-1]["status"] == "too large"
    assert (rows[0]["error"], rows[0]["estimate"]) == ("0.04", "0.06")
    assert (rows[0]["seconds"], rows[0]["price"], rows[1]["price"]) == ("1.5", "3", "")


def test_a_count_takes_the_first_cases_that_the_hash_draws(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(estimate, "Bench", StandIn)
    words = ["study", "estimate", "--held-out", "--count", "3", "--out", str(tmp_path)]
    assert main(parse_arguments(words)) == 0
    *_, last = [line for line in capsys.readouterr().err.splitlines() if line.startswith("[")]
    assert last == f"[3/3] {cases_of_half(is_held_out=True)[2].name}"


def test_quick_study_leaves_a_report(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(estimate, "Bench", StandIn)
    tmp_path.joinpath("out").mkdir()
    assert main(parse_arguments(["study", "estimate", "--quick", "--out", str(tmp_path / "out")])) == 0
    said = capsys.readouterr()
    assert "within a factor two of the error in 100 % of 4 cases" in said.out and "[4/4]" in said.err
    assert {"rows.csv", "estimates.csv", "report.html"} <= {
        file.name for file in (tmp_path / "out").iterdir()
    }
