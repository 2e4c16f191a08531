"""A ball that is blown up stretches as its skin's closed form says, and skins that crumple are stepped soundly."""

import pytest

from analysis.methods import FEM_P1
from analysis.paths import SCENES
from analysis.run_store import RunRequest, Store
from analysis.runs import load_run
from analysis.studies.contact import NU, NU_OF_SPRINGS, inflate, stretch_of_balloon
from analysis.studies.published import overrides_of

TORUS = SCENES / "torus_implodes.toml"


def crumple(folder, *overrides):
    """A torus whose lower side crumples on the floor after half a second, as a run of 0.7 s."""
    words = ("surface.n_vertices=300", "time.end=0.7", *overrides)
    outcome = Store(folder).run(RunRequest("massspring", TORUS, words, ("--no-diagnostics",)))
    assert outcome.status == "ok"
    return load_run(outcome.folder)


@pytest.mark.parametrize("method, nu", [(FEM_P1, NU), ("edge_coupled", NU_OF_SPRINGS)])
def test_skin_stretches_as_a_membrane(method, nu, tmp_path):
    """Flat triangles enclose a little less than the ball: an error of second order in their size."""
    assert inflate(Store(tmp_path), method, 642) == pytest.approx(stretch_of_balloon(nu), rel=5e-3)


def test_newtons_method_takes_few_iterations_where_a_skin_crumples(tmp_path):
    """With the square of the angles' gradients in the Hessian's place it takes several times as many."""
    record = crumple(tmp_path, "time.integrator=minimising_euler").record
    assert record["newton_iterations"] < 15 * record["n_steps_done"]


def test_published_steps_gain_no_energy_where_a_skin_crumples(tmp_path):
    """With the angles' second derivatives in their matrix they do."""
    crumple(tmp_path, *overrides_of(TORUS, "implicit_euler", 1))
