"""The accuracy study: its summary on tables whose answer is known, the study over stand-ins, and what it has published."""

import csv
import random
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from solvers import ERRORS, calls, make_solvers, wait_for_calls
from synthetic import write_run

from analysis.__main__ import parse_arguments
from analysis.paths import PROGRAMS, ROOT
from analysis.run_store import Store
from analysis.runs import record_of
from analysis.studies import accuracy
from analysis.studies.accuracy import (
    EQUAL,
    EXACT,
    LINEAR,
    PAGE,
    SPRINGS,
    UNCUT,
    Bench,
    Case,
    against_quadratic,
    cases,
    cases_of_half,
    finding,
    plot_ratios,
    publish,
    ratios,
    read_rows,
    table,
    table_of_equal_nodes,
    table_of_models,
    write_page,
)
from analysis.studies.accuracy_loads import FREE, HELD
from analysis.studies.bodies import Body
from analysis.studies.command import main

CASE = Case(Body("bracket", 1, "cad"), "smooth", "0.25")


def row(method: str, load: str, error: float, **more: str) -> dict[str, str]:
    kind = "held" if load in HELD else "free"
    place = {"half": "development", "body": "plate-1", "triangles": "even", "kind": kind, "load": load}
    figures = {"status": "ok", "n_nodes": "9", "error": str(error), "reference_error": "0.001"}
    return {**place, "nu": "0.25", "method": method, **figures, **more}


def test_ratio_is_to_linear_elements_in_the_same_case() -> None:
    rows = [row(LINEAR, "smooth", 0.2), row(LINEAR, "pressed", 0.1), row(LINEAR, "gravity", 0.3)]
    rows += [row(SPRINGS, "smooth", 0.02), row(SPRINGS, "pressed", 0.05)]
    rows += [row(SPRINGS, "smooth", 0.1, nu="0.45"), row(SPRINGS, "gravity", 0, status="diverged")]
    assert ratios(rows, SPRINGS, LINEAR) == pytest.approx([0.1, 0.5])


def test_table_states_ratios_own_errors_and_what_has_none() -> None:
    rows = [
        row(method, "smooth", error) for method, error in ((SPRINGS, 0.02), (LINEAR, 0.2), ("fem_p2", 0.01))
    ]
    rows += [
        row(SPRINGS, "gravity", 0.06),
        row(LINEAR, "gravity", 0.1),
        row(SPRINGS, "pressed", 0, status="failed"),
    ]
    rows += [row(SPRINGS, "held_moved", 0.03, reference_error="0.011"), row(LINEAR, "held_moved", 0.1)]
    rows.append(row(UNCUT, "held_moved", 0.2))
    head, lines = table(rows, ["half", "kind", "nu"])
    free, held = (dict(zip(head, line, strict=True)) for line in lines)
    assert (free["cases"], free["no result"], free["undecided"]) == ("2", "1", "0")
    assert (free["median"], free["worst"], free["<= 1/3"]) == ("0.35", "0.60", "50 %")
    assert (free["own error"], free["linear"], free["quadratic"]) == ("4 %", "15 %", "1 %")
    assert (held["undecided"], held["median"], held["uncut"], held["quadratic"]) == ("1", "0.30", "20 %", "-")


def test_equal_nodes_are_beside_the_same_surface_in_the_same_cases() -> None:
    rows = [row("fem_p2", load, 0.1) for load in ("smooth", "pressed")]
    rows += [row(UNCUT, "smooth", 0.3), row(UNCUT, "pressed", 0.9), row(EQUAL, "smooth", 0.05)]
    rows.append(row(SPRINGS, "smooth", 0.01))
    head, ((*_, n, over, _, same, own),) = table_of_equal_nodes(rows)
    assert (n, over, same, own) == ("1", "0.50", "3.00", "5 %")
    assert head[-2] == "on the same surface"


def test_models_are_compared_on_exact_fields_alone() -> None:
    fields = {"kind": EXACT}
    rows = [
        row(LINEAR, "bending", 0.2, **fields),
        row("affine", "bending", 2.34, **fields),
        row("affine", "smooth", 9),
    ]
    rows.append(row("lloyd", "bending", 0, status="refused: floppy", **fields))
    lines = {line[1]: line[3:] for line in table_of_models(rows)[1]}
    assert lines["affine"] == ["1", "0", "11.70", "11.70", "230 %"]
    assert lines["lloyd"] == ["0", "1", "-", "-", "-"]


def test_finding_states_the_median_for_each_poissons_ratio() -> None:
    rows = [row(LINEAR, "smooth", 0.2), row(SPRINGS, "smooth", 0.05)]
    rows += [row(LINEAR, "smooth", 0.2, nu="0.45"), row(SPRINGS, "smooth", 0.02, nu="0.45")]
    assert finding(rows).endswith("in the median: 0.25 at nu = 0.25, 0.1 at nu = 0.45.")


def test_quadratic_elements_are_told_where_they_are_ahead_and_where_not() -> None:
    rows = [row(SPRINGS, load, 0.2) for load in ("smooth", "pressed", "held_moved")]
    rows += [row("fem_p2", "smooth", 0.02), row("fem_p2", "pressed", 0.08), row("fem_p2", "held_moved", 0.3)]
    assert against_quadratic(rows).endswith(
        "in the median: 0.25 under free loads, 1.5 where supports hold the body."
    )


def test_ratios_are_drawn_as_shares_of_the_cases(drawn) -> None:
    rows = [row(LINEAR, load, 0.2) for load in ("smooth", "pressed", "held_moved")]
    rows += [
        row(SPRINGS, load, error) for load, error in (("smooth", 0.4), ("pressed", 0.1), ("held_moved", 0.3))
    ]
    drawn(accuracy)
    free, held, unity = plot_ratios(rows).axes[0].lines  # of quadratic elements there are none
    assert list(free.get_xdata()) == pytest.approx([0.5, 2])
    assert list(free.get_ydata()) == [50, 100]
    assert list(held.get_xdata()) == pytest.approx([1.5])
    assert list(unity.get_xdata()) == [1, 1]


def test_every_body_bears_a_free_and_a_held_load_and_halves_stay_apart() -> None:
    every = cases()
    learnt, judged = cases_of_half(is_held_out=False), cases_of_half(is_held_out=True)
    assert len(set(every)) == len(every) == len(learnt) + len(judged)
    assert not any(case.body.is_held_out for case in learnt) and all(case.body.is_held_out for case in judged)
    by_body = {}
    for case in every:
        by_body.setdefault((case.body, case.nu), []).append(case.kind)
    assert all(sorted(kinds) == ["free", "held"] for kinds in by_body.values())
    assert {case.load for case in learnt} == {*FREE, *HELD}


@pytest.fixture
def stand_ins(ball, tmp_path):
    """Springs off by a tenth of the reference without a refinement, which is off by 0.02 of the refined."""
    programs = make_solvers(tmp_path / "home", ball)
    refined = tmp_path / "home" / "fem_reference_refine_1"
    more = {"program": "fem_reference", "is_free": False, "n_tetrahedra": 10**6}
    write_run(refined, *ball, lambda X: 0.01 / 1.02 * X, np.linspace(0, 1, 2), **more)
    return programs


def bench_of(folder, programs):
    return Bench(folder, Store(folder / "runs", programs=programs))


def test_error_is_to_the_refined_reference_whose_own_is_stated(stand_ins, tmp_path):
    rows = {row["method"]: row for row in bench_of(tmp_path / "study", stand_ins).measure(CASE)}
    assert list(rows) == [SPRINGS, UNCUT, LINEAR, "fem_p2", EQUAL]
    error = (1 + ERRORS["0.25"]) * 1.02 - 1
    assert float(rows[SPRINGS]["error"]) == pytest.approx(error, rel=1e-4)
    assert float(rows["fem_p2"]["error"]) == pytest.approx(0.02, rel=1e-4)
    assert [float(row["reference_error"]) for row in rows.values()] == pytest.approx([0.02] * 5, rel=1e-4)


@pytest.mark.parametrize("load, n_fine", [("held_pressed", 2), ("pressed", 0)])
def test_references_of_held_bodies_alone_are_finer_where_supports_end(load, n_fine, stand_ins, tmp_path):
    bench_of(tmp_path / "study", stand_ins).measure(Case(CASE.body, load, "0.25"))
    fine = [call for call in calls(stand_ins) if "'surface.at_supports', '2'" in call]
    assert len(fine) == n_fine
    assert sorted("'reference.refine', '1'" in call for call in fine) == [False, True][:n_fine]


def test_method_that_fails_is_a_row_that_says_why(stand_ins, tmp_path):
    diverged = Case(CASE.body, "pressed", "diverge")
    rows = bench_of(tmp_path / "study", stand_ins).measure(diverged)
    assert [row["status"] for row in rows] == ["massspring: diverged"] * 3 + ["ok"]
    (stand_ins / "fem_reference").write_text("#!/bin/sh\necho 'error: singular' >&2\nexit 1\n")
    rows = bench_of(tmp_path / "other", stand_ins).measure(CASE)
    assert {row["status"] for row in rows} == {"fem_reference: failed: singular"}


_STUDY = """
import sys
from pathlib import Path
from pathlib import Path
from analysis.run_store import Store
from analysis.runs import record_of
from analysis.studies.accuracy import Bench, cases_of_half
folder, programs = map(Path, sys.argv[1:])
bench = Bench(folder, Store(folder / "runs", programs=programs))
rows = [row for case in cases_of_half(is_held_out=False, is_quick=True) for row in bench.measure(case)]
(folder / "rows.txt").write_text(repr(rows))
"""


def test_study_killed_at_random_points_continues_to_the_same_table(stand_ins, tmp_path):
    def start(folder):
        return subprocess.Popen([sys.executable, "-c", _STUDY, str(folder), str(stand_ins)], cwd=ROOT)

    assert start(tmp_path / "whole").wait() == 0
    n_points = len(calls(stand_ins))
    moments = random.Random(3)
    for _ in range(2):
        process = start(tmp_path / "killed")
        wait_for_calls(stand_ins, len(calls(stand_ins)) + moments.randint(2, 6), moments.uniform(0, 0.05))
        process.kill()
        assert process.wait() == -signal.SIGKILL
    finished = sum(
        ".part" not in f.parent.name for f in (tmp_path / "killed" / "runs").glob("*/outcome.json")
    )
    n_calls = len(calls(stand_ins))
    assert 0 < finished < n_points
    assert start(tmp_path / "killed").wait() == 0
    whole, killed = ((tmp_path / name / "rows.txt").read_text() for name in ("whole", "killed"))
    assert whole == killed
    assert len(calls(stand_ins)) - n_calls - (n_points - finished) in (0, 1)


def test_publishing_one_half_leaves_the_other(tmp_path, monkeypatch):
    monkeypatch.setattr(accuracy, "DATA", tmp_path / "rows.csv")
    monkeypatch.setattr(accuracy, "PAGE", tmp_path / "page.md")
    other = row(SPRINGS, "smooth", 0.5, half="held-out")
    publish([other, row(SPRINGS, "smooth", 0.1), row(LINEAR, "smooth", 0.2)])
    publish([row(SPRINGS, "smooth", 0.05), row(LINEAR, "smooth", 0.2)])
    assert [r["error"] for r in read_rows()] == ["0.5", "0.05", "0.2"]
    assert (
        "| development | free | 0.25 | 1 | 0 | 0 | 0.25 | 0.25 | 100 % | 5 % |"
        in (tmp_path / "page.md").read_text()
    )


def test_quick_study_leaves_a_report_and_publishes_nothing(tmp_path, monkeypatch, capsys) -> None:
    class StandIn:
        def __init__(self, folder: Path, *_) -> None:
            assert folder.is_absolute()  # scenes in it name their bodies

        def measure(self, case: Case) -> list[dict[str, str]]:
            return [row(SPRINGS, case.load, 0.1), row(LINEAR, case.load, 0.4)]

    monkeypatch.setattr(accuracy, "Bench", StandIn)
    monkeypatch.setattr(accuracy, "exact_rows", lambda *_: [row(LINEAR, "bending", 0.2, kind=EXACT)])
    monkeypatch.setattr(accuracy, "publish", None)
    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(parse_arguments(["study", "accuracy", "--quick", "--out", "out"])) == 0
    said = capsys.readouterr()
    assert "0.25 at nu = 0.25" in said.out and "[4/4]" in said.err
    page = (out / "report.html").read_text()
    assert "bodies and loads drawn at random, springs beside" in page and "programs (SHA-256)" in page
    assert {"rows.csv", "loads.csv", "by_load.csv", "equal_nodes.csv", "ratios.svg", "report.html"} <= {
        file.name for file in out.iterdir()
    }


@pytest.mark.skipif(not (PROGRAMS / "accuracy").exists(), reason="the program accuracy is not built")
def test_program_measures_each_case_once(tmp_path) -> None:
    def measure(*models: str) -> str:
        words = ["--out", str(file), "--surface", "ball:162", "--nu", "0.25", "--model", *models]
        subprocess.run([PROGRAMS / "accuracy", *words], check=True, capture_output=True)
        return file.read_text()

    file = tmp_path / "accuracy.csv"
    first = measure("uniform")
    both = measure("edge_coupled", "uniform")
    assert both.startswith(first) and measure("uniform", "edge_coupled") == both
    rows = {(r["model"], r["load"]): r for r in csv.DictReader(both.splitlines())}
    assert len(both.splitlines()) == 1 + len(rows) == 1 + 2 * 6
    for model in ("uniform", "edge_coupled"):
        # A pressure works by the change of volume, exactly -3 of the volume: compliance is the share of it.
        pressed = rows[model, "pressure"]
        compliance, change = float(pressed["compliance"]), float(pressed["volume_change_error"])
        assert change == pytest.approx(-3 * (compliance - 1), rel=1e-3, abs=1e-8)
    assert abs(float(rows["uniform", "pressure"]["compliance"]) - 1) > 0.01
    fields = ("pressure", "uniaxial", "shear")  # linear
    assert max(float(rows["edge_coupled", load]["error_l2"]) for load in fields) < 1e-8


@pytest.mark.skipif(not (PROGRAMS / "accuracy").exists(), reason="the program accuracy is not built")
def test_errors_of_the_program_are_those_that_springs_find_of_themselves(tmp_path) -> None:
    """The diagnostics of a run on the same network tell mean errors of exact fields."""
    table, scene, out = (tmp_path / name for name in ("accuracy.csv", "scene.toml", "out"))
    words = ["--out", table, "--surface", "ball:162", "--nu", "0.25", "--model", "edge_coupled"]
    subprocess.run([PROGRAMS / "accuracy", *words], check=True, capture_output=True)
    rows = {row["load"]: row for row in csv.DictReader(table.read_text().splitlines())}
    scene.write_text(
        '[surface]\nshape = "ball"\nn_vertices = 162\nnormalise = true\nacross = 0\n'
        '[network]\ncalibration = "edge_coupled"\n[[loads]]\npressure = 1.0\n'
    )
    subprocess.run([PROGRAMS / "massspring", scene, "--quiet", "--out", out], check=True)
    own = record_of(out)["diagnostics"]
    for load in ("bending", "torsion"):
        assert float(rows[load]["error_l2"]) == pytest.approx(own[f"{load}_error"], rel=1e-5)
        assert float(rows[load]["error_max"]) > 1.1 * own[f"{load}_error"]


@pytest.mark.skipif(not (PROGRAMS / "accuracy").exists(), reason="the program accuracy is not built")
def test_every_seed_draws_a_network_of_its_own(tmp_path) -> None:
    file = tmp_path / "accuracy.csv"
    words = ["--out", file, "--surface", "ball:162", "--nu", "0.25", "--model", "uniform", "--seed", "1", "2"]
    subprocess.run([PROGRAMS / "accuracy", *words], check=True, capture_output=True)
    found = {
        (row["load"], row["seed"]): row["error_l2"] for row in csv.DictReader(file.read_text().splitlines())
    }
    assert found["bending", "1"] != found["bending", "2"]


def test_exact_fields_are_rows_of_their_mean_errors(tmp_path, monkeypatch):
    lines = ["surface,n_nodes,nu,model,load,status,error_l2,error_max"]
    lines += [
        f"{name}.ply,12,0.25,affine,{load},ok,0.1,0.3"
        for name, load in (("a", "bending"), ("a", "shear"), ("b", "bending"))
    ]
    (tmp_path / "exact_fields.csv").write_text("\n".join(lines))
    monkeypatch.setattr(accuracy, "write_body", lambda *_: tmp_path / "a.ply")
    monkeypatch.setattr(accuracy.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=0))
    (found,) = accuracy.exact_rows(tmp_path, [CASE.body])
    assert (found["kind"], found["load"], found["method"]) == (EXACT, "bending", "affine")
    assert (found["error"], found["n_nodes"], found["reference_error"]) == ("0.1", "12", "0")


def test_page_is_that_of_the_published_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(accuracy, "PAGE", tmp_path / "page.md")
    write_page(read_rows())
    assert (tmp_path / "page.md").read_text() == PAGE.read_text()


@pytest.mark.skipif(not (PROGRAMS / "fem_reference").exists(), reason="the programs are not built")
def test_published_rows_are_those_of_a_fresh_run(tmp_path):
    """Of the cheapest body of the development half."""
    published = [r for r in read_rows() if (r["half"], r["triangles"]) == ("development", "cad")]
    (case,) = (c for c in cases() if (c.body.name, c.kind, c.nu) == ("bracket-1-cad", "free", "0.45"))
    fresh = Bench(tmp_path).measure(case)
    assert len(fresh) == 4
    for row in fresh:
        (known,) = [
            r for r in published if all(r[key] == row[key] for key in ("body", "load", "nu", "method"))
        ]
        assert known["status"] == row["status"] == "ok"
        # Four digits are published, and meshes are the same.
        assert float(row["error"]) == pytest.approx(float(known["error"]), rel=1e-3, abs=1e-6), row
