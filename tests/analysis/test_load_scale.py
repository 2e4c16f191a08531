"""The factor on the loads for a wanted strain: of bodies whose strain is known."""

import numpy as np
import pytest

from analysis import load_scale
from analysis.run_store import Outcome, RunRequest, Store
from analysis.runs import RunError

X = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
T = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])


def test_strain_is_the_largest_principal_one_whatever_the_axes():
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    gradient = turned @ np.diag([0.01, -0.03, 0.02]) @ turned.T
    assert load_scale.strain_in(X, T, X @ gradient.T) == pytest.approx(0.03)
    spin = np.array([[0, 0.5, 0], [-0.5, 0, 0], [0, 0, 0]])
    assert load_scale.strain_in(X, T, X @ spin.T) == pytest.approx(0, abs=1e-12)


def test_a_hundredth_of_the_volume_may_strain_more():
    """A chain of equal tetrahedra, of which some strain by a half."""
    for n_wild, strain in ((1, 0.001), (3, 0.5)):
        points = np.concatenate([X[:4] + np.array([2.0 * k, 0, 0]) for k in range(200)])
        tets = np.arange(800).reshape(200, 4)
        u = 0.001 * (points - np.repeat(points[::4], 4, axis=0))
        u[: 4 * n_wild] *= 500
        assert load_scale.strain_in(points, tets, u) == pytest.approx(strain)


@pytest.mark.parametrize(
    "scene, overrides, wanted",
    [
        ({}, [], None),
        ({"load_scale": {"strain": 1e-3}}, [], 1e-3),
        ({"load_scale": {"strain": 1e-3}}, ["load_scale.strain=0.01", "material.nu=0.3"], 0.01),
        ({"load_scale": {"strain": 1e-3, "factor": 2.0}}, [], None),
        ({"load_scale": {"strain": 1e-3}}, ["load_scale.factor=2"], None),
    ],
)
def test_a_factor_is_found_where_a_strain_is_wanted_and_none_given(scene, overrides, wanted):
    assert load_scale.wanted_strain(scene, overrides) == wanted


def trial_of(status_at, tmp_path, tried):
    """A trial of a linear body that ends as status_at(load) says."""

    def trial(words):
        load = float(dict(word.split("=", 1) for word in words)["load_scale.factor"])
        tried.append(load)
        return status_at(load), tmp_path

    return trial


def test_factor_is_the_wanted_strain_over_that_of_the_trial(monkeypatch, tmp_path):
    trial = trial_of(lambda load: "ok", tmp_path, [])
    monkeypatch.setattr(load_scale, "strain_of", lambda folder: 0.04)
    assert load_scale.factor_override(1e-3, trial) == "load_scale.factor=0.025"
    monkeypatch.setattr(load_scale, "strain_of", lambda folder: 0.0)
    with pytest.raises(RunError, match="the loads strain nothing"):
        load_scale.factor_override(1e-3, trial)


def test_a_load_that_strains_too_much_is_lessened_and_the_factor_stays_that_of_the_whole(
    monkeypatch, tmp_path
):
    tried: list[float] = []
    trial = trial_of(lambda load: "ok" if load < 1e-5 else "strain_too_large", tmp_path, tried)
    monkeypatch.setattr(load_scale, "strain_of", lambda folder: 4e4 * tried[-1])
    assert load_scale.factor_override(1e-3, trial) == "load_scale.factor=2.5e-08"
    assert tried == pytest.approx([1, 1e-3, 1e-6])


def test_a_trial_that_ends_otherwise_gives_no_factor(tmp_path):
    tried: list[float] = []
    assert load_scale.factor_override(1e-3, trial_of(lambda load: "not_converged", tmp_path, tried)) is None
    assert tried == [1]


def test_both_programs_of_a_sweep_get_the_same_factor(monkeypatch, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text("[load_scale]\nstrain = 1e-3\n")
    for name in ("massspring", "fem_reference", "gmsh_worker", "tetgen_worker"):
        (tmp_path / name).write_text("")
    store, seen = Store(tmp_path / "runs", programs=tmp_path), []

    def execute(request, folder):
        seen.append(request)
        (folder / "run.json").write_text("{}")
        return Outcome("ok", "", 0, 0, 0)

    monkeypatch.setattr(store, "_execute", execute)
    monkeypatch.setattr(load_scale, "strain_of", lambda folder: 0.004)
    for program in ("massspring", "fem_reference"):
        assert store.run(RunRequest(program, scene, ("material.nu=0.3",))).status == "ok"
    trial, *pair = seen  # one trial serves both
    assert set(load_scale.TRIAL) < set(trial.overrides) and trial.program == "massspring"
    assert [request.overrides for request in pair] == [("material.nu=0.3", "load_scale.factor=0.25")] * 2
