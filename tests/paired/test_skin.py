"""A ball that is blown up stretches as its skin's closed form says."""

import pytest

from analysis.methods import FEM_P1
from analysis.run_store import Store
from analysis.studies.contact import NU, NU_OF_SPRINGS, inflate, stretch_of_balloon


@pytest.mark.parametrize("method, nu", [(FEM_P1, NU), ("edge_coupled", NU_OF_SPRINGS)])
def test_skin_stretches_as_a_membrane(method, nu, tmp_path):
    """Flat triangles enclose a little less than the ball: an error of second order in their size."""
    assert inflate(Store(tmp_path), method, 642) == pytest.approx(stretch_of_balloon(nu), rel=5e-3)
