"""The comparison of material laws that the choice in massspring/tet_springs rests on."""

import numpy as np
import pytest

from analysis.studies.material_laws import (
    LAWS,
    crush_softens_at,
    inflation_gives_way_at,
    mirror_energy,
    pressure_softens_at,
    table,
)

CHOSEN = "Ciarlet-Geymonat (chosen)"


@pytest.mark.parametrize("name", LAWS)
def test_every_law_is_linear_elasticity_at_small_strain(name: str) -> None:
    lam, strain = 3.0, 1e-4 * np.array([1.0, -0.4, 0.7])
    linear = np.sum(strain**2) + lam / 2 * np.sum(strain) ** 2
    assert LAWS[name](1 + strain, lam) == pytest.approx(linear, rel=1e-3)  # third order in a strain of 1e-4


@pytest.mark.parametrize("lam", [1.0, 9.0, 49.0])
def test_chosen_law_never_softens_and_resists_turning_inside_out(lam: float) -> None:
    law = LAWS[CHOSEN]
    assert pressure_softens_at(law, lam) is None
    assert crush_softens_at(law, lam) is None
    assert inflation_gives_way_at(law, lam) is None
    assert mirror_energy(law, lam) > 1


def test_saint_venant_kirchhoff_collapses_where_theory_says() -> None:
    assert crush_softens_at(LAWS["St. Venant-Kirchhoff"], 1.0) == pytest.approx(1 / np.sqrt(3), abs=0.01)
    assert mirror_energy(LAWS["St. Venant-Kirchhoff"], 1.0) == 0


def test_hencky_gives_way_where_theory_says() -> None:
    """Nominal traction ln(s) / s is largest at s = e, whatever the ratio of the moduli."""
    for lam in (1.0, 9.0):
        assert inflation_gives_way_at(LAWS["Hencky"], lam) == pytest.approx(np.exp(3), rel=0.01)


def test_pressure_of_a_law_that_softens() -> None:
    """Energy (1 - V)^2 (1 + 2 V) has the pressure 6 V (1 - V), largest at half the volume."""

    def law(s: np.ndarray, lam: float) -> float:
        v = float(np.prod(s))
        return (1 - v) ** 2 * (1 + 2 * v)

    assert pressure_softens_at(law, 1) == pytest.approx(0.5, abs=0.01)


def test_table_is_of_the_poissons_ratio_asked_for() -> None:
    """lam over mu is 2 nu / (1 - 2 nu): 1 for 0.25, 9 for 0.45, the mirror energy of neo-Hookean 2 + 2 (lam + 1)."""
    for nu, energy in ((0.25, "6.00"), (0.45, "22.00")):
        (row,) = [line for line in table(nu).splitlines() if "(J - 1)^2" in line]
        assert row.endswith(f"| {energy} |")
