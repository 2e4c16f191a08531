"""How numbers read in every report, table and plot: a few digits, no exponent, nothing that is 1 of something."""

from __future__ import annotations

import math
from decimal import Decimal

LEAST, MOST = 1e-5, 100.0  # fractions: what is smaller or larger is only said to be so


def significant(value: float, digits: int = 3) -> str:
    """A number rounded to so many digits, without an exponent."""
    return f"{Decimal(f'{value:.{digits}g}'):f}"


def percent(fraction: float | None, digits: int = 3) -> str:
    """A fraction as a percentage; "-" where there is none."""
    if fraction is None or math.isnan(fraction):
        return "-"
    if 0 < fraction < LEAST:
        return f"< {significant(100 * LEAST)} %"
    if fraction > MOST:
        return f"> {significant(100 * MOST)} %"
    return f"{significant(100 * fraction, digits)} %"


def percent_in_words(fraction: float | None, digits: int = 3) -> str:
    """As percent, within a sentence."""
    return percent(fraction, digits).replace("<", "less than").replace(">", "more than")


def percent_signed(fraction: float) -> str:
    """As percent, with a sign where it is not next to nothing."""
    if 0 < abs(fraction) < LEAST:
        return percent(abs(fraction))
    return f"{'-' if fraction < 0 else '+'}{percent(abs(fraction))}"


def about(fraction: float | None) -> str:
    """An estimate, as a percentage of two digits."""
    return f"some {percent_in_words(fraction, 2)}"


def share(fraction: float) -> str:
    """A part of something that has been named: "25 % of it", "as much", "5.4 times as much"."""
    if fraction < 0.95:
        return f"{percent_in_words(fraction, 2)} of it"
    return "as much" if fraction < 1.05 else f"{significant(fraction, 2)} times as much"


def seconds(value: float) -> str:
    return "< 0.01 s" if value < 0.01 else f"{significant(value, 2 if value < 100 else 3)} s"


def duration(value: float) -> str:
    """Seconds that are foreseen: "7 s", "4 min", "2 h"."""
    if value < 100:
        return f"{max(1, float(f'{value:.1g}')):.0f} s"
    return f"{value / 60:.0f} min" if value < 6000 else f"{value / 3600:.0f} h"


def unit_of_length(value: float) -> tuple[str, float]:
    """The unit in which a length (m) reads best, and its size (m)."""
    units = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}
    return next(((name, size) for name, size in units.items() if abs(value) >= size / 10), ("m", 1.0))


def listed(words: list[str], last: str = "and") -> str:
    """ "a", "a and b", "a, b and c"."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
