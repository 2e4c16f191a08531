"""Verdict study: how many verdicts on bodies drawn at random hold against a reference refined once more.

Bodies and loads are drawn as those of the accuracy study, a case for each body. Each is run as a user runs it, and the
reference is then refined once more than the verdict's own. A verdict holds where the error against that one lies on the
side of the bounds that it says. Runs that are finished are kept.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..comparison import compare
from ..experiment import TIME_LIMIT, run_solvers
from ..grid import csv_of
from ..paths import write_text
from ..progress import Progress
from ..report import Table
from ..run_store import Store, each
from ..runs import RunError
from ..verdict import FAILS, SERVES, has_figures, verdict_on
from ..wording import percent
from .accuracy import SPRINGS, Bench, Case, Row, cases, error_of
from .bodies import random_of
from .result import Result, Section

_N_BODIES, _N_QUICK = 20, 3
_MODELS = (SPRINGS, "edge_coupled", "uniform")
_TRUTH_LIMIT = 3000.0  # s, of the reference that tells whether a verdict holds
_LONG = 120.0  # s, in which a verdict is wanted


def drawn(n: int) -> list[Case]:
    """A case of each of so many bodies, drawn by its name."""
    of_body: dict[str, list[Case]] = {}
    for case in cases():
        of_body.setdefault(case.body.name, []).append(case)
    return [of[random_of(f"verdict on {body}").integers(len(of))] for body, of in of_body.items()][:n]


def holds(verdict: str, error: float) -> bool:
    """Whether a verdict is right of a model that is off by so much."""
    return {"use": error <= SERVES, "not": error > FAILS, "between": SERVES < error <= FAILS}[verdict]


def measure(bench: Bench, case: Case) -> list[Row]:
    """A row for each model."""
    scene, _ = bench.scenes(case)
    place = {"body": case.body.name, "kind": case.kind, "load": case.load, "nu": case.nu}
    folder = bench.folder / "cases" / f"{case.body.name}-{case.load}-{case.nu}"
    models = ", ".join(f'"{model}"' for model in _MODELS[1:])
    overrides = [
        f"material.nu={case.nu}", f"network.calibration={SPRINGS}", f"comparison.calibrations=[{models}]"
    ]  # fmt: skip
    try:
        comparison = compare(
            run_solvers(
                scene, folder, None, overrides, is_quiet=True, time_limit=TIME_LIMIT, store=bench.store
            )
        )
    except RunError as error:
        return [{**place, "model": SPRINGS, "verdict": "no result", "message": str(error)}]
    values = comparison.as_json()
    try:
        truth = bench.elements(scene, case.nu, comparison.experiment.n_refinements + 1)
    except RunError as error:
        truth, why = None, str(error)
    rows: list[Row] = []
    for name, model in values["models"].items():
        row = {**place, "model": name, "seconds": f"{comparison.experiment.seconds:.3g}"}
        if not has_figures(model):
            rows.append({**row, "verdict": "no result", "message": model["status"]})
            continue
        verdict = verdict_on(model, values["reference"])
        own = values["reference"]["estimated_error_l2"]
        row |= {
            "verdict": verdict,
            "difference": f"{model['displacement_error_l2']:.5g}",
            "own": "" if own is None else f"{own:.5g}",
        }
        if truth is None:
            rows.append({**row, "message": why})
            continue
        error_found = error_of(comparison.runs[name], truth)
        is_right = "" if verdict == "undecided" else str(holds(verdict, error_found))
        rows.append({**row, "error": f"{error_found:.5g}", "holds": is_right})
    return rows


def table(rows: list[Row]) -> Table:
    """A line for each model and verdict: how many there are, how many hold, and how near the nearest error came."""
    head = ["model", "verdict", "cases", "hold", "do not", "unchecked", "least error", "largest error"]
    lines = []
    for model in _MODELS:
        for verdict in ("use", "not", "between", "undecided", "no result"):
            of = [row for row in rows if (row["model"], row["verdict"]) == (model, verdict)]
            if not of:
                continue
            found = [row.get("holds", "") for row in of]
            errors = [float(row["error"]) for row in of if row.get("error")]
            counts = [len(of), found.count("True"), found.count("False"), len(of) - len(errors)]
            ends = [percent(min(errors)), percent(max(errors))] if errors else ["-", "-"]
            lines.append([model, verdict, *map(str, counts), *ends])
    return head, lines


def finding(rows: list[Row]) -> str:
    """The study in one sentence."""
    checked = [row["holds"] for row in rows if row.get("holds")]
    undecided = sum(row["verdict"] == "undecided" for row in rows)
    bodies = {row["body"]: float(row["seconds"]) for row in rows if row.get("seconds")}
    quick = sum(seconds <= _LONG for seconds in bodies.values())
    return (
        f"{checked.count('True')} of {len(checked)} verdicts hold, {undecided} of {len(rows)} cannot be decided, "
        f"and {quick} of {len(bodies)} bodies have theirs within two minutes."
    )


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: three bodies."""
    bench = Bench(folder, Store(folder / "runs", time_limit=_TRUTH_LIMIT))
    wanted = drawn(_N_QUICK if arguments.quick else _N_BODIES)
    rows: list[Row] = []
    progress = Progress(len(wanted), arguments.quiet)
    for case, found in zip(wanted, each(lambda case: measure(bench, case), wanted), strict=True):
        rows += found
        progress.say(f"{case.body.name}, {case.load}, nu = {case.nu}")
        write_text(folder / "rows.csv", csv_of(rows))
    return Result(
        "Verdicts that hold", finding(rows), [Section("Verdicts", [_HOW], {}, {"verdicts": table(rows)})]
    )


_HOW = "Errors are those against a reference refined once more than that of the verdict."
