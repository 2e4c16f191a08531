"""Survey study: whether bodies that nobody picked end, in both programs, and in what time.

A folder holds closed surfaces. SOURCES names those of the published table by repository, commit, path and hash. They are of
each repository the first ten by path that `meshing check` accepts, of 200 to 20,000 vertices. Each runs under sag.toml and
under a free load, as it is and remeshed, with 60 CPU seconds for a run. Everything is linear, so that a load's size means
nothing. A run is refused where it ends with an error in words within ten seconds, and failed where it ends otherwise. Half of
the bodies, picked by a hash of their files, are there to learn from; --held-out runs the others, too. --count N takes the
first N by that hash, a sample drawn at random. What is finished is kept.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
from collections import defaultdict
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from pathlib import Path

import numpy as np
import pyvista as pv

from ..grid import csv_of
from ..paths import PACKAGE, PROGRAMS, SCENES, write_text
from ..progress import Progress
from ..remesh import read_off, remesh, write_surface
from ..report import Table
from ..run_store import Outcome, RunRequest, Store, each, hash_of_programs
from ..runs import Array, RunError
from ..wording import percent
from .accuracy_loads import scene_of
from .result import Figures, Result, Section

SOURCES = PACKAGE / "survey.csv"
LIMIT = 60  # s of computing, of a run and of remeshing
_WALL = 600.0  # s, of a run that waits for others
_SUFFIXES = (".obj", ".off", ".ply", ".stl")
_PROGRAMS = ("massspring", "fem_reference")
_LOADS = ("sag", "free")
_SAG = ("load_scale.factor=1e-6", 'material.law="small_strain"', 'surface.shape=""')
_ENDS = ("ok", "refused", "failed", "out of time")
_SECONDS = 10.0  # in which a run that ends with an error counts as refused
_FAR = 10  # times as long as the other program

Row = dict[str, str]


@dataclass(frozen=True)
class Case:
    file: Path
    digest: str  #: of the file
    is_remeshed: bool

    @property
    def name(self) -> str:
        return self.digest[:12]

    @property
    def surface(self) -> str:
        return "remeshed" if self.is_remeshed else "as it is"

    @property
    def is_held_out(self) -> bool:
        return int(self.digest[:2], 16) % 2 == 1


def cases(folder: Path, has_held_out: bool, is_quick: bool, count: int | None = None) -> list[Case]:
    """Of the bodies in a folder, by hash, the first `count`. Raises RunError where there is none."""
    files = [file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES]
    if not files:
        raise RunError(
            f"{folder}: no surface, expected files that end in {', '.join(_SUFFIXES)}, as those that {SOURCES} lists"
        )
    of_digest = {sha256(file.read_bytes()).hexdigest(): file for file in files}
    found = [Case(of_digest[digest], digest, is_remeshed=False) for digest in sorted(of_digest)]
    chosen = [case for case in found if has_held_out or not case.is_held_out][:count]
    return chosen if is_quick else chosen + [replace(case, is_remeshed=True) for case in chosen]


class Bench:
    """Surfaces, scenes and runs in a folder."""

    def __init__(self, folder: Path, store: Store | None = None) -> None:
        self.folder = folder
        self.store = store or Store(folder / "runs", time_limit=_WALL)

    def measure(self, case: Case, loads: tuple[str, ...]) -> list[Row]:
        """A row for each program and load. What does not end is a row that says why."""
        place = {"half": "held-out" if case.is_held_out else "development", "body": case.name}
        place["surface"] = case.surface
        try:
            file, X, F = self.surface_of(case)
        except RunError as error:
            failed = {"end": "failed", "message": f"remesh: {str(error).replace(str(case.file), 'FILE')}"}
            return [
                {**place, "program": program, "load": load, **failed}
                for program in _PROGRAMS
                for load in loads
            ]
        rows = []
        for load in loads:
            scene: Path = SCENES / "sag.toml"
            overrides: tuple[str, ...] = (*_SAG, f"surface.file={file}")
            if load == "free":
                scene, overrides = file.with_suffix(".toml"), ("network.estimate=true",)
                write_text(scene, scene_of("gravity", case.name, file, X, F))
            for program in _PROGRAMS:
                options = ("--no-diagnostics",) if program == "massspring" else ()
                limit = ("prlimit", f"--cpu={LIMIT}")
                outcome = self.store.run(RunRequest(program, scene, overrides, options, limit))
                rows.append({**place, "program": program, "load": load, **row_of(outcome)})
        return rows

    def surface_of(self, case: Case) -> tuple[Path, Array, Array]:
        """File, points and triangles of a body whose longest side is 1 m. Raises RunError where it cannot be remeshed."""
        folder = self.folder / f"surfaces-{hash_of_programs(PROGRAMS)}"
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{case.name}{'-remeshed' * case.is_remeshed}.off"
        refused = file.with_suffix(".txt")
        if refused.exists():
            raise RunError(refused.read_text())
        if not file.exists():
            part = file.with_suffix(".part.off")
            try:
                if case.is_remeshed:
                    remesh(case.file, part, limit=LIMIT)
                else:
                    command = [str(PROGRAMS / "meshing"), "repair", str(case.file), str(part)]
                    subprocess.run(command, check=False, capture_output=True)
                X, F = read_off(part)
            except RunError as error:
                write_text(refused, str(error))
                raise
            low, high = X.min(axis=0), X.max(axis=0)
            write_surface(part, (X - (low + high) / 2) / (high - low).max(), F)
            part.rename(file)
        return file, *read_off(file)


def row_of(outcome: Outcome) -> Row:
    """How a run has ended and what it took."""
    row = {"end": end_of(outcome), "seconds": f"{outcome.cpu:.3g}", "message": ""}
    if row["end"] != "ok":
        row["message"] = ": ".join(word for word in (outcome.status, outcome.message) if word)
    record = outcome.record
    for key in ("n_cut", "n_nodes"):
        row[key] = str(record.get(key, ""))
    ratio = record.get("tetrahedra", {}).get("min_radius_ratio")
    row["min_radius_ratio"] = "" if ratio is None else f"{ratio:.2g}"
    row["estimate"] = row["price"] = ""
    if "estimated_error" in record:
        row["estimate"] = f"{record['estimated_error']:.5g}"
        row["price"] = f"{record['seconds']['estimate'] / record['seconds']['solve']:.3g}"
    if row["end"] == "ok":
        with (outcome.folder / "curves.csv").open(newline="") as lines:
            *_, last = csv.DictReader(lines)
        row["displacement"] = last["max_displacement"]
    return row


def end_of(outcome: Outcome) -> str:
    if outcome.status == "ok" and outcome.cpu <= LIMIT:
        return "ok"
    if outcome.status == "time limit" or outcome.cpu >= LIMIT:
        return "out of time"
    is_told = outcome.status == "failed" and not outcome.message.startswith("exit status")
    return "refused" if is_told and outcome.cpu <= _SECONDS else "failed"


def table(rows: list[Row], keys: list[str]) -> Table:
    """A line for each group of equal keys: how its runs ended, and seconds and estimates of those that are ok."""
    head = [
        *keys,
        "runs",
        *_ENDS,
        "share ok",
        "of all such",
        "median s",
        "90 % s",
        "worst s",
        "worst estimate",
        "far slower",
    ]
    groups: dict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[tuple(row[key] for key in keys)].append(row)
    slower = far_slower(rows)
    lines = []
    for group, of in sorted(groups.items()):
        ends = [row["end"] for row in of]
        good = [row for row in of if row["end"] == "ok"]
        seconds = [float(row["seconds"]) for row in good]
        estimates = [float(row["estimate"]) for row in good if row["estimate"]]
        line = [*group, str(len(of)), *(str(ends.count(end)) for end in _ENDS), percent(len(good) / len(of))]
        line.append(" to ".join(percent(part, 2) for part in interval(len(good), len(of))))
        line += [f"{np.quantile(seconds, part):.2g}" if seconds else "-" for part in (0.5, 0.9, 1)]
        line.append(percent(max(estimates), 2) if estimates else "-")
        lines.append([*line, str(sum(row in slower for row in of))])
    return head, lines


def interval(n_good: int, n: int) -> tuple[float, float]:
    """In which a share lies by 95 %, of which n drawn at random have shown n_good [Wilson 1927]."""
    z = 1.959964
    middle = (n_good + z * z / 2) / (n + z * z)
    half = z / (n + z * z) * np.sqrt(n_good * (n - n_good) / n + z * z / 4)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def table_of_agreement(rows: list[Row]) -> Table:
    """By how much the springs' largest displacement differs from the elements', with an estimate of theirs and without; the
    estimate's seconds over the solve's."""
    head = [
        "load",
        "springs' estimate",
        "surfaces",
        "within 10 %",
        "median",
        "90 %",
        "largest",
        "price",
        "price, 90 %",
    ]
    good = {_place_of(row, row["program"]): row for row in rows if row["end"] == "ok"}
    pairs: dict[tuple[str, str], list[tuple[Row, Row]]] = defaultdict(list)
    for place, row in good.items():
        elements = good.get((*place[:-1], "fem_reference"))
        if row["program"] == "massspring" and elements:
            pairs[row["load"], _kind_of(row["estimate"])].append((row, elements))
    lines = []
    for group in product(_LOADS, ("up to 10 %", "above 10 %", "none")):
        if of := pairs[group]:
            apart = [
                abs(float(springs["displacement"]) / float(elements["displacement"]) - 1)
                for springs, elements in of
            ]
            parts = (percent(float(np.quantile(apart, part)), 2) for part in (0.5, 0.9, 1))
            line = [*group, str(len(of)), str(sum(part <= 0.1 for part in apart)), *parts]
            prices = [float(springs["price"]) for springs, _ in of if springs["price"]]
            lines.append(
                line + [f"{np.quantile(prices, part):.2g}" if prices else "-" for part in (0.5, 0.9)]
            )
    return head, lines


def _kind_of(estimate: str) -> str:
    if not estimate:
        return "none"
    return "up to 10 %" if float(estimate) <= 0.1 else "above 10 %"


def far_slower(rows: list[Row]) -> list[Row]:
    """Runs out of time, or that take ten times as long, where the other program is ok on the same surface and load."""
    ok = {_place_of(row, row["program"]): float(row["seconds"]) for row in rows if row["end"] == "ok"}
    found = []
    for row in rows:
        (other,) = (program for program in _PROGRAMS if program != row["program"])
        quick = ok.get(_place_of(row, other))
        own = float(row.get("seconds") or 0)
        if quick is not None and quick <= LIMIT / _FAR and own >= _FAR * quick and own >= LIMIT / _FAR:
            found.append(row)
    return found


def _place_of(row: Row, program: str) -> tuple[str, ...]:
    return row["body"], row["surface"], row["load"], program


def table_of_failures(rows: list[Row], sources: dict[str, Row]) -> Table:
    """What is not ok, with where its body comes from: a line for runs on one surface that end alike, their most seconds.

    FILE is the surface, SCENE.toml its free load, and no folder is told.
    """
    alike: dict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows:
        if row["end"] != "ok":
            said = re.sub(rf"\S*/{row['body']}\S*?\.off", "FILE", row["message"])
            said = re.sub(rf"\S*/{row['body']}\S*?\.toml", "SCENE.toml", said)
            said = re.sub(r"(?<!\S)/\S*/", "", said)
            alike[row["body"], row["surface"], row["end"], said].append(row)
    lines = []
    for (body, surface, end, said), of in alike.items():
        source = sources.get(body)
        origin = f"{source['repository']}: {source['path']}" if source else "-"
        loads: dict[str, list[str]] = defaultdict(list)
        for row in of:
            loads[row["program"]].append(row["load"])
        runs = "; ".join(f"{program} {', '.join(under)}" for program, under in loads.items())
        took = [float(row["seconds"]) for row in of if "seconds" in row]
        lines.append([body, origin, surface, runs, end, f"{max(took):.2g}" if took else "-", said])
    return ["body", "from", "surface", "runs", "end", "most s", "message"], lines


def pictures_of_failures(rows: list[Row], bench: Bench, wanted: list[Case]) -> Figures:
    """Triangles of each body, as it is, of which a run is not ok."""
    failed = {row["body"] for row in rows if row["end"] != "ok"}
    figures: Figures = {}
    for case in wanted:
        if case.name in failed and not case.is_remeshed:
            try:
                _, X, F = bench.surface_of(case)
            except RunError:  # there is none to be drawn
                continue
            file = bench.folder / f"{case.name}.png"
            plotter = pv.Plotter(off_screen=True, window_size=[600, 450])
            plotter.add_mesh(pv.PolyData.from_regular_faces(X, F), color="lightgrey", show_edges=True)
            plotter.screenshot(file)
            plotter.close()
            figures[case.name] = (file, f"{case.name}, its {len(F)} triangles")
    return figures


def read_sources() -> dict[str, Row]:
    """Of each body by its name in tables, where it comes from."""
    with SOURCES.open(newline="") as lines:
        return {row["sha256"][:12]: row for row in csv.DictReader(lines)}


def finding(rows: list[Row]) -> str:
    """The study in one sentence."""
    default = [row for row in rows if row["surface"] == "as it is"]
    good = sum(row["end"] == "ok" for row in default)
    return (
        f"Of {len({row['body'] for row in rows})} bodies as they are, {percent(good / len(default), 2)} of "
        f"{len(default)} runs end ok."
    )


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: sag.toml alone, on the surfaces as they are."""
    if not arguments.bodies:
        raise RunError("study survey: expected --bodies DIR, a folder of closed surfaces")
    bench = Bench(folder)
    wanted = cases(arguments.bodies.resolve(), arguments.held_out, arguments.quick, arguments.count)
    loads = _LOADS[:1] if arguments.quick else _LOADS
    sources = read_sources()
    rows: list[Row] = []
    progress = Progress(len(wanted), arguments.quiet)
    for case, found in zip(wanted, each(lambda case: bench.measure(case, loads), wanted), strict=True):
        rows += [{**row, "kind": sources.get(case.name, {}).get("kind", "")} for row in found]
        progress.say(f"{case.name}, {case.surface}: {', '.join(row['end'] for row in found)}")
        write_text(folder / "rows.csv", csv_of(rows))
    sections = sections_of(rows, sources)
    sections[-1].figures = pictures_of_failures(rows, bench, wanted)
    return Result("A survey of bodies that nobody picked", finding(rows), sections)


def sections_of(rows: list[Row], sources: dict[str, Row]) -> list[Section]:
    tables = {
        "ends": table(rows, ["half", "surface", "load", "program"]),
        "kinds": table(rows, ["half", "kind", "program"]),
    }
    failures = table_of_failures(rows, sources)
    return [
        Section("How runs end", [_HOW], {}, tables),
        Section("Whether the programs agree", [_AGREE], {}, {"agreement": table_of_agreement(rows)}),
        Section("What does not end ok", [], {}, {"failures": failures}),
    ]


_AGREE = (
    "Where both programs end ok, the largest displacement of the springs is compared with that of quadratic elements of the same "
    "body, by the error that the springs expect of themselves. The price is the seconds of the estimate over those of the solve."
)

_HOW = (
    "A run is refused where it ends with an error in words within ten seconds. Seconds are of computing, children's included. "
    "One is far slower where it takes ten times what the other program does, and more than 6 s. "
    "Bodies are drawn at random, so that the share of all such bodies lies in the interval beside it by 95 % [Wilson 1927]."
)
