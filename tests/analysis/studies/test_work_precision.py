"""Work-precision studies: fronts, crossings and words on curves whose answer is known; a study over stand-ins."""

import random
import signal
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from pages import fetched
from solvers import ERRORS, calls, make_solvers, wait_for_calls
from synthetic import write_run

from analysis.__main__ import parse_arguments
from analysis.front import pareto, seconds_for
from analysis.methods import FEM_P2
from analysis.paths import ROOT
from analysis.points import Outcome, Store
from analysis.runs import RunError
from analysis.studies import work_precision
from analysis.studies.result import Result, Section, write
from analysis.studies.work_precision import (
    FULL,
    QUICK,
    Effort,
    Measurement,
    SceneStudy,
    advice,
    curves_of,
    in_words,
    is_linear,
    methods_of,
    noise,
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


def test_errors_of_no_use_win_nothing():
    curves = {"uniform": [(0.001, 0.9)], "affine": [(1.0, 0.8), (10.0, 0.01)]}
    assert winners(curves) == [("affine", pytest.approx(0.3), pytest.approx(0.01))]
    assert winners({"uniform": [(0.1, 0.9)], "affine": [(1.0, 0.6)]}) == [
        ("affine", pytest.approx(0.6), pytest.approx(0.6))
    ]
    assert winners({}) == []


def test_words_name_wins_and_losses_of_the_springs():
    words = " ".join(in_words({"node_averaged": SPRINGS, FEM_P2: ELEMENTS}))
    assert "springs, node_averaged down to 10" in words
    # At 3 %: 33.3 s against sqrt(10 / 0.03) = 18.3 s; at 0.3 %: 333 against 57.7.
    assert "At 3 % the best springs (node_averaged) take 33 s, the best elements (" in words
    assert "quadratic) 18 s." in words
    alone = in_words({"uniform": [(1.0, 0.5)], FEM_P2: ELEMENTS})
    assert "No springs reach 3 %" in " ".join(alone)
    springs_alone = in_words({"uniform": SPRINGS, FEM_P2: [(2.0, 0.5)]})
    assert "No elements reach 3 % on this ladder; springs, uniform do in 33 s." in springs_alone
    assert in_words({"uniform": SPRINGS})[0] == "springs, uniform is the fastest at every error reached."


def test_advice_names_the_fastest_of_every_error_and_its_seconds():
    rows = advice({"node_averaged": SPRINGS, FEM_P2: ELEMENTS})
    assert rows[0][:2] == ["30 % to 10 %", "springs, node_averaged"]
    assert [row[1] for row in rows] == ["springs, node_averaged", "finite elements, quadratic"]
    assert rows[0][2] == "3.3 s to 9.8 s"  # 1 / error, of which a grid in the logarithms is searched
    assert advice({}) == []


def test_every_method_has_a_line_in_static_and_dynamic_scenes():
    for text in ("", '[time]\nmode = "dynamic"\nstep = 0.1'):
        names = [method.name for method in methods_of(tomllib.loads(text))]
        assert len(names) == len(set(names))
        assert {"fem_p1", "fem_p2"} < set(names)
        assert any(name.startswith("uniform") for name in names)


@pytest.mark.parametrize("text", ["", '[time]\nmode = "dynamic"\nstep = 0.1'])
def test_methods_differ_in_degree_or_springs_and_scheme(text, tmp_path):
    (tmp_path / "scene.toml").write_text(text or STATIC)
    study = SceneStudy(tmp_path / "scene.toml", QUICK, *[Ladder(tmp_path)] * 2)
    for m in study.measurements:
        point = study.point(m, 3)
        words = dict(word.split("=") for word in point.overrides)
        asked = (
            point.program,
            point.options,
            words.get("reference.degree"),
            words.get("network.calibration"),
        )
        model, *scheme = m.method.name.split(", ")
        assert asked == {
            "fem_p1": ("fem_reference", (), "1", None),
            "fem_p2": ("fem_reference", (), "2", None),
        }.get(model, ("massspring", ("--no-diagnostics",), None, model))
        if point.program == "fem_reference":
            assert [words[key] for key in ("reference.integrator",) if key in words] == scheme
        if text and point.program == "massspring":
            assert [words["time.integrator"]] == scheme
        # A displacement that is proportional to the load needs one step; a motion's load has none.
        assert ("time.load_steps" in words) == (not text)
        assert point.repetition == 3


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


def measurement(*outcomes, **more):
    return Measurement(methods_of({})[0], 1, list(outcomes), **more)


def timed(cpu=1.0, memory=0, **seconds):
    return Outcome("ok", "", 1.0, cpu, 0.0, record={"seconds": seconds, "peak_memory": memory})


def test_errors_within_twice_the_references_own_are_not_resolved():
    assert measurement(error=0.021, reference_error=0.01).is_resolved
    assert not measurement(error=0.019, reference_error=0.01).is_resolved
    assert measurement(error=1e-9).is_resolved
    assert not measurement(reference_error=0.01).is_resolved


def test_seconds_are_the_median_without_the_output():
    m = measurement(
        *(timed(memory=byte, setup=1, solve=solve, output=100) for solve, byte in ((2, 5), (40, 7), (3, 6)))
    )
    assert m.seconds() == [3, 41, 4]
    assert m.seconds("solve", "output") == [102, 140, 103]
    assert m.whole == 4
    assert m.memory == 7


def test_plot_has_errors_over_seconds_and_a_band_of_the_references_own(drawn):
    rungs = [
        measurement(timed(setup=9 * s, solve=s, output=5), error=error, reference_error=0.01)
        for s, error in ((1, 0.1), (10, 0.001))
    ]
    study = SimpleNamespace(measurements=rungs, name="ball")
    whole, solve = drawn(work_precision).plot(study).axes
    for axes, seconds in ((whole, [10, 100]), (solve, [1, 10])):
        curve, resolved, hollow = axes.lines
        assert list(curve.get_xdata()) == seconds and list(curve.get_ydata()) == pytest.approx([10, 0.1])
        assert list(resolved.get_xdata()) == seconds[:1] and list(hollow.get_xdata()) == seconds[1:]
        assert hollow.get_markerfacecolor() == "white" != resolved.get_markerfacecolor()
        (band,) = axes.patches
        assert band.get_y() + band.get_height() == pytest.approx(1)
    labels = [text.get_text() for text in solve.get_legend().get_texts()]
    assert labels == ["springs, uniform (-2.0)"]


def test_runs_that_waited_for_a_core_are_counted():
    assert noise([measurement(timed(cpu=0.91), timed(cpu=1.5))]) == "Every timed run had a core for itself."
    words = noise([measurement(timed(cpu=0.89), timed(cpu=1)), measurement(timed(cpu=1))])
    assert words.startswith("1 of 3 timed runs waited")


def test_plot_has_bars_from_the_fastest_to_the_slowest_run(drawn):
    """Of runs of 2, 40 and 3 s, of which 1 s is not the solve."""
    runs = [timed(setup=1, solve=solve) for solve in (1, 39, 2)]
    study = SimpleNamespace(name="", measurements=[measurement(*runs, error=0.1, reference_error=0.06)])
    whole, solve = drawn(work_precision).plot(study).axes
    for axes, seconds in ((whole, (2, 3, 40)), (solve, (1, 2, 39))):
        (bar,) = axes.containers[0].lines[2][0].get_segments()
        np.testing.assert_allclose(bar, [[seconds[0], 10], [seconds[2], 10]])


class Ladder:
    """A store of runs whose displacement is known: (1 + its error) times that of the limit, X.

    Elements of n tetrahedra err by in_space / ratio^refinements, and by in_time step^2; springs by a tenth.
    """

    def __init__(self, folder, in_space=0.0, ratio=8.0, in_time=0.0, n=100):
        self.folder, self.in_space, self.ratio, self.in_time, self.n = folder, in_space, ratio, in_time, n
        self.points = []
        X = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)
        upper = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2)]
        self.surface = X, np.array(upper + [(b, a, 5) for a, b, _ in upper])

    def error(self, settings):
        refinements = int(settings.get("reference.refine", 0))
        return (
            self.in_space / self.ratio**refinements + self.in_time * float(settings.get("time.step", 0)) ** 2
        )

    def run(self, point):
        self.points.append(point)
        settings = dict(override.split("=", 1) for override in point.overrides)
        error = 0.1 if point.program == "massspring" else self.error(settings)
        folder = self.folder / str(len(self.points))
        record = {"program": point.program, "is_free": False, "n_tetrahedra": self.n}
        if point.options[:1] == ("--converge",):
            error = self.error(settings | {"reference.refine": 1})
            record["convergence"] = {
                "status": "ok",
                "estimated_error_l2_finest": error,
                "error_ratio": self.ratio,
            }
        write_run(folder, *self.surface, lambda X: (1 + error) * X, **record)
        record["seconds"] = {"solve": 1.0}
        return Outcome("ok", "", 1, 1, 0, folder, record | {"n_nodes": 6})


STATIC = '[surface]\nshape = "ball"\n'
DYNAMIC = '[time]\nmode = "dynamic"\nstep = 0.1\n'


def study_over(ladder, scene, reference_tetrahedra=0, factors=(1,)):
    file = ladder.folder / "scene.toml"
    file.write_text(scene)
    study = SceneStudy(file, Effort(factors, (1, 2), 1, reference_tetrahedra), ladder, ladder)
    study.run(is_quiet=True)
    return study


LARGE = {
    "ball_deflates",
    "ball_inflates",
    "bar_bend",
    "handle_folds",
    "head_crushes",
    "hollow_ball_inflates",
    "inflate",
}
LARGE |= {
    "squash",
    "torus_implodes",
    "torus_inflates",
}  # as the solvers have it, ShippedScenesHaveTheLawOfTheirStrain


def test_scenes_are_linear_where_the_solvers_take_small_strain():
    files = sorted((ROOT / "analysis" / "scenes").glob("*.toml"))
    assert {file.stem for file in files if not is_linear(tomllib.loads(file.read_text()))} == LARGE
    named = {"material": {"law": "small_strain"}, "loads": [{"pressure": 1, "follower": True}]}
    assert is_linear(named)
    assert not is_linear(named | {"material": {}})


@pytest.mark.parametrize("reference_tetrahedra, refinements", [(6400, 2), (6399, 1)])
@pytest.mark.parametrize("ratio", [4, 8])
def test_static_reference_states_its_own_error(ratio, reference_tetrahedra, refinements, tmp_path):
    study = study_over(Ladder(tmp_path, 0.032, ratio), STATIC, reference_tetrahedra)
    error = 0.032 / ratio**refinements
    springs = [m for m in study.measurements if m.method.program == "massspring"]
    assert [m.reference_error for m in springs] == pytest.approx([error] * len(springs))
    assert [m.error for m in springs] == pytest.approx([(0.1 - error) / (1 + error)] * len(springs))


def test_references_of_large_strain_are_refined_while_they_have_a_sixth_of_the_tetrahedra(tmp_path):
    for number, law, tetrahedra, refinements in (
        (1, "neo_hookean", 6 * 6400, 2),
        (2, "neo_hookean", 6 * 6400 - 1, 1),
        (3, "small_strain", 6400, 2),
    ):
        (tmp_path / str(number)).mkdir()
        ladder = Ladder(tmp_path / str(number), 0.032)
        study = study_over(ladder, f'{STATIC}[material]\nlaw = "{law}"\n', tetrahedra)
        assert study.measurements[0].reference_error == pytest.approx(0.032 / 8**refinements)
        # Many load steps where the displacement is not proportional to the load, for every method alike.
        is_one_step = {"time.load_steps=1" in point.overrides for point in ladder.points}
        assert is_one_step == {law == "small_strain"}


def test_dynamic_reference_states_its_error_in_time_and_space(tmp_path):
    in_time, in_space = 0.016 / 0.1**2, 0.001
    ladder = Ladder(tmp_path, in_space, 8, in_time)
    study = study_over(ladder, DYNAMIC)
    # The ladder's shortest step is 0.1 s, the reference's a quarter. Space: what a refinement changes.
    error = 0.016 / 4**2 + in_space * (1 - 1 / 8)
    # Steps of the methods without a ladder of their own.
    assert {row[1] for row in table(study)[1][:16]} == {"0.2", "0.1"}
    # Relative to a displacement that errs by 0.3 % itself.
    assert study.measurements[0].reference_error == pytest.approx(error, rel=0.01)
    exact = 1 + 0.016 / 4**2 + in_space / 8
    springs = [m for m in study.measurements if m.method.program == "massspring"]
    assert [m.error for m in springs] == pytest.approx([1.1 / exact - 1] * len(springs))
    elements = [m for m in study.measurements if m.method.program == "fem_reference"]
    own = [1 + 0.016 * m.factor**2 + in_space for m in elements]
    assert [m.error for m in elements] == pytest.approx([abs(u / exact - 1) for u in own])


@pytest.mark.parametrize("effort", [FULL, QUICK])
def test_all_steps_of_a_ladder_write_frames_at_the_same_moments(effort, tmp_path):
    (tmp_path / "scene.toml").write_text(DYNAMIC)
    study = SceneStudy(tmp_path / "scene.toml", effort, *[Ladder(tmp_path)] * 2)
    for m in study.measurements:
        words = dict(word.split("=") for word in study.rung(m.factor))
        assert float(words["time.step"]) == pytest.approx(0.1 * m.factor)
        assert float(words["time.step"]) * int(words["output.frames_every"]) == pytest.approx(
            0.1 * max(effort.steps)
        )


def test_ladder_of_surfaces_is_in_shares_of_the_scenes_vertices(tmp_path):
    (tmp_path / "scene.toml").write_text(STATIC + "n_vertices = 900\n")
    study = SceneStudy(tmp_path / "scene.toml", FULL, *[Ladder(tmp_path)] * 2)
    assert study.rung(0.25)[0] == "surface.n_vertices=225"
    assert study.rung(4)[0] == "surface.n_vertices=3600"


def test_rows_without_a_reference_say_why(tmp_path):
    class Diverging(Ladder):
        def run(self, point):
            outcome = super().run(point)
            outcome.record.get("convergence", {})["status"] = "not converging"
            return outcome

    study = study_over(Diverging(tmp_path), STATIC)
    assert {m.message for m in study.measurements} == {"no reference: its refinements are not converging"}
    assert not any(m.is_good for m in study.measurements)
    assert curves_of(study.measurements) == {}


def test_errors_below_the_references_own_count_as_that():
    known = [
        measurement(timed(solve=2), error=e, reference_error=r)
        for e, r in ((0.2, 0.1), (0.1, 0.2), (0.3, None))
    ]
    assert curves_of(known) == {"uniform": [(2, 0.2), (2, 0.2), (2, 0.3)]}


class Failing(Ladder):
    """moment takes too long, lloyd breaks down."""

    def run(self, point):
        outcome = super().run(point)
        if "network.calibration=moment" in point.overrides:
            return Outcome("time limit", "stopped", 9, 9, 0)
        return Outcome("diverged", "", 1, 1, 0) if "network.calibration=lloyd" in point.overrides else outcome


def test_methods_beyond_the_time_limit_are_not_tried_on_finer_rungs(tmp_path):
    study = study_over(Failing(tmp_path), STATIC, factors=(1, 2))
    said = {(m.method.name, m.factor): m.message for m in study.measurements if not m.is_good}
    assert said == {
        ("moment", 1): "time limit: stopped",
        ("moment", 2): "not tried: beyond the time limit on a coarser rung",
        ("lloyd", 1): "diverged",
        ("lloyd", 2): "diverged",
    }
    head, rows = table(study)
    assert {row[-1] for row in rows} == {"", *said.values()}
    assert all(len(row) == len(head) for row in rows)


def test_time_limit_is_that_of_timed_runs_alone(tmp_path, monkeypatch):
    """References may take as long as they need."""
    ladders = {}

    def store(folder, time_limit=None):
        folder.mkdir(parents=True, exist_ok=True)
        ladders[time_limit] = Ladder(folder / str(time_limit), in_space=0.032)
        return ladders[time_limit]

    monkeypatch.setattr(work_precision, "Store", store)
    monkeypatch.setattr(work_precision, "alone", lambda _: nullcontext())
    (tmp_path / "scene.toml").write_text(STATIC)
    options = ["--quick", "--quiet", "--repetitions", "2", "--time-limit", "7"]
    arguments = parse_arguments(["study", "work-precision", str(tmp_path / "scene.toml"), *options])
    result = work_precision.study(arguments, tmp_path / "out")
    assert list(result.sections[-1].tables) == ["use_when"]
    repetitions = {limit: {point.repetition for point in ladder.points} for limit, ladder in ladders.items()}
    assert repetitions == {7: {0, 1}, None: {0}}
    assert {point.program for point in ladders[None].points} == {"fem_reference"}


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
    row = dict(zip(*[table(study)[0], table(study)[1][0]], strict=True))
    assert (row["vertices"], row["error"], row["of reference"]) == ("642", "10 %", "1 %")
    assert {line[1] for line in table(study)[1]} == {"642", "1284"}
    assert [row[f"{part} (s)"] for part in ("set-up", "solve", "whole", "spread")] == [
        "0.3", "0.3", "0.6", "0.6 to 0.6"
    ]  # fmt: skip
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
        Result("Title", "A < B.", [Section("ball", [], figures, {"rows": table(study)})]),
        {},
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
from analysis.points import Outcome, Store
from analysis.studies.result import Result, Section, write
from analysis.studies.work_precision import Effort, SceneStudy, table
folder, programs = map(Path, sys.argv[1:])
store = Store(folder / "points", programs=programs)
print("ready", flush=True)
study = SceneStudy(folder.parent / "scene.toml", Effort((1,), (1,), 2, 0), store, store)
study.run(is_quiet=True)
write(folder, Result("Title", "A finding.", [Section("ball", [], {}, {"rows": table(study)})]), {})
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
