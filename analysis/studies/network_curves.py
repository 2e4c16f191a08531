"""How the paper's parameters set the error of its network: internal nodes k, their distances Phi and Psi, and multiplicity.

Springs are uniform, on the paper's network and on the completed one, over seeds of the random nodes. The error is that of the
displacement on bar_sag with 300 vertices, against quadratic elements.
"""

from __future__ import annotations

from statistics import median
from typing import NamedTuple

from matplotlib.figure import Figure

from ..drawing.style import number_logarithmic, style_of, svg_of
from ..report import Table
from ..runs import load_run
from ..wording import percent, significant
from .claims import COARSE, SAG, Seeds, error_against, reference_of
from .result import Section

_NETWORKS = ("pcp", "completed_pcp")
_DENSE = ("network.phi=0.15", "network.psi=0.1")


class Ladder(NamedTuple):
    """Values of a key, all else fixed."""

    name: str
    key: str
    values: tuple[float, ...]
    fixed: tuple[str, ...] = ()


LADDERS = (
    Ladder("internal nodes k", "network.k", (50, 100, 200, 450), _DENSE),
    Ladder("least distance of nodes, Phi", "network.phi", (0.12, 0.15, 0.2, 0.3), ("network.psi=0.1",)),
    Ladder("least distance to the surface, Psi", "network.psi", (0.05, 0.1, 0.2, 0.3), ("network.phi=0.15",)),
    Ladder("projective multiplicity", "network.multiplicity", (3, 4, 5, 6, 8)),
)


class Measured(NamedTuple):
    """Errors (%) over the seeds."""

    ladder: Ladder
    network: str
    value: float
    n_nodes: int  #: median
    errors: list[float]


def measure(seeds: Seeds) -> list[Measured]:
    """Every ladder on both networks."""
    error = error_against(load_run(reference_of(seeds.store, SAG, COARSE[:1]).folder))
    rows = []
    for ladder in LADDERS:
        for network in _NETWORKS:
            for value in ladder.values:
                keys = (*COARSE, f"network.connectivity={network}", *ladder.fixed, f"{ladder.key}={value}")
                solved = [o for o in seeds.outcomes(SAG, keys) if o.status == "ok"]
                if solved:
                    n_nodes = round(median(o.record["n_nodes"] for o in solved))
                    rows.append(Measured(ladder, network, value, n_nodes, [error(o) for o in solved]))
    return rows


def section(rows: list[Measured]) -> Section:
    """Curves and their table."""
    figure = Figure(figsize=(11, 3.3), layout="constrained")
    for axes, ladder in zip(figure.subplots(1, len(LADDERS), sharey=True), LADDERS, strict=True):
        for number, network in enumerate(_NETWORKS):
            of = [row for row in rows if (row.ladder, row.network) == (ladder, network)]
            middle = [median(row.errors) for row in of]
            below = [m - min(row.errors) for m, row in zip(middle, of, strict=True)]
            above = [max(row.errors) - m for m, row in zip(middle, of, strict=True)]
            axes.errorbar(
                [row.value for row in of], middle, yerr=[below, above], color=style_of("", number).colour, capsize=2,
                label=network,
            )  # fmt: skip
        axes.set_xlabel(ladder.name, fontsize=9)
        axes.set_yscale("log")
        axes.locator_params(axis="x", nbins=4)
    number_logarithmic(figure.axes[0].yaxis)
    figure.axes[0].set_ylabel("displacement error (%)")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=8, loc="outside upper left", ncols=2)
    caption = "Error of uniform springs over the paper's parameters: medians and ranges over seeds."
    return Section(
        "Accuracy", [], {"network_curves": (svg_of(figure), caption)}, {"network_curves": table(rows)}
    )


def table(rows: list[Measured]) -> Table:
    """A line for every value on every network."""
    head = ["parameter", "value", "network", "nodes", "runs", "error", "from", "to"]
    return head, [
        [
            row.ladder.name, significant(row.value), row.network, str(row.n_nodes), str(len(row.errors)),
            *(percent(e / 100, 2) for e in (median(row.errors), min(row.errors), max(row.errors))),
        ]
        for row in rows
    ]  # fmt: skip
