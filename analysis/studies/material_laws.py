"""Why the coupled springs follow the law they do: candidates that agree at small strain, compared far from it.

python -m analysis.studies.material_laws [NU] prints a table. All energies are in units of mu, of principal stretches s (the last
one negative where the body is turned inside out), J their product:
- softens under pressure: volume ratio below which the pressure falls although the body shrinks further
- softens in a crush: length ratio below which the stress of a column with free sides falls
- gives way in inflation: volume ratio beyond which the nominal traction of a body pulled on all sides falls
- mirror image: energy of the body turned inside out; 0 is a second state of rest
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

Law = Callable[[np.ndarray, float], float]

LEAST_JACOBIAN = 0.1  # of the chosen law, as in massspring/tet_springs.cpp


def _saint_venant_kirchhoff(s: np.ndarray, lam: float) -> float:
    e = (s**2 - 1) / 2
    return float(np.sum(e**2) + lam / 2 * np.sum(e) ** 2)


def _hencky(s: np.ndarray, lam: float) -> float:
    e = np.log(np.abs(s))
    return float(np.sum(e**2) + lam / 2 * np.sum(e) ** 2)


def _neo_hookean_log(s: np.ndarray, lam: float) -> float:
    log_j = np.log(np.abs(np.prod(s)))  # of C, blind to the sign of J
    return float((np.sum(s**2) - 3) / 2 - log_j + lam / 2 * log_j**2)


def _neo_hookean_stable(s: np.ndarray, lam: float) -> float:
    j = np.prod(s)
    return float((np.sum(s**2) - 3) / 2 - (j - 1) + (lam + 1) / 2 * (j - 1) ** 2)


def _ciarlet_geymonat(s: np.ndarray, lam: float) -> float:
    j, c = np.prod(s), 1 + lam / 2
    k = max(j, LEAST_JACOBIAN)
    g, dg, ddg = lam / 4 * (k * k - 1) - c * np.log(k), lam / 2 * k - c / k, lam / 2 + c / k**2
    return float((np.sum(s**2) - 3) / 2 + g + dg * (j - k) + ddg / 2 * (j - k) ** 2)


LAWS: dict[str, Law] = {
    "St. Venant-Kirchhoff": _saint_venant_kirchhoff,
    "Hencky": _hencky,
    "neo-Hookean, ln^2 J": _neo_hookean_log,
    "neo-Hookean, (J - 1)^2": _neo_hookean_stable,
    "Ciarlet-Geymonat (chosen)": _ciarlet_geymonat,
}

_SMALLEST, _LARGEST = 0.3, 3  # stretches looked at
_STEP = 1e-4


def _slope(f: Callable[[float], float], x: float) -> float:
    return (f(x + _STEP) - f(x - _STEP)) / (2 * _STEP)


def _least(f: Callable[[float], float], low: float, high: float) -> float:
    """Least value of a function with one minimum between low and high."""
    while high - low > 1e-9:
        third = (high - low) / 3
        if f(low + third) < f(high - third):
            high -= third
        else:
            low += third
    return f((low + high) / 2)


def _first_fall(stress: Callable[[float], float], stretches: np.ndarray) -> float | None:
    """First of the stretches at which the magnitude of the stress falls."""
    values = np.abs([stress(s) for s in stretches])
    falls = np.flatnonzero(np.diff(values) < 0)
    return float(stretches[falls[0]]) if falls.size else None


def pressure_softens_at(law: Law, lam: float) -> float | None:
    def energy(s: float) -> float:
        return law(np.full(3, s), lam)

    stretch = _first_fall(lambda s: _slope(energy, s) / (3 * s * s), np.arange(0.99, _SMALLEST, -0.002))
    return None if stretch is None else stretch**3


def crush_softens_at(law: Law, lam: float) -> float | None:
    def energy(s: float) -> float:  # the sides are free
        return _least(lambda t: law(np.array([t, t, s]), lam), 0.8, 2)

    return _first_fall(lambda s: _slope(energy, s), np.arange(0.99, _SMALLEST, -0.005))


def inflation_gives_way_at(law: Law, lam: float) -> float | None:
    def energy(s: float) -> float:
        return law(np.full(3, s), lam)

    stretch = _first_fall(lambda s: _slope(energy, s), np.arange(1.01, _LARGEST, 0.002))
    return None if stretch is None else stretch**3


def mirror_energy(law: Law, lam: float) -> float:
    return law(np.array([1.0, 1.0, -1.0]), lam)


def table(nu: float) -> str:
    lam = 2 * nu / (1 - 2 * nu)

    def cell(value: float | None) -> str:
        return "never" if value is None else f"{value:.2f}"

    lines = [
        "| law | softens under pressure at V/V0 | softens in a crush at l/l0 | gives way in inflation at V/V0 | mirror image |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {cell(pressure_softens_at(law, lam))} | {cell(crush_softens_at(law, lam))} "
        f"| {cell(inflation_gives_way_at(law, lam))} | {mirror_energy(law, lam):.2f} |"
        for name, law in LAWS.items()
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(float(sys.argv[1]) if len(sys.argv) > 1 else 0.25))
