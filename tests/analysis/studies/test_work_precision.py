"""Work-precision studies: methods, ladders, seeds, references; a study over stand-ins for the programs."""

import random
import signal
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from pages import fetched
from races import measurement, timed
from solvers import ERRORS, calls, make_solvers, wait_for_calls
from synthetic import write_run

from analysis.__main__ import parse_arguments
from analysis.paths import PROGRAMS, ROOT
from analysis.run_store import Outcome, Store
from analysis.runs import RunError, load_run
from analysis.studies import fronts, race, work_precision
from analysis.studies.race import (
    CHANGES,
    FULL,
    QUICK,
    REGIMES,
    SMALL,
    Effort,
    Rung,
    SceneStudy,
    methods_of,
)
from analysis.studies.result import Result, write

STATIC = '[surface]\nshape = "ball"\n'
DYNAMIC = STATIC + '[time]\nmode = "dynamic"\nstep = 0.1\n'


def test_every_method_has_a_line_in_static_and_dynamic_scenes():
    for text in ("", '[time]\nmode = "dynamic"\nstep = 0.1'):
        names = [method.name for method in methods_of(tomllib.loads(text), SMALL)]
        assert len(names) == len(set(names))
        assert {"fem_p1", "fem_p2"} < set(names)
        assert any(name.startswith("uniform") for name in names)


@pytest.mark.parametrize("text", ["", '[time]\nmode = "dynamic"\nstep = 0.1'])
def test_methods_differ_in_degree_or_springs_and_scheme(text, tmp_path):
    (tmp_path / "scene.toml").write_text(STATIC + text)
    study = SceneStudy(tmp_path / "scene.toml", QUICK, *[Ladder(tmp_path)] * 2)
    for m in study.measurements:
        request = study.request(m, 3)
        words = dict(word.split("=") for word in request.overrides)
        asked = (
            request.program,
            request.options,
            words.get("reference.degree"),
            words.get("network.calibration"),
        )
        model, *scheme = m.method.name.split(", ")
        assert asked == {
            "fem_p1": ("fem_reference", (), "1", None),
            "fem_p2": ("fem_reference", (), "2", None),
        }.get(model, ("massspring", ("--no-diagnostics",), None, model))
        if request.program == "fem_reference":
            assert [words[key] for key in ("reference.integrator",) if key in words] == scheme
        if text and request.program == "massspring":
            assert [words["time.integrator"]] == scheme
        # Both programs shorten one load step where it fails; a motion's load has none.
        assert (words.get("time.load_steps"), words.get("time.residual")) == (
            (None, None) if text else ("1", "0.0001")
        )
        # Springs have a seed for every draw; elements are repeated.
        is_springs = request.program == "massspring"
        assert (request.repetition, words.get("network.seed")) == ((0, "4") if is_springs else (3, None))


@pytest.mark.parametrize(
    "text, message",
    [
        ('[surface]\nfile = "a.obj"', "surface.shape is missing"),
        ('[surface]\nshape = "ball"\n[time]\nmode = "dynamic"', "time.step is missing"),
    ],
)
def test_scene_without_a_ladder_is_refused(text, message, tmp_path):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(RunError, match=message):
        SceneStudy(tmp_path / "scene.toml", FULL, *[Store(tmp_path / "runs")] * 2)


def test_errors_within_twice_the_references_own_are_not_resolved():
    assert measurement(errors=[0.021], reference_error=0.01).is_resolved
    assert not measurement(errors=[0.019], reference_error=0.01).is_resolved
    assert measurement(errors=[1e-9]).is_resolved
    assert not measurement(reference_error=0.01).is_resolved


def test_seconds_are_the_median_without_start_and_output():
    m = measurement(
        *(
            timed(memory=byte, setup=1, solve=solve, output=100, **{"start-up": 50})
            for solve, byte in ((2, 5), (40, 7), (3, 6))
        )
    )
    assert m.seconds() == [3, 41, 4]
    assert m.seconds("solve", "output") == [102, 140, 103]
    assert m.whole == 4
    assert m.memory == 7


class Ladder:
    """A store of runs whose displacement is known: (1 + its error) times that of the limit, X.

    Elements of n tetrahedra err by in_space / ratio^refinements, and by in_time step^2; springs by a tenth.
    """

    def __init__(self, folder, in_space=0.0, ratio=8.0, in_time=0.0, n=100):
        self.folder, self.in_space, self.ratio, self.in_time, self.n = folder, in_space, ratio, in_time, n
        self.requests = []
        X = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)
        upper = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2)]
        self.surface = X, np.array(upper + [(b, a, 5) for a, b, _ in upper])

    def error(self, settings):
        refinements = int(settings.get("reference.refine", 0))
        return (
            self.in_space / self.ratio**refinements + self.in_time * float(settings.get("time.step", 0)) ** 2
        )

    def law_of(self, scene):
        return tomllib.loads(scene.read_text()).get("material", {}).get("law", SMALL)

    def run(self, request):
        self.requests.append(request)
        settings = dict(override.split("=", 1) for override in request.overrides)
        error = 0.1 if request.program == "massspring" else self.error(settings)
        folder = self.folder / str(len(self.requests))
        record = {"program": request.program, "is_free": False, "n_tetrahedra": self.n}
        if request.options[:1] == ("--converge",):
            error = self.error(settings | {"reference.refine": 1})
            record["convergence"] = {
                "status": "ok",
                "estimated_error_l2_finest": error,
                "error_ratio": self.ratio,
            }
        write_run(folder, *self.surface, lambda X: (1 + error) * X, **record)
        record["seconds"] = {"solve": 1.0}
        return Outcome("ok", "", 1, 1, 0, folder, record | {"n_nodes": 6})


def study_over(ladder, scene, reference_tetrahedra=0, factors=(1,)):
    file = ladder.folder / "scene.toml"
    file.write_text(scene)
    study = SceneStudy(file, Effort(factors, (1,), (1, 2), (1, 1), 1, reference_tetrahedra), ladder, ladder)
    study.run(is_quiet=True)
    return study


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
        residual = "1e-06" if law == "neo_hookean" else "0.0001"
        methods = [request for request in ladder.requests if "time.load_steps=1" in request.overrides]
        assert any(f"time.residual={residual}" in request.overrides for request in methods)


def test_surfaces_whose_reference_would_be_too_large_are_not_raced(tmp_path):
    for n_tetrahedra, n_springs in ((12_500, 1), (12_501, 0)):
        (tmp_path / str(n_tetrahedra)).mkdir()
        ladder = Ladder(tmp_path / str(n_tetrahedra), 0.032, n=n_tetrahedra)
        study = study_over(ladder, f'{STATIC}[material]\nlaw = "neo_hookean"\n')
        programs = {request.program for request in ladder.requests}
        assert programs == {"fem_reference", "massspring"} if n_springs else {"fem_reference"}
        assert {m.is_good for m in study.measurements} == {bool(n_springs)}
    assert {m.message for m in study.measurements} == {
        "no reference: 100008 tetrahedra, expected 100000 at most"
    }
    assert len(ladder.requests) == 1


@pytest.mark.parametrize("mode, steps", [("static", "1"), ("dynamic", None)])
def test_contact_takes_the_steps_of_its_scene(mode, steps, tmp_path):
    """Where nothing is touched statics take one."""
    (tmp_path / "scene.toml").write_text(f'{STATIC}[time]\nmode = "{mode}"\nstep = 0.1\n')
    floor = "obstacles = [{ plane = { point = [0, 0, 0], normal = [0, 1, 0] } }]\n"
    (tmp_path / "touching.toml").write_text(floor + (tmp_path / "scene.toml").read_text())
    for name, asked in (("scene", steps), ("touching", None)):
        study = SceneStudy(tmp_path / f"{name}.toml", QUICK, *[Ladder(tmp_path)] * 2)
        assert (study.regime == "contact") == (name == "touching")
        words = [dict(w.split("=", 1) for w in study.request(m, 0).overrides) for m in study.measurements]
        assert {word.get("time.load_steps") for word in words} == {asked}


def test_adaptive_springs_have_a_rung_for_every_target(tmp_path):
    (tmp_path / "scene.toml").write_text(STATIC)
    study = SceneStudy(tmp_path / "scene.toml", QUICK, *[Ladder(tmp_path)] * 2)
    key = "network.target_error="
    asked = [
        (
            m.method.name,
            m.rung.size,
            *(word for word in study.request(m, 0).overrides if word.startswith(key)),
        )
        for m in study.measurements
    ]
    adaptive = [row for row in asked if len(row) > 2]
    assert {name for name, *_ in adaptive} == {"node_averaged, adaptive"}
    assert {row[1:] for row in adaptive} == {
        (size, f"{key}{target}") for size in QUICK.factors for target in (0.1, 0.05, 0.02, 0.01)
    }
    assert "node_averaged, adaptive" not in {row[0] for row in asked if len(row) == 2}


def test_seconds_of_adaptive_springs_are_those_of_all_their_networks():
    assert measurement(timed(mesh=1, adapt=10, setup=2, solve=3, estimate=100)).whole == 16


def test_bodies_are_pressed_by_half_of_their_scenes(tmp_path):
    def way(value):
        """The largest, of a displacement or of a path, whose rows begin with the time."""
        return np.abs(np.array(value, dtype=float)[..., -3:]).max()

    for name, changes in CHANGES.items():
        study = SceneStudy(ROOT / "analysis" / "scenes" / f"{name}.toml", QUICK, *[Ladder(tmp_path)] * 2)
        assert set(changes) < set(study.overrides(Rung(1)))
        ways = [change.partition("=") for change in changes if not change.startswith("time.")]
        assert len(ways) == {"supports": 1, "obstacles": 2}[ways[0][0].split(".")[0]]
        for key, _, value in ways:
            part, number, path = key.split(".")
            assert way(tomllib.loads(f"x = {value}")["x"]) == way(study.scene[part][int(number)][path]) / 2
    inflated = SceneStudy(ROOT / "analysis" / "scenes" / "inflate.toml", QUICK, *[Ladder(tmp_path)] * 2)
    assert not any("supports" in word for word in inflated.overrides(Rung(1)))


@pytest.mark.parametrize("ratio", [4, 8])
@pytest.mark.parametrize("reference_tetrahedra, refinements", [(6 * 6400, 2), (6 * 6400 - 1, 1)])
def test_dynamic_reference_states_its_error_in_time_and_space(
    reference_tetrahedra, refinements, ratio, tmp_path
):
    in_time, in_space = 0.016 / 0.1**2, 0.001
    study = study_over(Ladder(tmp_path, in_space, ratio, in_time), DYNAMIC, reference_tetrahedra)
    # The ladder's shortest step is 0.1 s, the reference's a quarter. Space: what is left, of one refinement all that it changes.
    of_space = in_space / ratio**2 if refinements == 2 else in_space * (1 - 1 / ratio)
    assert {row[2] for row in fronts.table(study)[1] if "Euler" not in row[0]} >= {"0.2", "0.1"}
    # Relative to a displacement that errs by 0.3 % itself.
    assert study.measurements[0].reference_error == pytest.approx(0.016 / 4**2 + of_space, rel=0.01)
    exact = 1 + 0.016 / 4**2 + in_space / ratio**refinements
    springs = [m for m in study.measurements if m.method.program == "massspring"]
    assert [m.error for m in springs] == pytest.approx([1.1 / exact - 1] * len(springs))
    elements = [m for m in study.measurements if m.method.program == "fem_reference"]
    own = [1 + 0.016 * m.rung.step**2 + in_space for m in elements]
    assert [m.error for m in elements] == pytest.approx([abs(u / exact - 1) for u in own])


def test_implicit_motion_at_large_strain_stops_at_a_residual_that_is_checked(tmp_path):
    for number, law, tightened in ((1, "neo_hookean", 6), (2, "small_strain", 0)):
        (tmp_path / str(number)).mkdir()
        study = study_over(Ladder(tmp_path / str(number), 0.032), f'{DYNAMIC}[material]\nlaw = "{law}"\n')
        implicit = [m.method for m in study.measurements if not m.method.steps]
        assert all(("time.residual=0.0001" in method.overrides) == bool(tightened) for method in implicit)
        # Both coupled models by two schemes, elements of two degrees.
        assert len(study.tolerances) == tightened
        again = [request for request in study.timed.requests if "time.residual=1e-06" in request.overrides]
        assert len(again) == tightened


def test_motion_whose_refinements_do_not_converge_has_no_reference(tmp_path):
    study = study_over(Ladder(tmp_path, 0.01, 1.2), DYNAMIC, 6 * 6400)
    assert {m.message for m in study.measurements} == {
        "no reference: its refinements are not converging, each to 1 / 1.2 of the last, expected 1 / 1.3"
    }


@pytest.mark.parametrize("effort", [FULL, QUICK])
def test_all_steps_of_a_ladder_write_frames_at_the_same_moments(effort, tmp_path):
    (tmp_path / "scene.toml").write_text(DYNAMIC)
    study = SceneStudy(tmp_path / "scene.toml", effort, *[Ladder(tmp_path)] * 2)
    for m in study.measurements:
        words = dict(word.split("=") for word in study.overrides(m.rung))
        assert float(words["time.step"]) == pytest.approx(0.1 * m.rung.step)
        assert float(words["time.step"]) * int(words["output.frames_every"]) == pytest.approx(
            0.1 * max(effort.steps)
        )


def test_ladder_of_surfaces_is_in_shares_of_the_scenes_vertices(tmp_path):
    (tmp_path / "scene.toml").write_text(STATIC + "n_vertices = 900\n")
    study = SceneStudy(tmp_path / "scene.toml", FULL, *[Ladder(tmp_path)] * 2)
    assert study.overrides(Rung(0.25))[0] == "surface.n_vertices=225"
    assert study.overrides(Rung(4))[0] == "surface.n_vertices=3600"


def test_a_solve_in_one_step_errs_in_volume_by_what_it_ends_with(ball, tmp_path):
    """Its curve has no point where the reference's, which bends, has three."""
    (tmp_path / "scene.toml").write_text(STATIC)
    study = SceneStudy(tmp_path / "scene.toml", FULL, *[Ladder(tmp_path)] * 2)
    one = write_run(tmp_path / "one", *ball, lambda X: 0.022 * X, np.linspace(0, 1, 2), n_patches=1)
    many = write_run(
        tmp_path / "many",
        *ball,
        lambda X: 0.02 * X,
        None,
        lambda time: time**2,
        program="fem_reference",
        is_free=False,
    )
    errors = study._errors(Outcome("ok", "", 1, 1, 0, one), load_run(many))
    assert errors == pytest.approx((0.1, (1.022**3 - 1) / (1.02**3 - 1) - 1))


def test_rows_without_a_reference_say_why(tmp_path):
    class Diverging(Ladder):
        def run(self, request):
            outcome = super().run(request)
            outcome.record.get("convergence", {})["status"] = "not converging"
            return outcome

    study = study_over(Diverging(tmp_path), STATIC)
    assert {m.message for m in study.measurements} == {"no reference: its refinements are not converging"}
    assert not any(m.is_good for m in study.measurements)
    assert fronts.curves_of(study.measurements) == {}


def test_a_run_that_waited_is_repeated_three_times_and_then_left_out(tmp_path):
    class Busy(Ladder):
        """Every first attempt of node_averaged waits for a core, and every attempt of edge_coupled."""

        def run(self, request):
            outcome = super().run(request)
            waits = "network.calibration=edge_coupled" in request.overrides or (
                "network.calibration=node_averaged" in request.overrides and request.repetition == 0
            )
            return replace(outcome, cpu=0.5) if waits else outcome

    study = study_over(Busy(tmp_path), STATIC)
    found = {m.method.name: (len(m.outcomes), len(m.timed), m.is_good) for m in study.measurements}
    assert found["node_averaged"] == found["affine"] == (1, 1, True)
    assert found["edge_coupled"] == (1, 0, True)
    attempts = [
        request.repetition
        for request in study.timed.requests
        if "network.calibration=edge_coupled" in request.overrides and not request.prefix
    ]
    assert attempts[:3] == [0, 1, 2]
    assert {row[0]: row[-1] for row in fronts.table(study)[1]}["springs, edge_coupled"] == "shared a core"


def test_networks_are_drawn_more_often_than_coupled_springs_and_their_median_counts(tmp_path):
    class Random(Ladder):
        """Springs err by a hundredth of their seed."""

        def run(self, request):
            outcome = super().run(request)
            settings = dict(override.split("=", 1) for override in request.overrides)
            if "network.seed" in settings:
                error = int(settings["network.seed"]) / 100
                folder = outcome.folder / "seeded"
                write_run(folder, *self.surface, lambda X: (1 + error) * X, program="massspring")
                return replace(outcome, folder=folder)
            return outcome

    file = tmp_path / "scene.toml"
    file.write_text(STATIC)
    ladder = Random(tmp_path)
    study = SceneStudy(file, Effort((1,), (1,), (1,), (5, 3), 1, 0), ladder, ladder)
    study.run(is_quiet=True)
    errors = {m.method.name: m.errors for m in study.measurements}
    assert errors["uniform"] == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05])
    assert errors["node_averaged"] == pytest.approx([0.01, 0.02, 0.03])
    assert {m.method.name: m.error for m in study.measurements}["uniform"] == pytest.approx(0.03)


@pytest.mark.skipif(not (PROGRAMS / "massspring").exists(), reason="the programs are not built")
def test_every_regime_has_scenes_of_its_own_kind_by_the_law_that_the_programs_take(tmp_path):
    free = tmp_path / "let_go.toml"
    half = "region.plane = { point = [0, 0, 0], normal = [0, 1, 0] }"
    let_go = f"[[supports]]\n{half}\nend = 0.5\n[[initial]]\n{half}\nvelocity = [0, 0, 1]\n"
    free.write_text(DYNAMIC + let_go)
    assert SceneStudy(free, QUICK, *[Store(tmp_path / "runs")] * 2).regime == "large motion"
    for regime, names in REGIMES.items():
        for name in names:
            file = ROOT / "analysis" / "scenes" / f"{name}.toml"
            assert SceneStudy(file, QUICK, *[Store(tmp_path / "runs")] * 2).regime == regime


class Failing(Ladder):
    """moment takes too long, lloyd breaks down."""

    def run(self, request):
        outcome = super().run(request)
        if "network.calibration=moment" in request.overrides:
            return Outcome("time limit", "stopped", 9, 9, 0)
        return (
            Outcome("diverged", "", 1, 1, 0) if "network.calibration=lloyd" in request.overrides else outcome
        )


def test_methods_beyond_the_time_limit_are_not_tried_on_finer_rungs(tmp_path):
    study = study_over(Failing(tmp_path), STATIC, factors=(0.5, 1))
    said = {(m.method.name, m.rung.size): m.message for m in study.measurements if not m.is_good}
    assert said == {
        ("moment", 0.5): "time limit: stopped",
        ("moment", 1): "not tried: beyond the time limit on a coarser rung",
        ("lloyd", 0.5): "diverged",
        ("lloyd", 1): "diverged",
    }
    head, rows = fronts.table(study)
    assert {row[-1] for row in rows} == {"", *said.values()}
    assert all(len(row) == len(head) for row in rows)


def test_targets_beyond_the_time_limit_are_tried_on_finer_surfaces(tmp_path):
    class Adapting(Ladder):
        """Nodes for a target take too long on the coarser of two surfaces."""

        def run(self, request):
            outcome = super().run(request)
            is_slow = {"surface.n_vertices=321", "network.target_error=0.02"} <= set(request.overrides)
            return Outcome("time limit", "stopped", 9, 9, 0) if is_slow else outcome

    study = study_over(Adapting(tmp_path), STATIC, factors=(0.5, 1))
    said = {(m.rung.size, m.rung.target): m.message for m in study.measurements if m.message}
    assert said == {(0.5, 0.02): "time limit: stopped"}


@pytest.mark.parametrize("cores, panels", [({0}, 2), ({0, 1}, 3)])
def test_two_threads_are_timed_where_there_are_two_cores(cores, panels, tmp_path, monkeypatch):
    monkeypatch.setattr(race.os, "sched_getaffinity", lambda _: cores)
    study = study_over(Ladder(tmp_path, 0.032), STATIC)
    assert {m.two_threads is not None for m in study.measurements} == {panels == 3}
    assert {request.prefix for request in study.timed.requests} == {
        (),
        *([race._TWO_THREADS] if panels == 3 else []),
    }
    svg = fronts.plot(study)
    assert svg.count("seconds: ") == panels and ("on two threads" in svg) == (panels == 3)


def test_rungs_coarser_than_a_slow_one_are_drawn_again(tmp_path):
    class Slow(Ladder):
        """Quadratic elements take too long on the finer of two surfaces."""

        def run(self, request):
            outcome = super().run(request)
            is_slow = {"surface.n_vertices=1284", "reference.degree=2", "time.load_steps=1"} <= set(
                request.overrides
            )
            return Outcome("time limit", "stopped", 9, 9, 0) if is_slow and not request.options else outcome

    (tmp_path / "scene.toml").write_text(STATIC + '[material]\nlaw = "neo_hookean"\n')
    ladder = Slow(tmp_path)
    study = SceneStudy(tmp_path / "scene.toml", Effort((1, 2), (1,), (1,), (1, 1), 3, 0), ladder, ladder)
    study.run(is_quiet=True)
    found = {
        m.rung.size: (len(m.outcomes), m.message) for m in study.measurements if m.method.name == "fem_p2"
    }
    assert found == {1: (3, ""), 2: (0, "time limit: stopped")}


def test_time_limit_is_that_of_timed_runs_alone(tmp_path, monkeypatch):
    """References have half an hour."""
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
    assert list(result.sections[0].tables) == ["levels", "regimes"]
    assert {request.program for request in ladders[7].requests} == {"fem_reference", "massspring"}
    assert {request.program for request in ladders[1800].requests} == {"fem_reference"}


@pytest.fixture(scope="module")
def study(ball, tmp_path_factory):
    """Springs that are off by a tenth of the reference, which estimates its own error as 1 %."""
    tmp_path = tmp_path_factory.mktemp("study")
    programs = make_solvers(tmp_path / "home", ball)
    (tmp_path / "scene.toml").write_text('[surface]\nshape = "ball"\n')
    store = Store(tmp_path / "runs", programs=programs)
    study = SceneStudy(tmp_path / "scene.toml", Effort((1, 2), (1,), (1, 2), (2, 2), 2, 0), store, store)
    study.run(is_quiet=True)
    return study, programs


def test_study_measures_the_error_of_the_runs_and_repeats_them(study):
    study, programs = study
    springs = [m for m in study.measurements if m.method.program == "massspring"]
    assert [m.errors for m in springs] == [pytest.approx([ERRORS["0.25"]] * 2, rel=1e-9)] * len(springs)
    assert {len(m.outcomes) for m in study.measurements} == {2}
    assert {m.reference_error for m in study.measurements} == {0.01}
    assert springs[0].whole == pytest.approx(0.1 + 0.2 + 0.3)  # the synthetic run's mesh, setup and solve
    assert springs[0].seconds("solve") == pytest.approx([0.3] * len(springs[0].seconds()))
    row = dict(zip(*[fronts.table(study)[0], fronts.table(study)[1][0]], strict=True))
    assert (row["vertices"], row["error"], row["of reference"]) == ("642", "10 %", "1 %")
    assert {line[1] for line in fronts.table(study)[1]} == {"642", "1284"}
    stages = ("mesh", "set-up", "solve", "whole")
    assert [row[f"{part} (s)"] for part in stages] == ["0.1", "0.2", "0.3", "0.6"]
    # Elements agree with the reference, which are the same stand-in; their error is as good as the reference's.
    assert fronts.curves_of(study.measurements)["fem_p2"][0][1] == 0.01
    # Every method once, then every method again, with another seed.
    seeds = [line.split("('network.seed', '")[1][0] for line in calls(programs) if "network.seed" in line]
    n = len(springs)
    assert sorted(set(seeds[:n])) == ["1"] or "1" in seeds[:n]
    assert seeds.index("2") >= n


def test_study_again_runs_nothing(study):
    first, programs = study
    n_calls = len(calls(programs))
    again = SceneStudy(first.file, first.effort, first.timed, first.store)
    again.run(is_quiet=True)
    assert len(calls(programs)) == n_calls
    assert fronts.table(again) == fronts.table(first)


def test_report_stands_alone(study, tmp_path):
    study, _ = study
    write(tmp_path / "report", Result("Title", "A < B.", [fronts.section(study)]), {})
    page = (tmp_path / "report" / "report.html").read_text()
    assert '<p class="finding">A &lt; B.</p>' in page
    assert not fetched(page)
    rows = (tmp_path / "report" / f"{study.name}.csv").read_text().splitlines()
    assert len(rows) == 1 + len(study.measurements)
    svg = (tmp_path / "report" / f"{study.name}_work_precision.svg").read_text()
    assert "displacement error (%)" in svg and "seconds: meshing" in svg


# A whole study in a process of its own, which writes its table last.
_STUDY = """
import sys
from pathlib import Path
from analysis.run_store import Outcome, Store
from analysis.studies.fronts import table
from analysis.studies.race import Effort, SceneStudy
from analysis.studies.result import Result, Section, write
folder, programs = map(Path, sys.argv[1:])
store = Store(folder / "runs", programs=programs)
print("ready", flush=True)
study = SceneStudy(folder.parent / "scene.toml", Effort((1,), (1,), (1,), (2, 2), 2, 0), store, store)
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
    outcomes = (tmp_path / "killed" / "runs").glob("*/outcome.json")
    finished = {file: file.stat().st_mtime_ns for file in outcomes if ".part" not in file.parent.name}
    n_calls = len(calls(programs))
    assert finished and not (tmp_path / "killed" / "report.html").exists()
    assert start_study(tmp_path / "killed", programs).wait() == 0
    assert (tmp_path / "killed" / "rows.csv").read_text() == (tmp_path / "whole" / "rows.csv").read_text()
    assert {file: file.stat().st_mtime_ns for file in finished} == finished
    # A solver that was about to start as its study was killed may run once more.
    assert len(calls(programs)) - n_calls - (n_points - len(finished)) in (0, 1)
