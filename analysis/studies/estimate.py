"""Estimate study: how near the springs' own estimates come to their errors, and whether nodes added for a target meet it.

Bodies, loads, errors and the reference are those of the accuracy study. A target is met where the error is at most one and a
half times as large. The price is the seconds of the estimate over all others. What is finished is kept.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import median

import numpy as np

from ..grid import csv_of
from ..paths import write_text
from ..progress import Progress
from ..report import Table
from ..run_store import each
from ..runs import Run, RunError
from ..verdict import total
from ..wording import percent, significant
from .accuracy import SPRINGS, Bench, Case, Row, cases_of_half, error_of
from .result import Result, Section

ESTIMATE = "estimate"
_TARGETS = (0.1, 0.05, 0.03)
_MET = 1.5  # times the target


def _keys() -> dict[str, str]:
    """What is asked for, and the key of the scene that asks."""
    targets = {f"target {target:g}": f"network.target_error={target:g}" for target in _TARGETS}
    return {ESTIMATE: "network.estimate=true"} | targets


def measure(bench: Bench, case: Case) -> list[Row]:
    """A row for the estimate and for each target. What fails is a row that says why."""
    scene, _ = bench.scenes(case)
    place = {"body": case.body.name, "kind": case.kind, "load": case.load, "nu": case.nu}
    rows = []
    reference: Run | None = None  # read once, as it is large
    for asked, key in _keys().items():
        row = {**place, "asked": asked}
        try:
            if reference is None:
                reference, _ = bench.references(scene, case)
            springs = bench.run("massspring", scene, case.nu, f"network.calibration={SPRINGS}", key)
        except RunError as error:
            rows.append({**row, "status": str(error)})
            continue
        rows.append({**row, "status": "ok", **_figures(springs, reference)})
    return rows


def _figures(springs: Run, reference: Run) -> Row:
    seconds = springs.record["seconds"]
    return {
        "n_nodes": str(springs.record["n_nodes"]),
        "seconds": f"{total(seconds):.3g}",
        "price": f"{seconds[ESTIMATE] / seconds['solve']:.3g}" if ESTIMATE in seconds else "",
        "error": f"{error_of(springs, reference):.5g}",
        "estimate": f"{springs.record['estimated_error']:.5g}",
    }


def table(rows: list[Row]) -> Table:
    """A line for each kind of load and what was asked for."""
    ratio = ["estimate / error", "10 %", "90 %", "within two"]
    head = ["kind", "asked", "cases", "no result", *ratio, "met", "error", "nodes", "seconds", "price"]
    lines = []
    for kind in ("free", "held"):
        for asked in _keys():
            of = [row for row in rows if (row["kind"], row["asked"]) == (kind, asked)]
            found = [row for row in of if row["status"] == "ok"]
            line = [kind, asked, str(len(found)), str(len(of) - len(found))]
            lines.append(line + (_summary(found, asked) if found else ["-"] * (len(head) - len(line))))
    return head, lines


def _summary(rows: list[Row], asked: str) -> list[str]:
    errors, estimates = (np.array([float(row[key]) for row in rows]) for key in ("error", "estimate"))
    ratios = estimates / errors
    low, high = np.quantile(ratios, [0.1, 0.9])
    is_near = (ratios >= 1 / 2) & (ratios <= 2)
    met = "-" if asked == ESTIMATE else percent(float(np.mean(errors <= _MET * float(asked.split()[1]))), 2)
    return [
        *(f"{value:.2f}" for value in (np.median(ratios), low, high)),
        percent(float(np.mean(is_near)), 2),
        met,
        percent(float(np.median(errors)), 2),
        *(significant(median(float(row[key]) for row in rows)) for key in ("n_nodes", "seconds")),
        f"{median(prices):.2g}" if (prices := [float(row["price"]) for row in rows if row["price"]]) else "-",
    ]


def finding(rows: list[Row]) -> str:
    """The study in one sentence."""
    found = [row for row in rows if row["status"] == "ok"]
    near = [
        0.5 <= float(row["estimate"]) / float(row["error"]) <= 2 for row in found if row["asked"] == ESTIMATE
    ]
    if not near:
        return "No estimate was found."
    return f"Estimates are within a factor two of the error in {percent(float(np.mean(near)), 2)} of {len(near)} cases."


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: four cases, some minutes."""
    bench = Bench(folder)
    wanted = cases_of_half(arguments.held_out, arguments.quick)[: arguments.count]
    rows: list[Row] = []
    progress = Progress(len(wanted), arguments.quiet)
    for case, found in zip(wanted, each(lambda case: measure(bench, case), wanted), strict=True):
        rows += found
        progress.say(case.name)
        write_text(folder / "rows.csv", csv_of(rows))
    sections = [Section("Estimates and targets", [_HOW], {}, {"estimates": table(rows)})]
    return Result("What the springs know of their error", finding(rows), sections)


_HOW = (
    "Medians, and the first and last tenth, over the cases; a target is met where the error is at most 1.5 times as large. "
    "The price is the seconds of the estimate over those of the solve. With a target, seconds contain all estimates."
)
