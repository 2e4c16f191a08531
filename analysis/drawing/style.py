"""The look of every plot: one colour and marker for a method everywhere, safe for the colour-blind."""

from __future__ import annotations

import io
import re
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ..methods import FEM_P1, FEM_P2, REFERENCE
from ..wording import significant

matplotlib.rcParams.update(
    {
        "axes.axisbelow": True,
        "axes.grid": True,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "font.sans-serif": ["DejaVu Sans", "sans-serif"],
        "font.size": 10,
        "grid.alpha": 0.3,
        "legend.frameon": False,
        "svg.fonttype": "none",
        "svg.hashsalt": "testbed",
    }
)


class Style(NamedTuple):
    colour: str
    marker: str


_NARROW, _WIDE = 0.7, 2.0  # decades, to which axes are numbered differently

# Okabe & Ito 2008, "Color universal design"; yellow darkened, one colour from Tol 2021, "Colour schemes".
_STYLES = {
    REFERENCE: Style("#000000", "s"),
    FEM_P2: Style("#000000", "s"),
    "uniform": Style("#D55E00", "v"),
    "affine": Style("#0072B2", "o"),
    "van_gelder": Style("#E69F00", "^"),
    "lloyd": Style("#CC79A7", "<"),
    "moment": Style("#B8A200", ">"),
    "edge_coupled": Style("#56B4E9", "D"),
    "node_averaged": Style("#009E73", "P"),
    FEM_P1: Style("#777777", "d"),
}


def style_of(method: str, number: int | None = None) -> Style:
    """Colour and marker of the reference or a spring model, always the same.

    number: of a line that is none of these; without it such a line is grey.
    """
    if method in _STYLES:
        return _STYLES[method]
    return Style("#888888", "X") if number is None else list(_STYLES.values())[(number + 1) % len(_STYLES)]


def number_logarithmic(*axes: Axis) -> None:
    """Plain numbers on logarithmic axes, few enough not to meet, however little or much they span; after all is drawn."""
    for axis in axes:
        low, high = axis.get_view_interval()
        decades = np.log10(high / low)
        if decades < _NARROW:
            axis.set_major_locator(MaxNLocator(3))
        else:
            axis.set_major_locator(
                LogLocator(subs=(1.0,) if decades > _WIDE else (1.0, 2.0, 5.0), numticks=7)
            )
        axis.set_major_formatter(lambda value, _: significant(value))
        axis.set_minor_formatter(NullFormatter())


def svg_of(figure: Figure) -> str:
    """The figure as SVG text, the same for the same figure; points to a hundredth."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
    return re.sub(r"(\d{2,}\.\d\d)\d+", r"\1", buffer.getvalue())
