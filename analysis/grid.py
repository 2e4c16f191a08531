"""Runs a scene over a grid of values: a table, a plot, and nothing that is finished is run again."""

from __future__ import annotations

import csv
import io
import itertools
import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .cluster import engine_of
from .compare import compare_runs, free_motions
from .drawing.style import number_logarithmic, style_of, svg_of
from .experiment import default_folder, surface_overrides
from .folder_lock import locked
from .outputs import forget
from .paths import ROOT, write_text
from .progress import Progress, reminders
from .report import html_table, page, svg_figure, text_table
from .run_store import Outcome, RunRequest, Store, each
from .runs import RunError, load_run, read_toml
from .verdict import SERVES, total
from .wording import percent

_ERROR = "displacement_error_l2"
_ERRORS = [_ERROR, "displacement_error_max", "volume_change_error"]
_SECONDS = ["seconds_massspring", "seconds_fem_reference"]
FIGURES = [*_ERRORS, "n_nodes", "n_springs", "n_patches", *_SECONDS]
_PAUSE = 1.0  # s, between tables on the way
Row = dict[str, Any]


def parse_grid(settings: list[str]) -> dict[str, list[str]]:
    """Key -> values of KEY=VALUE,VALUE... Commas within brackets or quotes belong to a value.

    Raises RunError for a setting without "=" and for a key that stands twice.
    """
    grid: dict[str, list[str]] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key:
            raise RunError(f"--set {setting}: expected KEY=VALUE,VALUE...")
        if key in grid:
            raise RunError(f"--set {setting}: {key} stands twice, expected all its values in one --set")
        grid[key] = _split(text)
    return grid


def _split(text: str) -> list[str]:
    values, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "[{":
            depth += 1
        elif letter in "]}":
            depth -= 1
        if letter == "," and not depth and not quote:
            values.append("")
        else:
            values[-1] += letter
    return values


def settings_of(grid: dict[str, list[str]]) -> list[dict[str, str]]:
    """Every combination of the grid's values, the last key changing fastest."""
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def varied(grid: dict[str, list[str]]) -> list[str]:
    """The keys of more than one value: those that a table needs to tell runs apart."""
    return [key for key, values in grid.items() if len(values) > 1] or list(grid)


def _overrides(scene: Path, settings: dict[str, str]) -> tuple[str, ...]:
    """What a run sets in the scene; motions are compared frame by frame, so they keep theirs."""
    mode = settings.get("time.mode") or read_toml(scene).get("time", {}).get("mode")
    frames = () if mode == "dynamic" else ("output.frames_every=0",)
    return (*frames, *(f"{key}={value}" for key, value in settings.items()))


def measure(store: Store, scene: Path, settings: dict[str, str]) -> Row:
    """The row of one run: its settings, status, message and figures. A run that fails has a message instead."""
    overrides = _overrides(scene, settings)
    runs: list[Outcome] = []
    for program in ("massspring", "fem_reference"):
        runs.append(store.run(RunRequest(program, scene, overrides)))
        if runs[-1].status != "ok":
            return {
                **settings,
                "status": runs[-1].status,
                "message": f"{program}: {runs[-1].message or 'gave no result'}",
            }
    try:
        springs, reference = (load_run(run.folder) for run in runs)
        figures = asdict(compare_runs(springs, reference, is_free=free_motions(reference.record)))
    except RunError as error:
        return {**settings, "status": "failed", "message": str(error)}
    for run in (springs, reference):
        figures[f"seconds_{run.record['program']}"] = total(run.record["seconds"])
    return {**settings, "status": "ok", "message": "", **{name: figures[name] for name in FIGURES}}


def csv_of(rows: list[Row]) -> str:
    """Rows as CSV text; the first row's settings lead, and a figure that does not exist is left empty."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    table = csv.DictWriter(text, keys, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def finding(name: str, keys: list[str], rows: list[Row]) -> str:
    """The sweep in one sentence, and what it concludes in a second."""
    good = sorted((row for row in rows if row["status"] == "ok"), key=lambda row: row[_ERROR])
    failed = f"; {len(rows) - len(good)} of {len(rows)} runs gave no result" if len(good) < len(rows) else ""
    if not good:
        return f"{name}: none of {len(rows)} runs gave a result."

    def place(row: Row) -> str:
        return ", ".join(f"{key} = {row[key]}" for key in keys)

    best, worst = good[0], good[-1]
    n_serving = sum(row[_ERROR] <= SERVES for row in good)
    return (
        f"{name}: the springs miss the finite elements' surface displacement by {percent(best[_ERROR])} at best "
        f"({place(best)}) and by {percent(worst[_ERROR])} at worst ({place(worst)}){failed}. "
        f"At {n_serving} of {len(rows)} runs they are off by at most {percent(SERVES)}."
    )


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def plot(keys: list[str], rows: list[Row]) -> str:
    """Error over the numeric key of most values, a line for every combination of the others."""
    numeric = [key for key in keys if all(_number(row[key]) is not None for row in rows)]
    along = max(numeric or keys, key=lambda key: len({row[key] for row in rows}))
    others = [key for key in keys if key != along]
    places = list(dict.fromkeys(row[along] for row in rows))
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    lines: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        label = ", ".join(
            row[key] if key == "network.calibration" else f"{key} = {row[key]}" for key in others
        )
        at = float(row[along]) if along in numeric else float(places.index(row[along]))
        lines.setdefault(label, []).append((at, 100 * row[_ERROR] if row["status"] == "ok" else np.nan))
    for number, (label, line) in enumerate(lines.items()):
        style = style_of(label, number)
        axes.plot(*zip(*sorted(line), strict=True), color=style.colour, marker=style.marker, label=label)
    axes.set_yscale("log")
    number_logarithmic(axes.yaxis)
    if along not in numeric:
        axes.set_xticks(range(len(places)), places)
    axes.set_xlabel(along)
    axes.set_ylabel("displacement error (%)")
    if others:
        figure.legend(fontsize=8, loc="outside upper left", ncols=3)
    return svg_of(figure)


def table_of(keys: list[str], rows: list[Row]) -> tuple[list[str], list[list[str]]]:
    """Head and rows for the terminal and the report."""
    head = [
        *keys,
        "displacement error",
        "at worst",
        "volume error",
        "nodes",
        "springs (s)",
        "finite elements (s)",
        "",
    ]
    body = []
    for row in rows:
        cells = [row[key] for key in keys]
        if row["status"] == "ok":
            cells += [percent(row[name]) for name in _ERRORS] + [str(row["n_nodes"])]
            cells += [f"{row[name]:.2f}" for name in _SECONDS] + [""]
        else:
            cells += ["-"] * 6 + [f"{row['status']}: {row['message']}"]
        body.append(cells)
    return head, body


def write(
    folder: Path, scene: Path, keys: list[str], rows: list[Row], records: dict[str, dict[str, Any]]
) -> None:
    """Writes sweep.csv and report.html."""
    write_text(folder / "sweep.csv", csv_of(rows))
    parts = [html_table(*table_of(keys, rows))]
    if any(row["status"] == "ok" for row in rows):
        parts.insert(
            0, svg_figure(plot(keys, rows), "Displacement error at the surface over the values of the sweep.")
        )
    parts.append("<p>Seconds are those of single runs, not benchmarked.</p>")
    protocol = {scene.name: scene.read_text()}
    protocol |= {
        f"{program}: run.json of one run": json.dumps(record, indent=2) for program, record in records.items()
    }
    write_text(
        folder / "report.html",
        page(f"{scene.stem}: {', '.join(keys)}", finding(scene.stem, keys, rows), parts, protocol),
    )


def sweep(
    scene: Path,
    grid: dict[str, list[str]],
    folder: Path,
    part: tuple[int, int] = (1, 1),
    is_quiet: bool = False,
    store: Store | None = None,
) -> list[Row]:
    """Makes every run of the grid that has not been made, and writes the table on the way.

    part: (i, n) runs the i-th of every n runs only, and writes no table: the share of one of n machines.
    """  # fmt: skip
    if part == (1, 1):
        with locked(folder):
            return _sweep(scene, grid, folder, part, is_quiet, store)
    return _sweep(scene, grid, folder, part, is_quiet, store)  # beside other parts


def _sweep(
    scene: Path,
    grid: dict[str, list[str]],
    folder: Path,
    part: tuple[int, int],
    is_quiet: bool,
    store: Store | None,
) -> list[Row]:
    store = store or Store(folder / "runs")
    settings = settings_of(grid)
    share = settings[part[0] - 1 :: part[1]]
    rows: list[Row] = []
    progress, written = Progress(len(share), is_quiet), -_PAUSE
    for values, row in zip(share, each(lambda values: measure(store, scene, values), share), strict=True):
        rows.append(row)
        result = percent(row[_ERROR]) if row["status"] == "ok" else f"{row['status']}: {row['message']}"
        progress.say(f"{' '.join(f'{k}={v}' for k, v in values.items())}: {result}")
        if share == settings and time.monotonic() > written + _PAUSE:
            write_text(folder / "sweep.csv", csv_of(rows))
            written = time.monotonic()
    if share != settings:
        return rows
    records = {
        program: found.record
        for program in ("massspring", "fem_reference")
        if (found := store.find(RunRequest(program, scene, _overrides(scene, settings[0]))))
    }
    write(folder, scene, varied(grid), rows, records)
    return rows


def main(arguments: Any) -> int:
    """./testbed sweep"""
    grid = parse_grid(arguments.overrides)
    if not grid:
        raise RunError("sweep: expected --set KEY=VALUE,VALUE...")
    if arguments.surface:
        grid = {"surface.shape": ['""'], "surface.file": [str(arguments.surface.resolve())], **grid}
    for override in surface_overrides(arguments):
        key, _, value = override.partition("=")
        grid[key] = [value]
    folder = arguments.out or ROOT / "out" / "sweep" / default_folder(arguments.scene, arguments.surface).name
    if arguments.force and arguments.part != (1, 1):
        raise RunError("--force with --part: other parts may be at work, expected one of them")
    if arguments.force:
        forget(folder)
    with engine_of(arguments), reminders("sweep", arguments.quiet):
        rows = sweep(arguments.scene.resolve(), grid, folder, arguments.part, arguments.quiet)
    if arguments.part == (1, 1):
        keys = varied(grid)
        table = text_table(*table_of(keys, rows))
        print(f"{finding(arguments.scene.stem, keys, rows)}\n\n{table}\n\nreport: {folder / 'report.html'}")
    return 0
