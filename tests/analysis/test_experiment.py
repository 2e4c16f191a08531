"""The comparison of a whole experiment folder, and the report that it leaves."""

import html
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import fetched
from PIL import Image
from solvers import calls, make_solvers
from synthetic import write_run

from analysis import comparison_figures, results
from analysis import experiment as experiments
from analysis.__main__ import parse_arguments
from analysis.__main__ import run as run_command
from analysis.comparison import compare, errors_of_references
from analysis.drawing.pictures import magnification
from analysis.drawing.plots import plot_errors
from analysis.experiment import _command as command_of
from analysis.experiment import default_folder, run_solvers, surface_overrides
from analysis.experiment_folder import Experiment
from analysis.paths import SCENES
from analysis.references import refine
from analysis.report import text_of
from analysis.results import fingerprint, write_results
from analysis.run_store import Outcome, Store
from analysis.runs import RunError, StoppedEarlyError, load_run, record_of
from analysis.verdict import conclusion, finding

REFERENCE_SECONDS = {"mesh": 1, "setup": 1, "assemble": 1, "solve": 5, "output": 1}


def test_motions_that_supports_leave_free_are_those_of_the_runs(tmp_path):
    scene = {"supports": [{"components": "yz"}]}
    assert Experiment(tmp_path, {}, {}).is_free is True
    assert Experiment(tmp_path, scene, {}).is_free is False
    assert Experiment(tmp_path, {"handles": [{"vertex": 0}]}, {}).is_free is False
    motions = [[1.0, 0, 0, 0, 0, 0]]
    for name, record in (
        ("massspring/affine", {"status": "refused"}),
        ("fem_reference", {"is_free": True, "free_motions": motions}),
    ):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "run.json").write_text(json.dumps(record))
    assert Experiment(tmp_path, scene, {}).is_free == pytest.approx(np.array(motions))


@pytest.fixture
def experiment(ball, tmp_path):
    scene = {
        "name": "synthetic",
        "surface": {"file": "/somewhere/ball.obj", "shape": ""},
        "material": {"law": "small_strain"},
        "network": {"calibration": "affine"},
        "comparison": {"calibrations": ["node_averaged", "moment", "affine"]},
        "time": {"mode": "static"},
    }
    (tmp_path / "scene.toml").write_text('name = "synthetic"\n')
    write_run(tmp_path / "fem_reference", *ball, lambda X: -0.01 * X, seconds=REFERENCE_SECONDS)
    write_run(tmp_path / "massspring" / "affine", *ball, lambda X: -0.012 * X)
    write_run(
        tmp_path / "massspring" / "node_averaged", *ball, lambda X: [-0.02, -0.01, -0.01] * X, n_patches=5
    )
    return Experiment(tmp_path, scene, {"moment": "not_converged"})


def test_comparison_of_known_runs(experiment):
    comparison = write_results(experiment)
    written = json.loads((experiment.folder / "comparison.json").read_text())
    assert written == comparison
    assert written["status"] == "ok"
    assert written["displacement_error_l2"] == pytest.approx(0.2)
    assert written["displacement_error_max"] == pytest.approx(0.2)
    # Both cubed: (1 - 0.012 t)^3 - 1 against (1 - 0.01 t)^3 - 1, 0.2 to first order.
    assert written["volume_change_error"] == pytest.approx(0.2, rel=0.01)
    assert (written["n_springs"], written["n_patches"]) == (2, 0)
    sizes = {
        name: (model["n_springs"], model["n_patches"])
        for name, model in written["models"].items()
        if name != "moment"
    }
    assert sizes == {"affine": (2, 0), "node_averaged": (0, 5)}
    assert written["n_dofs_reference"] == 3 * written["n_nodes"]
    assert written["seconds"]["fem_reference"] == REFERENCE_SECONDS
    assert set(written["seconds"]["massspring"]) == {"mesh", "setup", "solve", "output"}
    # 0.01 x against 0.01 (x, y, z): x, y, z share the surface evenly.
    assert written["models"]["node_averaged"]["displacement_error_l2"] == pytest.approx(
        np.sqrt(1 / 3), rel=1e-6
    )
    assert written["models"]["moment"] == {"status": "not_converged"}
    assert list(written["models"]) == ["affine", "node_averaged", "moment"]


def test_report_stands_alone_and_opens_with_the_finding(experiment):
    comparison = write_results(experiment)
    page = (experiment.folder / "report.html").read_text()
    assert html.escape(finding(comparison)) in page
    assert html.escape(" ".join(conclusion(comparison))) in page
    assert not fetched(page)
    assert page.count("data:image/svg+xml") == 5
    assert page.count("data:image/png") == 3
    assert "not_converged" in page
    for part in (
        "libraries",
        "libdeal.ii-dev",
        "flags",
        "processor",
        "commit",
        "programs (SHA-256)",
        "threads",
    ):
        assert part in page


def test_limits_of_nodes_are_told_once_in_plain_words(experiment):
    fine = compare(experiment).as_json()
    assert fine["notes"] == [] and not fine["is_too_thin"]
    for folder, more in (
        ("fem_reference", {"is_cut_bounded": True, "n_surface": 5000}),
        ("massspring/affine", {"internal_nodes": {"bounded_by": 1926}}),
        ("massspring/node_averaged", {"is_cut_bounded": True, "n_surface": 5000}),
    ):
        record = experiment.folder / folder / "run.json"
        record.write_text(json.dumps(json.loads(record.read_text()) | more))
    bounded = compare(experiment).as_json()
    assert bounded["is_too_thin"] and bounded["notes"] == [
        "The surface is too thin in parts for surface.across: it was cut to 5000 vertices and no further.",
        "Networks of links have at most 1926 nodes inside, three for each of the surface: network.k asks for more.",
    ]


@pytest.mark.parametrize(
    "supports, at_supports, is_coarse", [([], 0, False), ([{}], 0, True), ([{}], 1, False)]
)
def test_only_held_bodies_that_are_coarse_at_supports_are_told_so(
    experiment, supports, at_supports, is_coarse
):
    scene = {**experiment.scene, "supports": supports}
    scene["surface"] = {**scene["surface"], "at_supports": at_supports, "across": 1}
    assert compare(replace(experiment, scene=scene)).as_json()["is_coarse_at_supports"] is is_coarse


@pytest.mark.parametrize("law, is_measured", [("small_strain", False), ("neo_hookean", True)])
def test_distance_of_surfaces_is_measured_at_large_strain_where_models_are_off(experiment, law, is_measured):
    record = experiment.folder / "fem_reference" / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"law": law}))
    affine = compare(experiment).as_json()["models"]["affine"]
    # Spheres that shrink by 0.012 and 0.01 of their radius: all of the difference is between the surfaces.
    expected = pytest.approx(0.2, rel=0.03) if is_measured else None
    assert affine["surface_distance"] == expected


def refined(experiment, ball, *sizes):
    """The experiment with references that shrink by so much, each refined once more than the one before: 0.01 unrefined."""
    for n, size in enumerate(sizes, 1):
        write_run(
            experiment.refined_folder(n), *ball, lambda X, size=size: -size * X, seconds=REFERENCE_SECONDS
        )
    return replace(experiment, n_refinements=len(sizes))


def test_differences_near_the_error_of_the_reference_are_named(experiment, ball):
    finer = refined(experiment, ball, 0.010249)
    comparison = write_results(finer)
    # The affine springs' 0.2 cannot be told from the bound of 0.2, so that the finer reference judges, and is off by half.
    assert "the reference's own error is some 2.4 %) and their volume" in finding(comparison)
    assert comparison["displacement_error_l2"] == pytest.approx(0.012 / 0.010249 - 1)
    # A published table keeps the elements that the scene has, and the error that these are off by.
    as_in_scene = compare(finer, is_as_in_scene=True).as_json()
    assert as_in_scene["displacement_error_l2"] == pytest.approx(0.2)
    assert as_in_scene["reference"]["n_refinements"] == 0
    assert as_in_scene["reference"]["estimated_error_l2"] == pytest.approx(2 * (1 - 0.01 / 0.010249))
    assert as_in_scene["reference"]["unrefined_error"] == pytest.approx(1 - 0.01 / 0.010249)
    page = (experiment.folder / "report.html").read_text()
    assert "more than a tenth of the difference from affine (14 % of it), which" in page
    assert "finite elements, unrefined" in page


@pytest.mark.parametrize(
    "size, words",
    [(0.010095, "less than a tenth of every difference"), (0.01, "is rounding"), (None, "is not estimated")],
)
def test_error_of_the_reference_is_stated(size, words, experiment, ball):
    write_run(experiment.folder / "massspring" / "moment", *ball, lambda X: -0.025 * X)
    experiment = replace(experiment, failed={"affine": "diverged"})
    write_results(refined(experiment, ball, *([size] if size else [])))
    assert words in (experiment.folder / "report.html").read_text()


def test_a_reference_is_refined_beyond_what_its_scene_asks_for(experiment):
    asked = []

    def solve(_, words, __):
        asked.append(words)
        return 1, "too large"

    scene = experiment.scene | {"reference": {"refine": 1}}
    assert refine(replace(experiment, scene=scene), solve, 1e9, is_quiet=True).unrefined == "too large"
    assert asked == [["reference.refine=2"]]


def test_a_refinement_that_was_stopped_early_is_kept_to_go_on(experiment):
    def solve(folder, _, __):
        folder.mkdir(parents=True)
        (folder / "run.json").write_text('{"status": "stopped_early", "reason": "its budget was spent"}')
        return 2, ""

    older = experiment.refined_folder(2)
    older.mkdir(parents=True)
    scene = experiment.scene | {"reference": {"refine": 0}}
    found = refine(replace(experiment, scene=scene), solve, 1e9, is_quiet=True)
    assert (found.n_refinements, found.unrefined) == (0, "stopped_early, its budget was spent")
    assert experiment.refined_folder(1).exists() and not older.exists()


def test_seconds_of_the_unrefined_reference_are_its_own(experiment, ball):
    finer = refined(experiment, ball, 0.010249)
    record = finer.refined_folder(1) / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"seconds": {"solve": 50}}))
    reference = compare(finer).as_json()["reference"]
    assert reference["n_refinements"] == 1 and reference["seconds"] == {"solve": 50}
    assert reference["unrefined_seconds"] == REFERENCE_SECONDS


def test_errors_of_references_are_those_of_a_limit(ball, tmp_path):
    """Changes fall by 2.5."""
    sizes, limit = [1.002, 1.001, 1.0006], 1.0006 - 0.0004 / 1.5
    folders = [
        write_run(tmp_path / str(n), *ball, lambda X, size=size: size * X) for n, size in enumerate(sizes)
    ]
    levels = [load_run(folder) for folder in folders]
    errors = errors_of_references(levels, is_free=False)
    assert errors == pytest.approx([size - limit for size in sizes], rel=5e-3)
    # Of a single change: as if errors halved with the edges.
    assert errors_of_references(levels[:2], is_free=False) == pytest.approx([0.002, 0.001], rel=5e-3)
    assert errors_of_references(levels[:1], is_free=False) == [None]


@pytest.fixture
def solve(ball, tmp_path, monkeypatch):
    """Runs an experiment with programs that stand in for the solvers."""
    programs = make_solvers(tmp_path / "home", ball)
    monkeypatch.setattr("analysis.experiment.PROGRAMS", programs)
    filled_in = (
        'name = "stand-in"\n[surface]\nshape = "ball"\n'
        '[network]\ncalibration = "affine"\n[comparison]\ncalibrations = []\n[time]\nmode = "static"\n'
        '[material]\nlaw = "small_strain"\n[reference]\nrefine = 0\n'
    )
    for folder in programs.parent.glob("fem_reference*"):
        (folder / "scene.toml").write_text(filled_in)
    (tmp_path / "scene.toml").write_text("")

    def run(nu, time_limit=60, **more):
        overrides = [f"material.nu={nu}"]
        return run_solvers(
            tmp_path / "scene.toml",
            tmp_path / "out",
            None,
            overrides,
            is_quiet=True,
            time_limit=time_limit,
            **more,
        )

    return run


def test_reference_that_did_not_converge_is_an_error_with_its_status(solve):
    with pytest.raises(RunError, match=r"did not converge: not_converged, see .*fem_reference"):
        solve("far")


@pytest.mark.parametrize("nu", ["0.3", "far", "late", "touched", "diverge", "stuck", "0.6"])
def test_runs_of_a_store_make_the_same_pair_and_are_made_once(nu, solve, tmp_path):
    """Of references and springs that end in every way."""
    programs = tmp_path / "home" / "bin"
    shutil.copytree(tmp_path / "home" / "massspring_0.25", tmp_path / "home" / "massspring_touched")

    def outcome(**more):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        try:
            found = solve(nu, **more)
        except RunError as error:
            return str(error)
        assert found.seconds > 0
        return replace(found, seconds=0)

    def stored():
        return outcome(store=Store(tmp_path / "runs", programs=programs))

    plain, n_plain = outcome(), len(calls(programs))
    assert stored() == plain
    assert len(calls(programs)) == 2 * n_plain
    assert stored() == plain
    assert len(calls(programs)) == 2 * n_plain


def test_a_pair_of_a_store_is_that_of_its_own_scene(solve, tmp_path):
    """Its reference's run does not depend on the name, but the pair is told by it."""
    made = Store(tmp_path / "runs", programs=tmp_path / "home" / "bin")
    keys = []
    for name in "ab":
        (tmp_path / "scene.toml").write_text(f'name = "{name}"\n')
        solve("0.3", store=made)
        keys.append({folder.name for folder in made.folder.glob("*/")})
    assert len(keys[1]) == 2 * len(keys[0])


def test_a_stored_run_whose_makers_have_died_is_told_and_leaves_no_folder(solve, tmp_path, monkeypatch):
    lost = Outcome("failed", "fem_reference: its worker died 3 times", 0, 0, 0)
    monkeypatch.setattr(Store, "run", lambda *_: lost)
    with pytest.raises(RunError, match="its worker died 3 times"):
        solve("0.3", store=Store(tmp_path / "runs", programs=tmp_path / "home" / "bin"))
    assert not (tmp_path / "out" / "fem_reference").exists()


def test_a_stored_refinement_that_is_stopped_for_its_time_says_what_it_would_take(home, tmp_path):
    record = home / "fem_reference" / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"seconds": {"solve": 0.02}}))
    program = home / "bin" / "fem_reference"
    slow = 'time.sleep(60 * ("reference.refine" in settings))\nsource = '
    program.write_text(program.read_text().replace("source = ", slow, 1))
    made = Store(tmp_path / "runs", programs=home / "bin")
    experiment = run_solvers(
        tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True, time_limit=0.2, store=made
    )
    assert experiment.n_refinements == 0 and experiment.next_reference_seconds == pytest.approx(1.2)
    assert experiment.seconds > 0.6, "that one counts"


def test_runs_share_a_budget(solve, tmp_path):
    solve("0.3", budget=100)
    budgets = [float(line.split()[-1]) for line in calls(tmp_path / "home" / "bin")]
    assert len(budgets) > 1
    assert 90 < budgets[-1] < budgets[0] <= 100, "what is left of it"


def test_reference_that_was_stopped_early_is_told_apart(solve):
    with pytest.raises(StoppedEarlyError, match=r"fem_reference: stopped_early, after 2 of 5 steps"):
        solve("late")


def test_reference_that_carried_a_part_of_the_load_is_compared_there(solve, tmp_path):
    record = tmp_path / "home" / "fem_reference_far" / "run.json"
    record.write_text('{"status": "not_converged", "load_factor_reached": 0.4, "seconds": {"solve": 1000}}')
    experiment = solve("far")
    assert experiment.unsolved == "" and experiment.n_refinements == 0
    assert experiment.next_reference_seconds == 10_000


def test_a_refined_reference_that_stops_on_its_way_has_a_frame_there(solve, ball, tmp_path):
    """Frames were left out of static refinements, whose end alone is needed where they reach it."""
    more = {"is_free": False, "status": "not_converged", "load_factor_reached": 0.5, "n_tetrahedra": 8}
    folder, times = tmp_path / "home" / "fem_reference_refine_1", np.linspace(0, 0.5, 3)
    write_run(folder, *ball, lambda X: 0.0101 * X, times, program="fem_reference", **more)
    experiment = solve("0.3")
    (refined_call,) = (line for line in calls(tmp_path / "home" / "bin") if "reference.refine" in line)
    assert "output.frames_every" not in refined_call
    assert experiment.n_refinements == 1 and compare(experiment).of_reference.estimated_error_l2 > 0


@pytest.mark.parametrize("mode, growth", [("static", 10), ("dynamic", 25)])
def test_a_refinement_is_foreseen_by_the_last_solve(mode, growth, solve, tmp_path):
    """Eight times the unknowns, and of motions half the step; a core that was missing half of the time is no work."""
    home = tmp_path / "home" / "fem_reference"
    scene = (home / "scene.toml").read_text()
    (home / "scene.toml").write_text(scene.replace("static", mode))
    seconds = {"start-up": 1, "mesh": 7, "setup": 10, "assemble": 20, "solve": 30, "output": 5}
    record = json.loads((home / "run.json").read_text())
    (home / "run.json").write_text(json.dumps(record | {"seconds": seconds, "cpu": 40, "wall": 80}))
    assert solve("0.3", time_limit=growth * 30 - 1).next_reference_seconds == pytest.approx(growth * 30)


def test_scene_that_springs_refuse_is_an_error_before_anything_is_solved(solve, tmp_path):
    with pytest.raises(RunError, match="massspring refuses the scene"):
        solve("0.1")
    assert not calls(tmp_path / "home" / "bin")


def test_reference_that_names_no_error_is_one_with_its_exit_status(solve, tmp_path):
    (tmp_path / "home" / "bin" / "fem_reference").write_text("#!/bin/sh\nexit 1\n")
    with pytest.raises(RunError, match=r"gave no result .exit status 1"):
        solve("0.6")


@pytest.mark.parametrize("nu, status", [("diverge", "diverged"), ("stuck", "not_converged, step 2 of 5")])
def test_springs_that_did_not_converge_are_listed_with_their_status(nu, status, solve):
    experiment = solve(nu)
    assert (experiment.failed, experiment.unsolved) == ({"affine": status}, "")


def test_models_are_those_that_the_check_names_whatever_the_scene_does(solve, tmp_path):
    """The paper's method has one of its own."""
    for file in (tmp_path / "home").glob("fem_reference*/scene.toml"):
        file.write_text(
            file.read_text()
            .replace('calibration = "affine"', 'calibration = "moment"')
            .replace("[]", '["lloyd"]')
        )
    experiment = solve("0.3")
    assert experiment.calibrations == ["affine"]
    assert not experiment.failed


def test_what_the_reference_does_not_model_is_no_error(solve):
    assert solve("touched").unsolved == "reference.inertia_relief: for static scenes at small strain"


@pytest.mark.parametrize("time_limit, has_half_step", [(60, True), (0.9, False)])
def test_springs_without_a_reference_are_run_at_half_their_step_too(
    time_limit, has_half_step, solve, ball, tmp_path
):
    """Of a unit ball that shrinks to half its size; its set-up and solution take 0.5 s."""
    home = tmp_path / "home"
    scene = home / "fem_reference_touched" / "scene.toml"
    scene.write_text(scene.read_text().replace("static", "dynamic"))
    write_run(home / "massspring_touched", *ball, lambda X: -0.5 * X, step=0.1, calibration="affine")
    experiment = solve("touched", time_limit)
    assert experiment.has_half_step == has_half_step
    *_, last = calls(home / "bin")
    assert (last.startswith("massspring") and "('time.step', '0.05')" in last) == has_half_step
    half = compare(experiment).as_json()["half_step_volume_change"]
    assert half == (pytest.approx(-7 / 8) if has_half_step else None)
    assert ("half of it takes some 1 s (--time-limit 1)." in " ".join(experiment.notes)) != has_half_step


def test_refinement_that_gives_no_result_leaves_none_of_an_older_run(solve, tmp_path):
    solve("0.3")
    older = tmp_path / "out" / "reference_refined" / "1"
    assert (older / "run.json").exists()
    program = tmp_path / "home" / "bin" / "fem_reference"
    program.write_text(
        program.read_text().replace(
            "source = ", 'if "reference.refine" in settings:\n    sys.exit(1)\nsource = ', 1
        )
    )
    experiment = solve("0.3")
    assert not older.exists()
    assert (experiment.n_refinements, experiment.unrefined) == (0, "exit status 1")


def test_errors_have_a_band_for_the_reference():
    with_band, without = (plot_errors({"affine": (0.2, 0.3)}, own).svg() for own in (0.01, None))
    assert "#808080" in with_band and "#808080" not in without
    assert "displacement error (%)" in without


def test_every_method_has_a_picture_and_its_figure_in_the_report(experiment):
    write_results(experiment)
    for name in ("fem_reference", "affine", "node_averaged"):
        pixels = np.asarray(Image.open(experiment.folder / f"body_{name}.png").convert("RGB"), dtype=int)
        assert 0.3 < (pixels < 250).any(axis=2).mean() < 0.9
        is_coloured = (np.ptp(pixels, axis=2) > 40).mean() > 0.1
        assert is_coloured == (name != "fem_reference")
    report = (experiment.folder / "report.html").read_text()
    panels = re.findall("<figcaption><b>(.*?)</b><br>(.*?)</figcaption>", report)
    assert panels[:2] == [("finite elements", "the reference"), ("springs, affine", "error 20 %")]
    assert [name for name, _ in panels[2:]] == ["springs, node_averaged"]
    assert Image.open(experiment.folder / "thumbnail.jpg").width > 300


def test_failed_model_of_the_scene_is_the_status(experiment):
    failed = Experiment(
        experiment.folder, experiment.scene, {"affine": "diverged", "moment": "not_converged"}
    )
    comparison = write_results(failed)
    assert comparison["status"] == "diverged"
    assert comparison["displacement_error_l2"] is None
    assert "gave no result: diverged" in finding(comparison)
    assert "diverged" in text_of(comparison)


def test_scene_without_a_fair_reference_shows_the_springs_alone(ball, tmp_path):
    scene = {
        "name": "falls",
        "surface": {"file": "", "shape": "ball"},
        "material": {"law": "neo_hookean"},
        "network": {"calibration": "uniform"},
        "comparison": {"calibrations": ["affine"]},
        "time": {"mode": "dynamic"},
        "playback": {"warp": "elastic", "reversed": True, "seconds": 0.5, "fps": 8},
    }
    (tmp_path / "scene.toml").write_text('name = "falls"\n')
    folder = write_run(tmp_path / "massspring" / "uniform", *ball, lambda X: -0.5 * X, calibration="uniform")
    comparison = write_results(Experiment(tmp_path, scene, {"affine": "diverged"}, "obstacles: no contact"))
    assert comparison["no_reference"] == "obstacles: no contact"
    assert comparison["status"] == "ok"
    assert comparison["models"]["uniform"]["volume_change"] == pytest.approx(-7 / 8)
    assert comparison["models"]["uniform"]["kinetic_energy_left"] == pytest.approx(0.25)
    assert "no fair reference (obstacles: no contact)" in finding(comparison)
    assert "87.5 % below" in finding(comparison)
    assert "-87.5 %" in text_of(comparison) and "diverged" in text_of(comparison)
    page = (tmp_path / "report.html").read_text()
    assert "no fair reference" in page and page.count("data:image/gif") == 2
    assert (tmp_path / "playback" / "frames.pvd").exists()
    assert folder.exists()


def test_fingerprint_follows_the_runs(experiment):
    springs = experiment.massspring_folder(experiment.calibration)
    prints = {fingerprint(experiment)}
    for n, folder in enumerate((experiment.reference_folder, springs), 1):
        assert fingerprint(experiment) in prints and len(prints) == n
        record = folder / "run.json"
        record.write_text(record.read_text().replace("ok", "diverged"))
        prints.add(fingerprint(experiment))
    assert len(prints) == 3


def test_fingerprint_follows_the_code_of_every_room(experiment, tmp_path, monkeypatch):
    room = tmp_path / "package" / "drawing"
    room.mkdir(parents=True)
    monkeypatch.setattr(results, "PACKAGE", room.parent)
    prints = set()
    for name, text in (("top.py", "1"), ("drawing/plots.py", "1"), ("drawing/plots.py", "2")):
        (room.parent / name).write_text(text)
        prints.add(fingerprint(experiment))
    assert len(prints) == 3


def test_fingerprint_follows_what_failed(experiment):
    """A model that failed leaves no record, so that the reason stands for it."""
    others = [{}, {"moment": "diverged"}, {"lloyd": "not_converged"}]
    prints = {fingerprint(replace(experiment, failed=failed)) for failed in others}
    assert len(prints | {fingerprint(experiment)}) == 4


FILLED_IN = """name = "paired"
surface = { file = "", shape = "ball" }
network = { calibration = "affine" }
comparison = { calibrations = [] }
time = { mode = "static" }
material = { law = "small_strain" }
reference = { refine = 0 }
"""


@pytest.fixture
def home(ball, tmp_path, monkeypatch):
    """Folder of the runs that stand-ins for the solvers leave; the reference's has the scene filled in."""
    monkeypatch.setattr(experiments, "PROGRAMS", make_solvers(tmp_path / "home", ball))
    (tmp_path / "home" / "fem_reference" / "scene.toml").write_text(FILLED_IN)
    (tmp_path / "scene.toml").write_text("")
    return tmp_path / "home"


def test_exit_status_tells_whether_the_scenes_own_model_gave_a_result(home, tmp_path, capsys):
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    arguments = parse_arguments(words)
    assert run_command(arguments) == 0
    written = (tmp_path / "out" / "comparison.json").stat().st_mtime_ns
    assert run_command(arguments) == 0
    assert (tmp_path / "out" / "comparison.json").stat().st_mtime_ns == written  # nothing has changed
    (home / "massspring_0.25" / "run.json").write_text('{"status": "diverged", "reason": "at 2 s"}')
    assert run_command(arguments) == 2
    assert "gave no result: diverged, at 2 s" in capsys.readouterr().out


def test_damaged_report_is_mended_by_the_same_command(home, tmp_path):
    arguments = parse_arguments(
        ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    )
    run_command(arguments)
    report, comparison, view = (tmp_path / "out" / n for n in ("report.html", "comparison.json", "view.html"))
    size, finding = report.stat().st_size, json.loads(comparison.read_text())["finding"]
    damages: dict[str, Callable[[], object]] = {
        "no report": report.unlink,
        "half a report": lambda: report.write_text("<html>"),
        "no view": view.unlink,
        "nothing compared": lambda: comparison.write_text(""),
        "another comparison": lambda: comparison.write_text("[]"),
        "half a comparison": lambda: os.truncate(comparison, 100),
    }
    for name, damage in damages.items():
        damage()
        assert run_command(arguments) == 0, name
        assert json.loads(comparison.read_text())["finding"] == finding, name
        assert view.exists(), name
        assert report.stat().st_size == pytest.approx(size, rel=0.01), name


def test_force_forgets_what_the_folder_holds(home, tmp_path):
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    run_command(parse_arguments(words))
    (tmp_path / "out" / "massspring" / "other").mkdir()
    (tmp_path / "out" / "massspring" / "other" / "run.json").write_text("{}")
    (tmp_path / "out" / "mine.json").write_text("{}")
    written = (tmp_path / "out" / "comparison.json").stat().st_mtime_ns
    run_command(parse_arguments([*words, "--force"]))
    assert not (tmp_path / "out" / "massspring" / "other" / "run.json").exists()
    assert (tmp_path / "out" / "mine.json").exists()
    assert (tmp_path / "out" / "comparison.json").stat().st_mtime_ns > written


def test_failing_run_leaves_no_report_of_other_values(home, tmp_path):
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    run_command(parse_arguments(words))
    with pytest.raises(RunError):
        run_command(
            parse_arguments([*words, "--set", "material.nu=0.1"])
        )  # refused before anything is solved
    assert (tmp_path / "out" / "report.html").exists()
    with pytest.raises(RunError):
        run_command(parse_arguments([*words, "--set", "material.nu=0.6"]))
    assert not (tmp_path / "out" / "report.html").exists()
    assert not (tmp_path / "out" / "comparison.json").exists()


def test_time_warp_that_is_none_is_refused_before_anything_is_solved(home, tmp_path):
    (tmp_path / "scene.toml").write_text('playback = { warp = "custom", expression = "1 - t" }\n')
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    for more in ([], ["--set", "playback.expression=t*(9**9**9**9)"]):
        with pytest.raises(RunError, match=r"playback\."):
            run_command(parse_arguments([*words, *more]))
    assert not calls(home / "bin")


@pytest.mark.parametrize("name", ['"../../x"', '"/tmp/x"', '".."', '""', "5", '"a\\u0000"'])
def test_name_of_a_scene_stays_within_the_folder_of_runs(name, tmp_path):
    (tmp_path / "scene.toml").write_text(f"name = {name}\n")
    with pytest.raises(RunError, match="expected the name of a folder"):
        default_folder(tmp_path / "scene.toml", None)


@pytest.mark.filterwarnings("error")
def test_a_pair_in_which_every_model_diverges_has_a_report_and_a_status_of_its_own(home, tmp_path):
    for program, status in (("fem_reference", "not_solved"), ("massspring_0.25", "diverged")):
        (home / program / "run.json").write_text(json.dumps({"status": status, "reason": "contact"}))
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    assert run_command(parse_arguments(words)) == 2
    assert "gave no result: diverged" in (tmp_path / "out" / "report.html").read_text()


def test_what_the_check_warns_of_stands_in_the_report(home, tmp_path, capfd):
    program = home / "bin" / "massspring"
    program.write_text(
        program.read_text().replace(
            'if "--check" in sys.argv:\n',
            'if "--check" in sys.argv:\n    print("warning: nothing moves", file=sys.stderr)\n',
        )
    )
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    assert run_command(parse_arguments(words)) == 0
    printed = capfd.readouterr()
    assert "warning: nothing moves" in printed.err and "nothing moves." in printed.out
    assert "nothing moves." in (tmp_path / "out" / "report.html").read_text()


def test_command_names_a_shipped_scene_from_where_the_script_lies():
    of_bar = command_of(SCENES / "bar_sag.toml", Path("a b.stl"), ["material.nu=0.3"])
    assert of_bar == "./testbed run analysis/scenes/bar_sag.toml --surface 'a b.stl' --set material.nu=0.3"
    assert command_of(Path("mine.toml"), None, []) == "./testbed run mine.toml"


def test_unit_and_upward_axis_are_keys_of_the_scene():
    arguments = parse_arguments(["run", "--up", "z", "--units", "mm"])
    assert surface_overrides(arguments) == ['surface.up="z"', 'surface.unit="mm"']
    assert surface_overrides(parse_arguments(["sweep", "--units", "in"])) == ['surface.unit="in"']


def test_a_wanted_strain_is_reached_by_one_factor_that_all_runs_get(home, tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.load_scale.strain_of", lambda folder: 0.002)
    (tmp_path / "scene.toml").write_text("[load_scale]\nstrain = 1e-3\n")
    run_solvers(tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True)
    trial, *others = calls(home / "bin")
    assert "('load_scale.factor', '1.0')" in trial and "edge_coupled" in trial
    assert len(others) == 3 and all("('load_scale.factor', '0.5')" in call for call in others)


def test_a_trial_that_strains_too_much_is_made_again_with_less_load(home, tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.load_scale.strain_of", lambda folder: 2e-6)
    (tmp_path / "scene.toml").write_text("[load_scale]\nstrain = 1e-3\n")
    record = home / "massspring_0.25" / "run.json"
    sound = record.read_text()
    record.write_text(json.dumps(json.loads(sound) | {"status": "strain_too_large"}))

    def mend(folder):
        record.write_text(sound)
        return record_of(folder)

    monkeypatch.setattr("analysis.experiment.record_of", mend)
    run_solvers(tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True)
    first, second, *others = calls(home / "bin")
    assert "('load_scale.factor', '1.0')" in first and "('load_scale.factor', '0.001')" in second
    assert len(others) == 3 and all("('load_scale.factor', '0.5')" in call for call in others)


def test_refinement_of_an_earlier_run_does_not_outlive_it(home, tmp_path):
    def run():
        run_solvers(tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True)
        return [call.split()[0] for call in calls(home / "bin")]

    assert run() == ["fem_reference", "massspring", "fem_reference"]
    refined = tmp_path / "out" / "reference_refined" / "1"
    assert refined.exists()
    record = home / "fem_reference" / "run.json"
    slow = {"seconds": {"solve": 6.1}}  # ten times that is over the limit
    record.write_text(json.dumps(json.loads(record.read_text()) | slow))
    assert run()[3:] == ["fem_reference", "massspring"]
    assert not refined.exists()
    # But not where it waited for a core in a tenth of that.
    record.write_text(json.dumps(json.loads(record.read_text()) | {"cpu": 9, "wall": 10}))
    assert run()[5:] == ["fem_reference", "massspring", "fem_reference"]


def test_refinement_that_is_stopped_for_its_time_says_what_it_would_take(home, tmp_path):
    record = home / "fem_reference" / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"seconds": {"solve": 0.02}}))
    program = home / "bin" / "fem_reference"
    program.write_text(
        program.read_text().replace(
            "source = ", 'time.sleep(60 * ("reference.refine" in settings))\nsource = ', 1
        )
    )
    experiment = run_solvers(
        tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True, time_limit=0.2
    )
    assert (experiment.n_refinements, experiment.unrefined) == (0, "")
    assert experiment.next_reference_seconds == pytest.approx(1.2)  # twice what it was given


@pytest.mark.parametrize("is_once, n", [(False, 2), (True, 1)])
def test_reference_is_refined_until_it_decides_or_once(is_once, n, home, ball, tmp_path):
    for level, size in (("1", 0.0107), ("2", 0.01071)):
        folder = home / f"fem_reference_refine_{level}"
        write_run(folder, *ball, lambda X, size=size: size * X, np.linspace(0, 1, 2), program="fem_reference")
    experiment = run_solvers(
        tmp_path / "scene.toml", tmp_path / "out", None, [], is_quiet=True, is_refined_once=is_once
    )
    assert experiment.n_refinements == n
    assert sum(call.startswith("fem_reference") for call in calls(home / "bin")) == 1 + n


def test_first_plot_of_a_scene_that_keeps_its_volume_is_that_of_its_tip(ball, experiment):
    (experiment.reference_folder).rename(experiment.folder / "old")
    write_run(experiment.reference_folder, *ball, lambda X: [1e-4, -1e-4, 0] * X, seconds=REFERENCE_SECONDS)
    comparison = write_results(experiment)
    assert np.isnan(comparison["volume_change_error"]) and "volume" not in finding(comparison)
    written = json.loads((experiment.folder / "comparison.json").read_text())
    assert written["volume_change_error"] is None and written["reference"]["keeps_volume"]
    captions = re.findall("<figcaption>(.*?)</figcaption>", (experiment.folder / "report.html").read_text())
    plots = captions[captions.index("How the error is spread over the surface.") + 1 :]
    assert plots[0].startswith("Displacement of the tip")
    assert not [caption for caption in captions if "olume" in caption]


def test_what_springs_reached_before_they_stopped_is_compared_there(ball, experiment):
    folder = experiment.massspring_folder("moment")
    write_run(
        folder, *ball, lambda X: -0.02 * X, np.linspace(0, 0.75, 4), status="not_converged", reason="why"
    )
    stopped = replace(experiment, failed={"moment": "not_converged, why"})
    model = write_results(stopped)["models"]["moment"]
    assert (model["status"], model["reached"]) == ("not_converged, why", 0.5)
    assert model["displacement_error_l2"] == pytest.approx(1)
    page = (experiment.folder / "report.html").read_text()
    assert "springs, moment, up to 0.5 of the load" in page and "error 100 % at load factor 0.5<" in page
    # What an earlier run left is not what this one reached.
    assert write_results(experiment)["models"]["moment"] == {"status": "not_converged"}


def test_the_reference_is_drawn_at_its_end_although_a_model_stopped_before(ball, experiment, monkeypatch):
    X, F = ball
    times = np.linspace(0, 0.75, 4)
    folder = experiment.massspring_folder("moment")
    write_run(folder, X, F, lambda P: -0.02 * P, times, status="not_converged", reason="why")
    monkeypatch.setattr(comparison_figures, "row_of", lambda *given: given[-1])
    shown = comparison_figures.draw_row(compare(replace(experiment, failed={"moment": "not_converged, why"})))
    assert list(shown)[-1] == "moment", "it comes last"
    for name, part in (("fem_reference", 0.01), ("moment", 0.02 * 0.5)):
        np.testing.assert_allclose(shown[name].body.u, -part * X, atol=1e-6)
    np.testing.assert_allclose(shown["moment"].body.error, 100, rtol=1e-4)


def test_reference_that_stopped_is_compared_there_and_is_the_status(ball, experiment):
    experiment.reference_folder.rename(experiment.folder / "old")
    write_run(
        experiment.reference_folder, *ball, lambda X: -0.01 * X, np.linspace(0, 0.5, 3),
        status="not_converged", load_factor_reached=0.5, seconds=REFERENCE_SECONDS,
    )  # fmt: skip
    comparison = write_results(experiment)
    assert comparison["status"] == "fem_reference: not_converged"
    assert comparison["models"]["affine"]["displacement_error_l2"] == pytest.approx(0.2)
    assert "the finite elements stopped at load factor 0.5 (not_converged); there" in finding(comparison)


def test_small_displacements_are_enlarged_and_large_ones_are_not(ball):
    X, _ = ball
    assert magnification(X, 2 * X) == 1
    assert magnification(X, 1e-3 * X) == 200  # 0.08 of the diagonal 3.46 over 1e-3, rounded down


def test_default_folder_carries_the_names(tmp_path):
    scene = tmp_path / "bend.toml"
    scene.write_text("gravity = [0, 0, 1]")
    assert default_folder(scene, None).name == "bend"
    assert default_folder(scene, tmp_path / "bunny.obj").name == "bend-bunny"
    scene.write_text('name = "twist"')
    assert default_folder(scene, None).name == "twist"
