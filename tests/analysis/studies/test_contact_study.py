"""Tables of contact, from runs whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import list_outputs, write_run

from analysis.methods import FEM_P1, FEM_P2, label_of
from analysis.run_store import Outcome
from analysis.studies import contact


class Known:
    """A store that knows the folder, or the curves, of every run."""

    def __init__(self, folder, answer):
        self.folder, self.answer, self.requests = folder, answer, []

    def run(self, request):
        self.requests.append(request)
        return Outcome("ok", "", 1, 1, 0, self.answer(dict(word.split("=", 1) for word in request.overrides)))


@pytest.fixture
def known(tmp_path, monkeypatch):
    """Makes a store whose runs are the curves that a function of their keys gives."""
    monkeypatch.setattr(
        contact, "load_run", lambda curves: SimpleNamespace(curves=curves, record={"n_nodes": 7})
    )
    return lambda answer: Known(tmp_path, answer)


def of_sphere(force, exponent, radius):
    """A quarter of the contact of a sphere of 1 m pressed by 0.9 mm into E = 1 MPa, nu = 0.3; off by factors."""
    load = np.array([0, 0.25, 0.5, 0.75, 1])
    depth = 9e-4 * load
    exact = 4 / 3 * 1e6 / 0.91 * 9e-4**1.5
    return {
        "load_factor": load,
        "obstacle_0_force_y": -force * exact * load**exponent / 4,
        "obstacle_0_area": np.pi * radius**2 * depth / 4,
    }


def test_sphere_is_measured_beside_hertz(known):
    store = known(lambda _: of_sphere(1.02, 1.5, 0.97))
    found, _ = contact.press_sphere(store, FEM_P2)
    assert found.depth == pytest.approx([4.5e-4, 6.75e-4, 9e-4])
    assert found.force == pytest.approx(1.02) and found.radius == pytest.approx(0.97)
    assert found.slope == pytest.approx(1.5)
    assert contact.press_sphere(known(lambda _: of_sphere(1, 1.6, 1)), FEM_P1)[0].slope == pytest.approx(1.6)
    head, rows = contact.sphere_table(store)
    assert {tuple(row[1:]) for row in rows} == {("7", "+2 %", "-3 %", "1.5")}
    assert len(rows) == len(contact.METHODS) and len(head) == 5


def test_largest_difference_of_either_sign_counts():
    assert contact._worst(np.array([1.01, 0.95, 1.04])) == "-5 %"


def test_plates_are_compared_where_both_have_come(ball, tmp_path):
    """Linear elements stop half-way, where they have moved and pushed by a tenth more."""
    X, F = ball
    store = Known(tmp_path, lambda keys: tmp_path / keys.get("reference.degree", "springs"))
    for name, last, factor in (("2", 1, 1), ("1", 0.5, 1.1), ("springs", 1, 0.9)):
        times = np.linspace(0, last, 5)
        status = {"status": "ok"} if last == 1 else {"status": "not_converged", "load_factor_reached": last}
        folder = write_run(
            tmp_path / name, X, F, lambda x, factor=factor: -0.1 * factor * x, times, is_free=False, **status
        )
        lines = (folder / "curves.csv").read_text().split()
        lines[0] += ",obstacle_0_force_y,obstacle_0_area"
        for n, t in enumerate(times, 1):
            lines[n] += f",{factor * 50 * t**2},{(2 - factor) * t}"
        (folder / "curves.csv").write_text("\n".join(lines) + "\n")
        list_outputs(folder)
    head, rows = contact.plates_table(store, [tmp_path / "pressed.toml"])
    assert all(len(row) == len(head) for row in rows)
    by_method = {row[1]: row[3:] for row in rows}
    assert by_method["finite elements, quadratic"] == ["100 %", "0", "0", "0", "0"]
    linear = by_method["finite elements, linear"]
    assert linear[:2] == ["50 %", "10 %"] and linear[3:] == ["+10 %", "-10 %"]
    assert by_method["springs, edge_coupled"][3:] == ["-10 %", "+10 %"]


def test_finding_tells_the_displacement_of_averaged_springs():
    head = ["scene", "method", "nodes", "load reached", "displacement", "volume", "force", "area in touch"]
    rows = [
        [name, label_of(method), "1", "2", f"{off} %", "9 %", "8 %", "7 %"]
        for name, method, off in (("a", FEM_P1, 4), ("a", "node_averaged", 1), ("b", "node_averaged", 2))
    ]
    assert contact.finding((head, rows)).endswith("are off quadratic elements by 1 % (a), 2 % (b).")


@pytest.mark.parametrize("nu", [0.25, 1 / 3])
def test_balloon_has_the_least_energy_at_its_stretch(nu):
    """Membrane and body strain alike in every direction; the tension works on the volume."""

    def energy(e):
        membrane = 4 * np.pi * 1e4 * e**2 / (1 - nu)
        body = 4 / 3 * np.pi * 1.5 * 100 / (1 - 2 * 0.25) * e**2
        return membrane + body - 30 * 4 * np.pi * e

    e = contact.stretch_of_balloon(nu)
    assert energy(e) < min(energy(0.99 * e), energy(1.01 * e))
    assert energy(0.99 * e) == pytest.approx(energy(1.01 * e), rel=1e-9)


def test_skins_are_measured_beside_the_balloon(known):
    def answer(keys):
        stretch = {"1": 1.01 * contact.stretch_of_balloon(0.25)}.get(
            keys.get("reference.degree"), 0.99 * contact.stretch_of_balloon(1 / 3)
        )
        return {"volume": 4 * np.array([1, (1 + stretch) ** 3])}

    store = known(answer)
    head, ((n, membrane, springs, of_a_third),) = contact.skin_table(store, [162])
    assert (n, membrane, of_a_third) == ("162", "+1 %", "-1 %")
    assert float(springs.strip(" %")) == pytest.approx(-11.9, abs=0.1)
    assert len(head) == 4 and {request.program for request in store.requests} == {
        "fem_reference",
        "massspring",
    }
