"""The supports study: regions and strains of a box whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv

from analysis.runs import Frame
from analysis.studies import supports
from analysis.studies.supports import REGIONS, error_of_strain, regions


@pytest.fixture
def box():
    surface = pv.Box(level=9).triangulate().clean()
    return np.asarray(surface.points, dtype=float), surface.regular_faces


def test_a_box_is_split_into_its_support_its_sharp_edges_and_the_rest(box):
    X, F = box
    of, middle = regions(X, F, X[:, 0] < -0.5), X[F].mean(axis=1)
    border = np.abs(middle[:, 0] + 0.5) < 0.15
    assert (of[border] == REGIONS.index("edges of supports")).all()
    assert not (of[np.abs(middle[:, 0] + 0.5) > 0.6] == 0).any()
    n_near = (np.abs(middle) > 0.85).sum(axis=1)  # faces that a triangle lies on or near
    away = np.abs(middle[:, 0] + 0.5) > 0.6
    assert (of[away & (n_near > 1)] == REGIONS.index("sharp edges")).all()
    assert (of[away & (np.sort(np.abs(middle), axis=1)[:, 1] < 0.75)] == REGIONS.index("elsewhere")).all()


def test_an_error_of_strain_is_that_of_stretch_and_of_no_rotation(box):
    X, F = box
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    assert error_of_strain(X, F, X @ turn.T).max() < 1e-28
    even = error_of_strain(X, F, 1e-3 * X)  # three edges of each triangle
    assert even.sum() == pytest.approx(3e-6 * 24)


def test_an_error_near_a_support_is_found_there(box, monkeypatch):
    X, F = box
    sphere = {"center": [-1, 0, 0], "radius": 0.5}
    monkeypatch.setattr(supports, "scene_of", lambda _: {"supports": [{"region": {"sphere": sphere}}]})
    monkeypatch.setattr(supports, "on_points_of", lambda run, _: run)
    near = np.linalg.norm(X - sphere["center"], axis=1) < sphere["radius"]
    exact, run = (SimpleNamespace(last=Frame(X, u, F)) for u in (0 * X, 1e-3 * X * near[:, None]))
    area, error = supports.shares(run, exact)
    assert area.sum() == pytest.approx(1) and area[0] < 0.3
    assert error[0] > 0.9 and error[1] == 0
