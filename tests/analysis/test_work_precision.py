"""Work-precision studies: fronts, crossings and words on curves whose answer is known; a study over stand-ins."""

import random
import signal
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from pages import fetched
from solvers import ERRORS, calls, make_solvers, wait_for_calls

from analysis.experiment import ROOT
from analysis.front import pareto, seconds_for
from analysis.points import Store
from analysis.runs import RunError
from analysis.study import Result, Section, write
from analysis.style import FEM_P2
from analysis.work_precision import (
    FULL,
    Effort,
    SceneStudy,
    curves_of,
    in_words,
    methods_of,
    plot,
    table,
    winners,
)

# error = seconds^-1 and, ten times as slow at first, seconds^-2 / 10: they meet where t^-1 = 10 t^-2, t = 10, error 0.1.
SPRINGS = [(t, 1 / t) for t in (1.0, 10.0, 100.0, 1000.0)]
ELEMENTS = [(t, 10 / t**2) for t in (4.0, 40.0, 400.0)]


def test_front_is_what_no_other_beats():
    points = [(3, 0.1), (1, 0.5), (2, 0.6), (4, 0.1), (5, 0.05), (1, 0.4)]
    assert [points[i] for i in pareto(points)] == [(1, 0.4), (3, 0.1), (5, 0.05)]
    points = [tuple(point) for point in np.random.default_rng(1).uniform(size=(200, 2))]
    brute_force = {p for p in points if not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)}
    assert {points[i] for i in pareto(points)} == brute_force


def test_seconds_are_interpolated_in_the_logarithms():
    assert seconds_for(SPRINGS, 0.02) == pytest.approx(50)
    assert seconds_for(SPRINGS, 5) == 1
    assert seconds_for(SPRINGS, 1e-4) is None
    assert seconds_for([*SPRINGS, (500.0, 0.9)], 0.02) == pytest.approx(50)  # a bad point beside the front


def test_methods_change_places_where_their_curves_cross():
    parts = winners({"node_averaged": SPRINGS, FEM_P2: ELEMENTS})
    assert [name for name, _, _ in parts] == ["node_averaged", FEM_P2]
    assert parts[0][2] == pytest.approx(0.1, rel=0.05)  # 400 steps over 4 decades


def test_words_name_wins_and_losses_of_the_springs():
    words = " ".join(in_words({"node_averaged": SPRINGS, FEM_P2: ELEMENTS}))
    assert "springs, node_averaged down to 10" in words
    # At 3 %: 33.3 s against sqrt(10 / 0.03) = 18.3 s; at 0.3 %: 333 against 57.7.
    assert "At 3 % the best springs (node_averaged) are 1.8 times slower" in words
    assert "33 s against 18 s" in words
    faster = in_words({"node_averaged": [(t / 100, e) for t, e in SPRINGS], FEM_P2: ELEMENTS})
    assert "At 3 % the best springs (node_averaged) are 55 times faster" in " ".join(faster)
    alone = in_words({"uniform": [(1.0, 0.5)], FEM_P2: ELEMENTS})
    assert "No springs reach 3 %" in " ".join(alone)


def test_every_method_has_a_line_in_static_and_dynamic_scenes():
    for text in ("", '[time]\nmode = "dynamic"\nstep = 0.1'):
        names = [method.name for method in methods_of(tomllib.loads(text))]
        assert len(names) == len(set(names))
        assert {"fem_p1", "fem_p2"} < set(names)
        assert any(name.startswith("uniform") for name in names)


@pytest.mark.parametrize(
    "text, message",
    [
        ('[surface]\nfile = "a.obj"', "surface.shape is missing"),
        ('[time]\nmode = "dynamic"', "time.step is missing"),
    ],
)
def test_scene_without_a_ladder_is_refused(text, message, tmp_path):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(RunError, match=message):
        SceneStudy(tmp_path / "scene.toml", FULL, *[Store(tmp_path / "points")] * 2)


@pytest.fixture(scope="module")
def study(ball, tmp_path_factory):
    """Springs that are off by a tenth of the reference, which estimates its own error as 1 %."""
    tmp_path = tmp_path_factory.mktemp("study")
    programs = make_solvers(tmp_path / "home", ball)
    (tmp_path / "scene.toml").write_text('[surface]\nshape = "ball"\n')
    store = Store(tmp_path / "points", programs=programs)
    study = SceneStudy(tmp_path / "scene.toml", Effort((1, 2), (1, 2), 2, 0), store, store)
    study.run(is_quiet=True)
    return study, programs


def test_study_measures_the_error_of_the_runs_and_repeats_them(study):
    study, programs = study
    springs = [m for m in study.measurements if m.method.program == "massspring"]
    assert [m.error for m in springs] == pytest.approx([ERRORS["0.25"]] * len(springs), rel=1e-9)
    assert {len(m.outcomes) for m in study.measurements} == {2}
    assert {m.reference_error for m in study.measurements} == {0.01}
    assert springs[0].whole == pytest.approx(0.1 + 0.2 + 0.3)  # the synthetic run's mesh, setup and solve
    assert springs[0].seconds("solve") == pytest.approx([0.3] * 2)
    # Elements agree with the reference, which are the same stand-in; their error is as good as the reference's.
    assert curves_of(study.measurements)["fem_p2"][0][1] == 0.01
    order = [line.split()[0] for line in calls(programs)]
    n = len(study.measurements)
    assert order[:n] == order[n : 2 * n]


def test_study_again_runs_nothing(study):
    first, programs = study
    n_calls = len(calls(programs))
    again = SceneStudy(first.file, first.effort, first.timed, first.store)
    again.run(is_quiet=True)
    assert len(calls(programs)) == n_calls
    assert table(again) == table(first)


def test_report_stands_alone(study, tmp_path):
    study, _ = study
    figures = {"figure": (plot(study), "caption")}
    write(
        tmp_path / "report",
        Result("Title", "A < B.", [Section("ball", [], figures, {"rows": table(study)})], {}),
    )
    page = (tmp_path / "report" / "report.html").read_text()
    assert '<p class="finding">A &lt; B.</p>' in page
    assert not fetched(page)
    rows = (tmp_path / "report" / "rows.csv").read_text().splitlines()
    assert len(rows) == 1 + len(study.measurements)
    svg = (tmp_path / "report" / "figure.svg").read_text()
    assert "displacement error (%)" in svg and "seconds: whole run" in svg


# A whole study in a process of its own, which writes its table last.
_STUDY = """
import sys
from pathlib import Path
from analysis.points import Store
from analysis.study import Result, Section, write
from analysis.work_precision import Effort, SceneStudy, table
folder, programs = map(Path, sys.argv[1:])
store = Store(folder / "points", programs=programs)
print("ready", flush=True)
study = SceneStudy(folder.parent / "scene.toml", Effort((1,), (1,), 2, 0), store, store)
study.run(is_quiet=True)
write(folder, Result("Title", "A finding.", [Section("ball", [], {}, {"rows": table(study)})], {}))
"""


def start_study(folder, programs):
    words = [sys.executable, "-c", _STUDY, str(folder), str(programs)]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


def test_study_killed_at_random_points_continues_to_the_same_table(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball, seconds=0.05)
    (tmp_path / "scene.toml").write_text('[surface]\nshape = "ball"\n')
    assert start_study(tmp_path / "whole", programs).wait() == 0
    n_points = len(calls(programs))
    moments = random.Random(2)
    for _ in range(3):
        process = start_study(tmp_path / "killed", programs)
        wait_for_calls(programs, len(calls(programs)) + moments.randint(2, 5), moments.uniform(0, 0.1))
        process.kill()
        assert process.wait() == -signal.SIGKILL
    outcomes = (tmp_path / "killed" / "points").glob("*/outcome.json")
    finished = {file: file.stat().st_mtime_ns for file in outcomes if ".part" not in file.parent.name}
    n_calls = len(calls(programs))
    assert finished and not (tmp_path / "killed" / "report.html").exists()
    assert start_study(tmp_path / "killed", programs).wait() == 0
    assert (tmp_path / "killed" / "rows.csv").read_text() == (tmp_path / "whole" / "rows.csv").read_text()
    assert {file: file.stat().st_mtime_ns for file in finished} == finished
    # A solver that was about to start as its study was killed may run once more.
    assert len(calls(programs)) - n_calls - (n_points - len(finished)) in (0, 1)
