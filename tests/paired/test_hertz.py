"""A rigid sphere pressed into a half-space, whose force and contact radius are known [Hertz 1881]."""

import numpy as np
import pytest

from analysis.methods import FEM_P2
from analysis.run_store import Store
from analysis.studies.contact import press_sphere


def test_quadratic_elements_have_hertz_force_and_radius(tmp_path):
    found, _ = press_sphere(Store(tmp_path), FEM_P2)
    assert np.abs(found.force - 1).max() < 0.03
    assert np.abs(found.radius - 1).max() < 0.03
    assert found.slope == pytest.approx(1.5, abs=0.03)


@pytest.mark.parametrize("model,error", [("node_averaged", 0.03), ("edge_coupled", 0.09)])
def test_springs_come_near_hertz_force(model, error, tmp_path):
    found, _ = press_sphere(Store(tmp_path), model)
    assert np.abs(found.force - 1).max() < error
    assert found.slope == pytest.approx(1.5, abs=0.03)
