"""Accuracy study: bodies and loads drawn at random, springs beside finite elements, against refined quadratic elements.

Each body of bodies.py bears one load while it is free and one while a part of it is held, at two Poisson's ratios. The
reference of all methods is quadratic elements on the surface as every method cuts it, refined: triangles are cut further
where supports end, and tetrahedra split in eight. The reference's own error is estimated from what the split changed, as if
it were of first order. Errors are relative, of the surface's displacement in the L2 norm. Half of the bodies are for
development; --held-out measures the others instead. The exact fields are those of build/bin/accuracy, on the bodies of even
triangles. What is finished is kept, and published in ACCURACY.md.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import pyvista as pv
from matplotlib.figure import Figure

from ..compare import displacement_error, free_motions
from ..drawing.style import number_logarithmic, style_of, svg_of
from ..grid import csv_of
from ..methods import FEM_P2, label_of
from ..paths import PACKAGE, PROGRAMS, write_text
from ..progress import Progress
from ..report import Table
from ..run_store import RunRequest, Store, each
from ..runs import Run, RunError, load_run
from ..surface_points import on_points_of
from ..wording import percent
from .accuracy_loads import CUTTABLE, FREE, HELD, of_cut_surface, scene_of
from .bodies import Body, bodies, random_of, save, write_body
from .result import Result, Section

PAGE, DATA = PACKAGE / "ACCURACY.md", PACKAGE / "accuracy.csv"
SPRINGS, LINEAR = "node_averaged", "edge_coupled"  # the latter are linear elements on the same nodes
UNCUT = "node_averaged, uncut"  #: on the surface's triangles as they are
EQUAL = "node_averaged, equal nodes"  #: as many on the surface as the quadratic elements have
_UNCUT = "surface.across=0"
RATIOS = ("0.25", "0.45")  # Poisson's
EXACT = "exact field"
_PATCH_FIELDS = {"pressure", "uniaxial", "shear"}  # linear elements are exact
_EXACT_MODELS = (
    "uniform",
    "affine",
    "van_gelder",
    "lloyd",
    LINEAR,
    SPRINGS,
)  # the first two on completed PCP
_DECIDED = 3  # times the refined reference's own error
_AT_SUPPORTS = "surface.at_supports=2"  # of the reference
_TOLERANCE = "time.residual=1e-9"

Row = dict[str, str]


@dataclass(frozen=True)
class Case:
    body: Body
    load: str
    nu: str

    @property
    def kind(self) -> str:
        return "held" if self.load in HELD else "free"

    @property
    def name(self) -> str:
        return f"{self.body.name}, {self.load}, nu = {self.nu}"


def cases() -> list[Case]:
    """In an order that a hash draws, so that what is there of an unfinished study is a sample of all."""
    found = []
    for body in bodies():
        random = random_of(f"loads of {body.name}")
        loads = [random.choice(FREE), random.choice(HELD)]
        found += [Case(body, str(load), nu) for load in loads for nu in RATIOS]
    found.sort(key=lambda case: random_of(case.body.name).random())
    return found


def cases_of_half(is_held_out: bool, is_quick: bool = False) -> list[Case]:
    """Cases of a half of the bodies, or four of them."""
    found = [case for case in cases() if case.body.is_held_out == is_held_out]
    return [case for case in found if case.body.triangulation == "cad"][:4] if is_quick else found


class Bench:
    """Bodies, scenes and runs in a folder."""

    def __init__(self, folder: Path, store: Store | None = None) -> None:
        self.folder = folder
        self.store = store or Store(folder / "runs", time_limit=900)
        (folder / "scenes").mkdir(parents=True, exist_ok=True)

    def run(self, program: str, scene: Path, nu: str, *overrides: str) -> Run:
        """Raises RunError for a run that is not ok."""
        options = ("--no-diagnostics",) if program == "massspring" else ()
        outcome = self.store.run(RunRequest(program, scene, (f"material.nu={nu}", *overrides), options))
        if outcome.status != "ok":
            words = (program, outcome.status, outcome.message)
            raise RunError(": ".join(word for word in words if word))
        return load_run(outcome.folder)

    def elements(self, scene: Path, nu: str, refine: int, *overrides: str) -> Run:
        return self.run("fem_reference", scene, nu, f"reference.refine={refine}", _TOLERANCE, *overrides)

    def references(self, scene: Path, case: Case) -> tuple[Run, Run]:
        """The finest, and the one before, on the vertices of the surface as all methods cut it."""
        methods = self.elements(scene, case.nu, 0)
        finer = (_AT_SUPPORTS,) if case.kind == "held" else ()
        finest, before = (self.elements(scene, case.nu, refine, *finer) for refine in (1, 0))
        return on_points_of(finest, methods), on_points_of(before, methods)

    def scenes(self, case: Case) -> tuple[Path, Path | None]:
        """Files of the scene, and of the same on triangles cut in four."""
        surface = write_body(case.body, self.folder / "bodies")
        mesh = pv.read(surface)
        X, F = mesh.points.astype(float), mesh.regular_faces
        name = f"{case.body.name}-{case.load}"
        scene, cut = (self.folder / "scenes" / f"{name}{end}.toml" for end in ("", "-cut"))
        text = scene_of(case.load, name, surface, X, F)
        write_text(scene, text)
        if case.load not in CUTTABLE:
            return scene, None
        cut_surface = surface.with_name(f"{case.body.name}-cut.ply")
        text, *finer = of_cut_surface(text, cut_surface, X, F)
        save(pv.PolyData.from_regular_faces(*finer), cut_surface)
        write_text(cut, text)
        return scene, cut

    def measure(self, case: Case) -> list[Row]:
        """A row for each method. What fails is a row that says why."""
        scene, cut = self.scenes(case)
        runs: dict[str, Callable[[], Run]] = {
            SPRINGS: lambda: self.run("massspring", scene, case.nu, f"network.calibration={SPRINGS}"),
            UNCUT: lambda: self.run("massspring", scene, case.nu, f"network.calibration={SPRINGS}", _UNCUT),
            LINEAR: lambda: self.run("massspring", scene, case.nu, f"network.calibration={LINEAR}"),
            FEM_P2: lambda: self.elements(scene, case.nu, 0),
        }
        if cut:
            runs[EQUAL] = lambda: self.run(
                "massspring", cut, case.nu, f"network.calibration={SPRINGS}", _UNCUT
            )
        row = _row_of(case.body, case.kind, case.load, case.nu)
        try:
            finest, before = self.references(scene, case)
        except RunError as error:
            return [{**row, "method": method, "status": str(error)} for method in runs]
        own = error_of(before, finest)
        rows = []
        for method, run in runs.items():
            try:
                found = run()
            except RunError as error:
                rows.append({**row, "method": method, "status": str(error)})
                continue
            figures = {"n_nodes": str(found.record["n_nodes"]), "error": f"{error_of(found, finest):.5g}"}
            rows.append({**row, "method": method, "status": "ok", **figures, "reference_error": f"{own:.5g}"})
        return rows


def error_of(run: Run, reference: Run) -> float:
    """Over the vertices of the refined reference's surface as it was cut."""
    seen, end = on_points_of(run, reference).last, reference.last
    return displacement_error(end.X, end.F, seen.u, end.u, free_motions(reference.record)).l2


def exact_rows(folder: Path, of: list[Body]) -> list[Row]:
    """Spring models against exact fields. Raises RunError when the program fails."""
    table = folder / "exact_fields.csv"
    files = {write_body(body, folder / "bodies"): body for body in of}
    body_of = {file.name: body for file, body in files.items()}
    # The program dies with this process, so that a killed study leaves nobody working.
    command = ["setpriv", "--pdeathsig", "KILL", str(PROGRAMS / "accuracy"), "--out", str(table)]
    command += ["--surface", *map(str, files), "--nu", *RATIOS, "--model", *_EXACT_MODELS]
    if subprocess.run(command, check=False).returncode != 0:
        raise RunError("the accuracy program failed; its message stands above")
    rows = []
    with table.open(newline="") as lines:
        for found in csv.DictReader(lines):
            body = body_of.get(found["surface"])
            if body and found["load"] not in _PATCH_FIELDS:
                row = _row_of(body, EXACT, found["load"], found["nu"])
                figures = {"n_nodes": found["n_nodes"], "error": found["error_l2"], "reference_error": "0"}
                rows.append({**row, "method": found["model"], "status": found["status"], **figures})
    return rows


def _row_of(body: Body, kind: str, load: str, nu: str) -> Row:
    half = "held-out" if body.is_held_out else "development"
    place = {"half": half, "body": f"{body.family}-{body.seed}", "triangles": body.triangulation}
    return {**place, "kind": kind, "load": load, "nu": nu}


def place_of(row: Row) -> tuple[str, ...]:
    """What a row has in common with those of other methods."""
    return tuple(row[key] for key in ("half", "body", "triangles", "kind", "load", "nu"))


def ratios(rows: list[Row], method: str, to: str) -> list[float]:
    """Errors of a method over those of another in the same cases, where both have any."""
    errors = {(place_of(row), row["method"]): float(row["error"]) for row in rows if row["status"] == "ok"}
    return [
        error / errors[place, to]
        for (place, name), error in errors.items()
        if name == method and errors.get((place, to), 0) > 0
    ]


def errors_of(rows: list[Row], method: str) -> list[float]:
    return [float(row["error"]) for row in rows if row["method"] == method and row["status"] == "ok"]


def _grouped(rows: list[Row], keys: list[str]) -> dict[tuple[str, ...], list[Row]]:
    groups: dict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[tuple(row[key] for key in keys)].append(row)
    return dict(sorted(groups.items()))


def table(rows: list[Row], keys: list[str]) -> Table:
    """A line for each group of equal keys: the springs' errors, over linear and over quadratic elements' and their own."""
    head = [
        *keys,
        "cases",
        "no result",
        "undecided",
        "median",
        "worst",
        "<= 1/3",
        "own error",
        "uncut",
        "linear",
        "quadratic",
    ]
    lines = []
    for group, of in _grouped(rows, keys).items():
        found = ratios(of, SPRINGS, LINEAR)
        # Without a refined reference it is all methods that have none.
        n_failed = len({place_of(row) for row in of if row["status"] != "ok"})
        n_near = sum(_is_undecided(row) for row in of if row["method"] == SPRINGS)
        lines.append([*group, str(len(found)), str(n_failed), str(n_near)])
        if found:
            lines[-1] += [
                f"{median(found):.2f}",
                f"{max(found):.2f}",
                percent(float(np.mean(np.array(found) <= 1 / 3)), 2),
            ]
        own = (errors_of(of, method) for method in (SPRINGS, UNCUT, LINEAR, FEM_P2))
        lines[-1] += [percent(median(errors), 2) if errors else "-" for errors in own]
    return head, [line + ["-"] * (len(head) - len(line)) for line in lines]


def _is_undecided(row: Row) -> bool:
    return row["status"] == "ok" and float(row["error"]) < _DECIDED * float(row["reference_error"])


def table_of_equal_nodes(rows: list[Row]) -> Table:
    """Springs on triangles cut in four over quadratic elements, whose nodes on the surface are as many."""
    head = ["half", "kind", "nu", "cases", "over quadratic", "worst", "on the same surface", "own error"]
    lines = []
    for group, of in _grouped(rows, head[:3]).items():
        if found := ratios(of, EQUAL, FEM_P2):
            cut = {place_of(row) for row in of if row["method"] == EQUAL}
            same = ratios([row for row in of if place_of(row) in cut], UNCUT, FEM_P2)
            numbers = [f"{value:.2f}" for value in (median(found), max(found), median(same))]
            lines.append([*group, str(len(found)), *numbers, percent(median(errors_of(of, EQUAL)), 2)])
    return head, lines


def table_of_models(rows: list[Row]) -> Table:
    """Every spring model against exact fields: error over linear elements', and its own."""
    head = ["half", "model", "nu", "cases", "no result", "median", "worst", "own error"]
    lines = []
    for (half, model, nu), of in _grouped(
        [r for r in rows if r["kind"] == EXACT], ["half", "method", "nu"]
    ).items():
        group = [r for r in rows if r["kind"] == EXACT and (r["half"], r["nu"]) == (half, nu)]
        found = ratios(group, model, LINEAR)
        failed = sum(row["status"] != "ok" for row in of)
        numbers = [f"{median(found):.2f}", f"{max(found):.2f}"] if found else ["-", "-"]
        own = errors_of(of, model)
        lines.append(
            [
                half,
                model,
                nu,
                str(len(found)),
                str(failed),
                *numbers,
                percent(median(own), 2) if own else "-",
            ]
        )
    return head, lines


def finding(rows: list[Row]) -> str:
    """The study in one sentence."""
    words = []
    for (nu,), of in _grouped([row for row in rows if row["kind"] != EXACT], ["nu"]).items():
        if found := ratios(of, SPRINGS, LINEAR):
            words.append(f"{median(found):.2g} at nu = {nu}")
    return f"Error of {SPRINGS} over that of linear elements on the same nodes, in the median: {', '.join(words)}."


def against_quadratic(rows: list[Row]) -> str:
    """Where quadratic elements stay ahead of springs on the same surface, and by how much, in one sentence."""
    words = []
    for kind, name in (("free", "under free loads"), ("held", "where supports hold the body")):
        if found := ratios([row for row in rows if row["kind"] == kind], FEM_P2, SPRINGS):
            words.append(f"{median(found):.2g} {name}")
    return f"Error of quadratic elements over that of {SPRINGS} on the same surface, in the median: {', '.join(words)}."


def measured(rows: list[Row]) -> str:
    """How many of a half's cases there are so far."""
    places = {place_of(row) for row in rows if row["kind"] != EXACT}
    words = []
    for half, is_held_out in (("development", False), ("held-out", True)):
        n_all = len(cases_of_half(is_held_out))
        name = half.replace(" ", "-")
        words.append(f"{sum(place[0] == half for place in places)} of {n_all} {name} cases")
    return f"{' and '.join(words)} have been measured, in an order drawn at random."


def plot_ratios(rows: list[Row]) -> str:
    """Share of cases whose error over that of linear elements stays below a value."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    for kind, line in (("free", "-"), ("held", "--")):
        for method in (SPRINGS, FEM_P2):
            values = sorted(ratios([row for row in rows if row["kind"] == kind], method, LINEAR))
            if not values:
                continue
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axis.semilogx(
                values, share, line, color=style_of(method).colour, label=f"{label_of(method)}, {kind}"
            )
    axis.axvline(1, color=style_of(LINEAR).colour, label="linear finite elements")
    axis.set_xscale("log")
    axis.set_ylim(0, 100)
    axis.set_xlabel("error over that of linear finite elements on the same nodes")
    axis.set_ylabel("cases below (%)")
    number_logarithmic(axis.xaxis)
    figure.legend(fontsize=8, loc="outside upper left", ncols=2)
    return svg_of(figure)


def sections_of(rows: list[Row]) -> list[Section]:
    loads = [row for row in rows if row["kind"] != EXACT]
    even = [row for row in loads if row["triangles"] == "even"]
    return [
        Section(
            "Bodies and loads drawn at random",
            [_LOADS],
            {},
            {"loads": table(loads, ["half", "kind", "nu"])},
        ),
        Section(
            "By load and triangles",
            [],
            {},
            {f"by_{key}": table(loads, ["half", key, "nu"]) for key in ("load", "triangles")},
        ),
        Section("Equal nodes", [_EQUAL], {}, {"equal_nodes": table_of_equal_nodes(even)}),
        Section("Exact fields", [_MODELS], {}, {"exact": table_of_models(rows)}),
    ]


_LOADS = (
    "Errors of `node_averaged` over those of linear elements on the same nodes. "
    "All cut the surface's triangles where fewer than `surface.across` = 1 edges fit across the body. "
    "The last four columns are median errors: of springs, of springs on uncut triangles, of linear and of quadratic elements. "
    "A case is undecided where the error is less than three times the refined reference's own; it counts in the other columns."
)
_EQUAL = (
    "Springs on triangles that are cut flat in four have as many nodes on the surface as quadratic elements. "
    "The bodies are those of even triangles, of which few are cut for their thickness. "
    "Each median is of the springs' error over the quadratic elements'."
)
_MODELS = (
    "Bending, torsion and a cubic harmonic, of every spring model, over linear elements on the same nodes."
)
_HEAD = """# Accuracy

{finding} {against_quadratic} {measured}

`./testbed study accuracy` measures the development half of the bodies and writes this page and
[its rows](accuracy.csv); with `--held-out` it measures the other half. How it measures stands at the head of
[the study](studies/accuracy.py).
"""
_REFERENCES = """## References

- [Maxwell 1870] On reciprocal figures, frames, and diagrams of forces.
- [Radon 1948] Zur mechanischen Kubatur.
- [Valette & Chassery 2004] Approximated centroidal Voronoi diagrams for uniform polygonal mesh coarsening.
"""


def publish(rows: list[Row]) -> None:
    """Writes rows and page; rows of a half that has not been measured stay."""
    halves = {row["half"] for row in rows}
    if DATA.exists():
        rows = [row for row in read_rows() if row["half"] not in halves] + rows
    write_text(DATA, csv_of(rows))
    write_page(rows)


def read_rows() -> list[Row]:
    with DATA.open(newline="") as lines:
        return list(csv.DictReader(lines))


def write_page(rows: list[Row]) -> None:
    words = {"against_quadratic": against_quadratic(rows), "measured": measured(rows)}
    parts = [_HEAD.format(finding=finding(rows), **words)]
    for section in sections_of(rows):
        parts.append("\n\n".join([f"## {section.title}", *section.sentences]) + "\n")
        parts += [_markdown(*table) for table in section.tables.values()]
    parts.append(_REFERENCES)
    write_text(PAGE, "\n".join(parts))


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)) + "\n"


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: four cases, a minute, and nothing is published."""
    bench = Bench(folder)
    wanted = cases_of_half(arguments.held_out, arguments.quick)
    rows: list[Row] = []
    progress = Progress(len(wanted), arguments.quiet)
    for case, found in zip(wanted, each(bench.measure, wanted), strict=True):
        rows += found
        progress.say(case.name)
        write_text(folder / "rows.csv", csv_of(rows))
    of_fields = {
        case.body: None
        for case in wanted
        if case.body.triangulation == ("cad" if arguments.quick else "even")
    }
    rows += exact_rows(folder, list(of_fields))
    if not arguments.quick:
        publish(rows)
    sections = sections_of(rows)
    caption = "Cases whose error over that of linear elements stays below a value."
    sections[0].figures = {"ratios": (plot_ratios(rows), caption)}
    return Result("Accuracy of the spring models", finding(rows), sections)
