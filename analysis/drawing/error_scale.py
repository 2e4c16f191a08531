"""One scale of errors for every picture, view and film: the same colour is the same error everywhere.

Blue serves, yellow to orange lies in between, red does not serve: the colours change where a verdict does. They grow darker
with the logarithm of the error.
"""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure

from ..runs import Array
from ..verdict import FAILS, SERVES
from ..wording import significant
from .style import svg_of

LEAST, MOST = 0.1, 100.0  #: %: what is smaller or larger has the colour of these
CLAY = "#c9ccd1"  #: of what bears no error
MARKS = (100 * SERVES, 100 * FAILS)  #: %: where a verdict changes
TICKS = [LEAST, 1.0, *MARKS, MOST]  #: %
POWERS = (float(np.log10(LEAST)), float(np.log10(MOST)))  #: between which colours are spread evenly
_WORDS = ("serves", "in between", "does not serve")
_ENDS = (("#e3effa", "#5f9fd3"), ("#ffe48f", "#f39237"), ("#d92b20", "#650010"))  # of the parts between marks
_N = 768  # colours: a step of the scale is a hundredth of an error


def _colours() -> ListedColormap:
    bounds = np.log(np.array([LEAST, *MARKS, MOST]) / LEAST) / np.log(MOST / LEAST)
    at = (np.arange(_N) + 0.5) / _N
    table = np.empty((_N, 3))
    for low, high, ends in zip(bounds[:-1], bounds[1:], _ENDS, strict=True):
        part = (at >= low) & (at <= high)
        share = (at[part, None] - low) / (high - low)
        pale, dark = map(np.array, map(to_rgb, ends))
        table[part] = pale + share * (dark - pale)
    return ListedColormap(table, "errors")


COLOURS = _colours()


def powers_of(errors: Array) -> Array:
    """What is coloured of errors (%): their powers of ten, as far as the scale goes."""
    return np.log10(np.clip(errors, LEAST, MOST))


def colour_of(error: float) -> tuple[float, ...]:
    """Red, green and blue (0 to 1) of an error (%)."""
    return tuple(COLOURS(Normalize(*POWERS)(powers_of(np.array(error))))[:3])


def scale_svg() -> str:
    """The scale as a bar, with what its marks mean to a verdict."""
    figure = Figure(figsize=(7, 1.0))
    bar = figure.colorbar(
        ScalarMappable(LogNorm(LEAST, MOST), COLOURS), cax=figure.add_axes((0.02, 0.5, 0.96, 0.22)),
        orientation="horizontal", extend="both", extendfrac=0.03,
    )  # fmt: skip
    bar.set_ticks(TICKS, labels=[significant(tick) for tick in TICKS])
    bar.ax.minorticks_off()
    bar.set_label("displacement error (% of the reference's root mean square)")
    for mark in MARKS:
        bar.ax.axvline(mark, color="black", linewidth=1.2)
    for low, high, word in zip((LEAST, *MARKS), (*MARKS, MOST), _WORDS, strict=True):
        bar.ax.text(np.sqrt(low * high), 1.25, word, transform=bar.ax.get_xaxis_transform(),
                    ha="center", va="bottom", fontsize=9)  # fmt: skip
    return svg_of(figure)
