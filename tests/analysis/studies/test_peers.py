"""DOLFINx beside the reference."""

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.run_store import Outcome, RunRequest, Store
from analysis.runs import RunError, load_run
from analysis.studies import peers
from analysis.studies.peers import Pair

needs_peer = pytest.mark.skipif(not peers.has_peer(), reason="needs Debian's python3-dolfinx")


def test_a_peer_with_another_answer_has_no_ratio():
    same, other = (Pair(1, 30, 2.0, 6.0, "Cholesky", difference) for difference in (9e-6, 2e-5))
    _, rows = peers.table([same, other])
    assert [row[5] for row in rows] == ["3", "another answer"]
    assert "takes 3 to 3 times" in peers.finding([same, other])
    assert peers.finding([other]) == "DOLFINx gives other answers."


def test_our_seconds_are_those_from_tetrahedra_to_displacement(tmp_path, monkeypatch):
    """Set-up, assembly and solution of the fastest of three runs; DOLFINx' fastest is its second."""
    seconds = [{"mesh": 50.0, "setup": 1.0, "assemble": 2.0, "solve": 4.0 + more} for more in (2, 0, 1)]
    answers = iter([9.0, 5.0, 7.0])
    runs = iter(seconds)

    def run(_request):
        return Outcome("ok", "", 99, 99, 0, tmp_path, {"seconds": next(runs)})

    u = np.eye(3)
    monkeypatch.setattr(peers, "load_run", lambda folder: folder)
    monkeypatch.setattr(peers, "tetrahedra_of", lambda _: (None, None, u))
    monkeypatch.setattr(peers, "solve_by_dolfinx", lambda *_: (u, 9, "Cholesky", next(answers)))
    found = peers.measure(SimpleNamespace(run=run), tmp_path, 400, 2)
    assert (found.ours, found.theirs, found.difference) == (7.0, 5.0, 0.0)


def test_seconds_of_calculix_stand_beside_ours_without_meshing():
    row = {
        "name": "calculix/bar/25k/degree:2/iterations:1/manual_time",
        "dofs": 26766.0,
        "cpu": 3,
        "mesh_cpu": 1,
        "ccx_cpu": 5,
    }
    assert peers.table_of_calculix([row])[1] == [["2", "26766", "2", "5", "2.5"]]


def test_steps_of_bullet_stand_beside_ours():
    rates = {"explicit/soft": (8, 2), "implicit/soft": (9, 3), "implicit/stiff": (10, 0.5)}
    rows = [
        {"name": f"{who}/{body}/{kind}", "FPS": rate}
        for kind, pair in rates.items()
        for body in ("ball", "torus")
        for who, rate in zip(("ours", "bullet"), pair, strict=True)
    ]
    assert peers.table_of_bullet(rows)[1] == [["ball", "4", "3", "20"], ["torus", "4", "3", "20"]]


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    """Runs of a coarse bar by elements of either degree."""
    store = Store(tmp_path_factory.mktemp("bar"))
    return {
        degree: load_run(
            store.run(
                RunRequest(
                    "fem_reference", peers._SCENE, ("surface.n_vertices=60", f"reference.degree={degree}")
                )
            ).folder
        )
        for degree in (1, 2)
    }


@pytest.mark.parametrize("degree", [1, 2])
def test_tetrahedra_of_a_run_fill_the_bar(bar, degree):
    X, tetrahedra, u = peers.tetrahedra_of(bar[degree])
    a, b, c, d = (X[tetrahedra[:, k]] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(np.prod(X.max(axis=0) - X.min(axis=0)), rel=1e-9)
    assert u[X[:, 0] == X[:, 0].min()] == pytest.approx(0)


@needs_peer
@pytest.mark.parametrize("degree", [1, 2])
def test_dolfinx_finds_the_displacement_of_the_reference(bar, degree, tmp_path):
    u, n_unknowns, _, seconds = peers.solve_by_dolfinx(bar[degree], tmp_path)
    exact = peers.tetrahedra_of(bar[degree])[2]
    assert np.abs(u - exact).max() < 1e-6 * np.abs(exact).max()
    assert n_unknowns == 3 * bar[degree].record["n_nodes"]
    assert seconds > 0


@needs_peer
def test_what_dolfinx_cannot_solve_says_why(bar, tmp_path, monkeypatch):
    monkeypatch.setattr(
        peers, "scene_of", lambda run: {**SCENE, "material": {"E": 0.0, "nu": 0.25, "rho": 1.0}}
    )
    with pytest.raises(RunError, match="DOLFINx: "):
        peers.solve_by_dolfinx(bar[1], tmp_path)


SCENE = {"reference": {"degree": 1}, "gravity": [0, -9.81, 0]}
