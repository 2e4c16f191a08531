"""What a Python session does: scenes made of keys, runs and sweeps of them, and the tables that come of it."""

import ast
import io
import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv
from IPython.core.formatters import DisplayFormatter
from matplotlib.figure import Figure
from PIL import Image
from solvers import ERRORS, calls, make_solvers
from synthetic import write_run

import analysis
from analysis import RunError, Scene
from analysis import experiment as experiments
from analysis.paths import PACKAGE, PROGRAMS, ROOT
from analysis.runs import load_run
from analysis.tables import nodes_of

FILLED_IN = (
    'name = "synthetic"\n[surface]\nshape = "ball"\n[network]\ncalibration = "affine"\n[comparison]\ncalibrations = []\n'
    '[time]\nmode = "static"\n[material]\nlaw = "small_strain"\n[reference]\nrefine = 0\n'
)
is_built = pytest.mark.skipif(not (PROGRAMS / "fem_reference").exists(), reason="the programs are not built")


@pytest.fixture
def home(ball, tmp_path, monkeypatch):
    """Folder of stand-ins for the solvers; sessions write below tmp_path."""
    programs = make_solvers(tmp_path / "home", ball)
    monkeypatch.setattr(experiments, "PROGRAMS", programs)
    monkeypatch.setattr("analysis.run_store.Store.__init__.__defaults__", (3600, programs), raising=False)
    monkeypatch.setattr("analysis.session.ROOT", tmp_path)
    (programs.parent / "fem_reference" / "scene.toml").write_text(FILLED_IN)
    return programs.parent


@pytest.fixture
def experiment(home):
    return analysis.run(Scene(surface={"shape": "ball"}), {"material.nu": 0.3})


NESTED = {
    "name": 'a "quoted" \\ name\twith é 🙂 \x7f',
    "gravity": [0, -9.81, 0.0],
    "surface": {"shape": "bar", "size": [0.4, 0.1, 0.1], "n_vertices": 900},
    "supports": [
        {
            "region": {"box": {"low": [0, 0, 0], "high": [0, 1, 1]}, "relative": True},
            "components": "xyz",
        },
        {"region": {"all": False}, "components": "x"},
    ],
    "loads": [],
    "a key": {"with space": 1e-300, "big": 10**15, "far": float("inf")},
    "empty": {},
}


def test_scene_is_toml_that_reads_back_as_what_it_was_made_of(tmp_path):
    scene = Scene(**NESTED)
    assert tomllib.loads(scene.to_toml()) == NESTED
    assert tomllib.loads(scene.write(tmp_path / "new" / "scene.toml").read_text()) == NESTED
    assert tomllib.loads(scene.to_toml())["supports"][0]["region"]["relative"] is True


def test_scene_takes_numpys_values_and_leaves_out_keys_without_one():
    scene = Scene(gravity=np.array([0, 0, -9.81]), time={"end": np.float64(2), "steps": None})
    assert tomllib.loads(scene.to_toml()) == {"gravity": [0, 0, -9.81], "time": {"end": 2.0}}


def test_files_of_a_scene_are_taken_from_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    read = tomllib.loads(
        Scene(surface={"file": "body.stl"}, obstacles=[{"file": Path("floor.obj")}]).to_toml()
    )
    assert read["surface"]["file"] == str(tmp_path / "body.stl")
    assert read["obstacles"][0]["file"] == str(tmp_path / "floor.obj")
    assert tomllib.loads(Scene(surface={"file": ""}).to_toml())["surface"]["file"] == ""


def test_value_that_toml_has_no_form_for_is_named_with_its_place():
    with pytest.raises(RunError, match=r"loads\[0\]\.pressure is a complex, expected a number"):
        Scene(loads=[{"pressure": 2j}]).to_toml()


def test_settings_of_a_run_reach_both_programs(home, experiment):
    words = [call for call in calls(home / "bin") if "'material.nu', '0.3'" in call]
    assert {call.split()[0] for call in words} == {"fem_reference", "massspring"}
    assert experiment.comparison.as_json()["displacement_error_l2"] == pytest.approx(ERRORS["0.3"])


def test_runs_of_other_settings_keep_folders_of_their_own(home):
    scene = Scene(surface={"shape": "ball"})
    low, high, again = (analysis.run(scene, {"material.nu": nu}) for nu in (0.25, 0.45, 0.25))
    assert low.folder == again.folder != high.folder
    errors = [run.to_dataframe().loc["affine", "displacement_error_l2"] for run in (low, high)]
    assert errors == pytest.approx([ERRORS["0.25"], ERRORS["0.45"]])


def test_table_has_a_row_for_every_model_and_the_reference_last(experiment):
    table = experiment.to_dataframe()
    assert list(table.index) == ["affine", "fem_reference"]
    assert table.loc["affine", "displacement_error_l2"] == pytest.approx(ERRORS["0.3"])
    assert np.isnan(table.loc["fem_reference", "displacement_error_l2"])
    assert table.loc["affine", "seconds"] == pytest.approx(1.0)  # 0.1 + 0.2 + 0.3 + 0.4
    assert list(table["status"]) == ["ok", "ok"]


def test_errors_of_the_nodes_have_the_displacement_error_as_their_mean(experiment):
    nodes = experiment.per_node()
    mean = np.sqrt(np.average(nodes["error"] ** 2, weights=nodes["area"]))
    figures = experiment.comparison.models["affine"]
    assert mean == pytest.approx(figures.displacement_error_l2)
    assert nodes["error"].max() == pytest.approx(figures.displacement_error_max)
    X = nodes[["x", "y", "z"]].to_numpy()
    assert nodes["area"].sum() == pytest.approx(4 * np.pi, rel=0.02)
    # Both are radial; the small rigid motion that is removed is rounding.
    assert nodes[["ux", "uy", "uz"]].to_numpy() == pytest.approx(0.012 * X, abs=1e-9)
    assert nodes[["ux_reference", "uy_reference", "uz_reference"]].to_numpy() == pytest.approx(
        0.01 * X, abs=1e-9
    )


def test_errors_of_the_nodes_are_over_a_mean_by_area(ball, tmp_path):
    body = ball[0] * [4, 1, 1], ball[1]  # whose vertices at its ends have the least areas
    runs = [
        load_run(write_run(tmp_path / str(size), *body, lambda X, size=size: size * X * [1, 0, 0]))
        for size in (0.12, 0.1)
    ]
    known = SimpleNamespace(
        experiment=SimpleNamespace(calibration="affine", is_free=False),
        runs={"affine": runs[0]},
        reference=runs[1],
    )
    nodes = nodes_of(known)
    assert np.average(nodes["error"] ** 2, weights=nodes["area"]) == pytest.approx(0.2**2)


def test_model_without_a_result_is_named_with_those_that_have_one(experiment):
    with pytest.raises(RunError, match=r"no result of 'uniform' \(found affine\)"):
        experiment.per_node("uniform")


def test_plots_are_a_figure_that_a_notebook_shows(experiment):
    figure = experiment.plot()
    assert isinstance(figure, Figure) and len(figure.subfigs) == 3
    labels = {axes.get_xlabel() for axes in figure.axes}
    assert {"load factor (1)", "displacement error (%)", "wall-clock time (s)"} <= labels
    shown, _ = DisplayFormatter().format(figure)
    picture = np.asarray(Image.open(io.BytesIO(shown["image/png"])).convert("RGB"))
    assert picture.shape[1] == 1000 and (picture < 128).any(axis=2).mean() > 0.01
    assert "Figure" in shown["text/plain"]


def test_where_no_method_gave_a_result_there_is_nothing_to_plot(home, tmp_path):
    failed = analysis.run(Scene(), {"material.nu": "diverge"}, folder=tmp_path / "out")
    assert len(failed.plot().subfigs) == 3  # of the reference
    alone = replace(failed, unsolved="contact")
    with pytest.raises(RunError, match="no method gave a result, so there is nothing to plot"):
        alone.plot()


def test_experiment_is_printed_as_its_finding_and_shown_in_a_line(experiment):
    finding, conclusion, *_ = str(experiment).splitlines()
    assert finding.startswith("synthetic, ball: the affine springs miss")
    assert conclusion.startswith(("Use", "No model"))
    assert repr(experiment) == f"Experiment(synthetic, ball, affine: {experiment.folder})"


def test_bodies_are_shown_side_by_side_and_the_models_error_is_painted(experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(pv, "OFF_SCREEN", True)
    experiment.show(screenshot=tmp_path / "bodies.png", window_size=(400, 200))
    pixels = (
        np.asarray(pv.read(tmp_path / "bodies.png").active_scalars)
        .reshape(200, 400, -1)[:, :, :3]
        .astype(int)
    )
    is_coloured = np.ptp(pixels, axis=2) > 60
    is_grey = (np.ptp(pixels, axis=2) < 10) & (pixels.max(axis=2) > 40) & (pixels.max(axis=2) < 230)
    assert is_coloured[:, 200:].sum() > 1000 > is_coloured[:, :200].sum()
    assert is_grey[:, :200].sum() > 1000


def test_sweep_is_a_dataframe_whose_keys_hold_the_values_asked_for(home):
    table = analysis.sweep(
        Scene(surface={"shape": "ball"}), {"material.nu": [0.25, 0.3, 0.6], "network.multiplicity": [3, 5]}
    )
    assert list(table["material.nu"]) == [0.25, 0.25, 0.3, 0.3, 0.6, 0.6]
    assert list(table["network.multiplicity"]) == [3, 5] * 3
    assert table["displacement_error_l2"][:4].to_list() == pytest.approx([0.1, 0.1, 0.2, 0.2])
    assert list(table["status"]) == ["ok"] * 4 + ["failed"] * 2
    assert "expected less than 0.5" in table["message"][5]
    with pytest.raises(RunError, match="at least one key"):
        analysis.sweep(Scene(), {"material.nu": []})


@is_built
def test_refused_scene_raises_the_words_of_the_program(tmp_path):
    scene = Scene(surface={"shape": "bar"}, material={"E": 1e6, "nu": 0.3, "rho": 1000})
    with pytest.raises(RunError, match=r"^--set material.nu=0.7: material.nu = 0.7, expected in \(-1, 0.5\)"):
        analysis.run(scene, {"material.nu": 0.7}, folder=tmp_path)


def test_reference_that_gives_no_result_raises_its_words(home, tmp_path):
    with pytest.raises(RunError, match=r"^scene.toml: material.nu = 0.6, expected less than 0.5$"):
        analysis.run(Scene(), {"material.nu": 0.6}, folder=tmp_path / "out")


def test_programs_that_are_not_built_are_one_error_that_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "PROGRAMS", tmp_path)
    monkeypatch.setattr("analysis.session.ROOT", tmp_path)
    with pytest.raises(RunError, match=r"massspring: not built; ./testbed run builds the programs"):
        analysis.run(Scene(surface={"shape": "ball"}))


def test_missing_scene_is_one_error():
    with pytest.raises(RunError, match=r"nowhere.toml: missing, expected the file of a scene"):
        analysis.run("nowhere.toml")


def test_package_asks_for_what_the_analysis_imports_and_nothing_that_testbed_does_not_install():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = set(project["dependencies"] + project["optional-dependencies"]["cluster"])
    of_debian = {"peer_dolfinx.py"}  # for another Python
    trees = [ast.parse(file.read_text()) for file in PACKAGE.rglob("*.py") if file.name not in of_debian]
    names = {
        name.split(".")[0]
        for tree in trees
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module]
            if isinstance(node, ast.ImportFrom) and not node.level
            else []
        )
    }
    names -= set(sys.stdlib_module_names) | {"analysis", "PIL"}  # pillow comes with matplotlib
    imported = {"vtk" if name == "vtkmodules" else name.replace("_", "-") for name in names}
    pinned = {
        name
        for file in ("requirements.txt", "requirements-cluster.txt")
        for name in re.findall(r"^([\w-]+)==", (PACKAGE / file).read_text(), re.MULTILINE)
    }
    assert imported <= asked <= pinned
