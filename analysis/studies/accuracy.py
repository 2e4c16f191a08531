"""Accuracy study: every spring model against exact elastic fields, and against quadratic elements where there is no exact
field, beside linear finite elements on the same nodes.

Runs build/bin/accuracy, which continues an unfinished table, and at the same time the loads of accuracy_loads.py, whose
finished runs are kept. Ratios are to the errors of linear elements in the same case; the figures show their distribution,
and the error against the number of nodes.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..drawing.style import style_of, svg_of
from ..methods import label_of
from ..paths import MESHES, PROGRAMS
from ..report import Table
from ..runs import RunError
from .accuracy_loads import Loads
from .result import Figures, Result, Section

LINEAR_ELEMENTS = "edge_coupled"
PATCH_LOADS = {"pressure", "uniaxial", "shear"}  # linear fields: linear elements are exact
_COUPLED = ["edge_coupled", "node_averaged"]
_FAST = ["uniform", "affine", "van_gelder", "lloyd", *_COUPLED]  # the first two on completed PCP

Row = dict[str, str]
Case = tuple[str, str, str, str, str]


def batches(meshes: Path, quick: bool) -> list[dict[str, list[str]]]:
    """Options of the accuracy program, one set for each part of the study. Real meshes only where they are."""
    small = [
        str(file) for name in ("torus.obj", "liver2.obj", "handle.off") if (file := meshes / name).exists()
    ]
    large = [
        str(file)
        for name in ("spot.ply", "bunny.obj", "fandisk.off", "hand_closed.obj")
        if (file := meshes / name).exists()
    ]
    all_nu = ["0", "0.25", "0.3", "0.45", "0.49"]
    if quick:
        return [{"surface": ["ball:162", "ball:642", *small], "nu": ["0.25", "0.49"], "model": _FAST}]
    levels = [f"{shape}:{n}" for shape, counts in _RESOLUTIONS.items() for n in counts]
    study = [
        {"surface": levels, "nu": ["0.25", "0.49"], "model": _FAST},
        {"surface": ["ball:162"], "nu": ["0.25", "0.45"], "model": ["moment"]},
        {"surface": ["ball:642", "bar:900", *small], "nu": all_nu, "seed": ["1", "2", "3"], "model": _FAST},
        {"surface": large, "nu": all_nu, "model": ["van_gelder", *_COUPLED]},
    ]
    return [batch for batch in study if batch["surface"]]


_EXACT = "Error over that of linear elements on the same nodes (bending, torsion, cubic harmonic), and the worst patch test."
_LOADS = (
    "The same of other loads, against quadratic elements. A case is undecided within three times their own error; the last "
    "column counts those that are at most a third whatever that error's direction."
)
_RESOLUTIONS = {"ball": (162, 642, 2562), "bar": (300, 1200, 4800), "torus": (400, 1600, 6400)}


def run_program(table: Path, quick: bool) -> None:
    """Raises RunError when the program fails."""
    for batch in batches(MESHES, quick):
        options = [word for option, values in batch.items() for word in (f"--{option}", *values)]
        # The program dies with this process, so that a killed study leaves nobody working.
        command = ["setpriv", "--pdeathsig", "KILL", str(PROGRAMS / "accuracy"), "--out", str(table)]
        if subprocess.run([*command, *options], check=False).returncode != 0:
            raise RunError("the accuracy program failed; its message stands above")


def read_table(file: Path) -> list[Row]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def case_of(row: Row) -> Case:
    return row["surface"], row["spacing"], row["seed"], row["nu"], row["load"]


def summarise(rows: list[Row], by: str = "nu") -> list[dict[str, Any]]:
    """Per model and value of the column `by`: error over linear elements' on the same nodes, worst patch test."""
    errors = {
        case_of(r): float(r["error_l2"]) for r in rows if r["model"] == LINEAR_ELEMENTS and r.get("error_l2")
    }
    linear = {
        case_of(r): errors[case_of(r)] for r in rows if r["model"] == LINEAR_ELEMENTS and r["status"] == "ok"
    }
    ratios: dict[tuple[str, str], list[float]] = defaultdict(list)
    patches: dict[tuple[str, str], list[float]] = defaultdict(list)
    refused: dict[tuple[str, str], int] = defaultdict(int)
    bounds: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in rows:
        key = row["model"], row[by]
        if row["status"] == "undecided":
            bounds[key].append(_largest_ratio(row, errors.get(case_of(row))))
        elif row["status"] != "ok":
            refused[key] += 1
        elif row["load"] in PATCH_LOADS:
            patches[key].append(float(row["error_l2"]))
        elif case_of(row) in linear:
            ratios[key].append(float(row["error_l2"]) / linear[case_of(row)])
    return [
        {
            "model": model,
            "of": value,
            "cases": len(values),
            "median": median(values) if values else None,
            "at_most_third": float(np.mean(np.array(values) <= 1 / 3)) if values else None,
            "largest": max(values, default=None),
            "worst_patch": max(patches[model, value], default=None),
            "refused": refused[model, value],
            "undecided": len(bounds[model, value]),
            "undecided_at_most_third": sum(bound <= 1 / 3 for bound in bounds[model, value]),
        }
        for model, value in sorted({(r["model"], r[by]) for r in rows})
        for values in [ratios[model, value]]
    ]


def _largest_ratio(row: Row, linear: float | None) -> float:
    """That a model's error can have to linear elements' with the reference's own error against both."""
    own = float(row["reference_error"])
    return (float(row["error_l2"]) + own) / (linear - own) if linear and linear > own else np.inf


def slope_of(nodes: list[float], errors: list[float]) -> float:
    """Order in the spacing h ~ n^(-1/3)."""
    return float(-3 * np.polyfit(np.log(nodes), np.log(errors), 1)[0])


def table(by: str, summary: list[dict[str, Any]]) -> Table:
    """A row for each model and value of the column `by`."""
    head = [
        "model", by, "cases", "median", "<= 1/3", "largest", "worst patch", "refused", "undecided", "of these <= 1/3"
    ]  # fmt: skip

    def number(value: float | None, form: str) -> str:
        return "-" if value is None else f"{value:{form}}"

    return head, [
        [
            s["model"], s["of"], str(s["cases"]), number(s["median"], ".3f"), number(s["at_most_third"], ".0%"),
            number(s["largest"], ".3f"), number(s["worst_patch"], ".0e"), str(s["refused"]), str(s["undecided"]),
            str(s["undecided_at_most_third"]),
        ]
        for s in summary
    ]  # fmt: skip


def finding(rows: list[Row]) -> str:
    """The study in one sentence; rows: of the exact fields."""
    summary = summarise([{**row, "all": ""} for row in rows], "all")
    known = sorted((s["median"], s["model"]) for s in summary if s["median"] is not None)
    words = ", ".join(f"{model} {ratio:.2g}" for ratio, model in known if model != LINEAR_ELEMENTS)
    return f"Error against exact fields over that of linear finite elements on the same nodes, in the median: {words}."


def convergence(
    rows: list[Row], shape: str, nu: str, load: str
) -> dict[str, tuple[list[float], list[float]]]:
    """Model -> nodes and errors over the resolutions of a generated shape."""
    points: dict[str, list[tuple[float, float]]] = defaultdict(list)
    wanted = {f"{shape}:{n}" for n in _RESOLUTIONS[shape]}
    for r in rows:
        if (r["surface"] in wanted and (r["nu"], r["load"], r["seed"]) == (nu, load, "1")
                and r["status"] == "ok"):  # fmt: skip
            points[r["model"]].append((float(r["n_nodes"]), float(r["error_l2"])))
    return {model: tuple(map(list, zip(*sorted(p), strict=True))) for model, p in points.items()}  # type: ignore[misc]


def plot_convergence(rows: list[Row]) -> str:
    figure = Figure(figsize=(11, 7))
    axes = figure.subplots(2, 3, sharex="col", sharey=True)
    for column, shape in enumerate(_RESOLUTIONS):
        for row, nu in enumerate(("0.25", "0.49")):
            axis = axes[row, column]
            for model, (nodes, errors) in convergence(rows, shape, nu, "torsion").items():
                colour, marker = style_of(model)
                label = label_of(model)
                if len(nodes) > 1:
                    label += f" ({slope_of(nodes, errors):.1f})"
                axis.loglog(nodes, [100 * e for e in errors], color=colour, marker=marker, label=label)
            axis.set_title(f"{shape}, torsion, nu = {nu}", fontsize=10)
            if axis.lines:
                axis.legend(fontsize=7, title="(order in the spacing)", title_fontsize=7)
            if row == 1:
                axis.set_xlabel("nodes")
    for axis in axes[:, 0]:
        axis.set_ylabel("error (%)")
    return svg_of(figure)


def plot_ratios(rows: list[Row]) -> str:
    """Share of cases whose error over that of linear elements stays below a value."""
    linear = {
        case_of(r): float(r["error_l2"])
        for r in rows
        if r["model"] == LINEAR_ELEMENTS and r["status"] == "ok"
    }
    figure = Figure(figsize=(7, 4.5))
    axis = figure.subplots()
    for model in sorted({r["model"] for r in rows} - {LINEAR_ELEMENTS}):
        values = sorted(
            float(r["error_l2"]) / linear[case_of(r)]
            for r in rows
            if r["model"] == model
            and r["status"] == "ok"
            and r["load"] not in PATCH_LOADS
            and case_of(r) in linear
        )
        if values:
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axis.semilogx(
                values, share, color=style_of(model).colour, label=f"{label_of(model)} ({len(values)} cases)"
            )
    axis.axvline(1, color=style_of(LINEAR_ELEMENTS).colour, label="linear finite elements")
    axis.set_xlabel("error over that of linear finite elements on the same nodes")
    axis.set_ylabel("cases below (%)")
    axis.legend(fontsize=8)
    return svg_of(figure)


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Every model against exact fields and against quadratic elements; --quick: a minute on a few small meshes."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "accuracy.csv"
    with ThreadPoolExecutor() as pool:  # the program on one core, the loads' runs on the other
        exact = pool.submit(run_program, file, arguments.quick)
        loads = Loads(folder, MESHES, arguments.quiet).run(arguments.quick)
        exact.result()
    rows = read_table(file)
    figures: Figures = {
        "ratios": (plot_ratios(rows), "Cases whose error over that of linear elements stays below a value."),
        "convergence": (plot_convergence(rows), "Error in torsion over the number of nodes."),
    }
    sections = [
        Section("Exact fields", [_EXACT], figures, {"exact_by_nu": table("nu", summarise(rows))}),
        Section(
            "Other loads",
            [_LOADS],
            {},
            {
                "loads_by_nu": table("nu", summarise(loads)),
                "loads_by_load": table("load", summarise(loads, "load")),
            },
        ),
    ]
    return Result("Accuracy of the spring models", finding(rows), sections)
