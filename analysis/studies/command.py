"""Studies: ./testbed study NAME. Each leaves a report, its tables as CSV and its figures as SVG in one folder."""

from __future__ import annotations

import argparse
import csv
import fcntl
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from .. import machine
from ..paths import PROGRAMS, ROOT, SCENES, write_text
from ..points import Store, say
from ..report import Table, html_table, image_figure, page, svg_figure, text_table
from . import cost, paper, scaling, stability, work_precision

_LOCK = Path(tempfile.gettempdir()) / "testbed-timed-study.lock"


Figures = dict[str, tuple[str | Path, str]]


@dataclass
class Section:
    """A part of a report: sentences, figures (name -> SVG text or picture's file, and caption) and tables by name."""

    title: str
    sentences: list[str] = field(default_factory=list)
    figures: Figures = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)

    def html(self) -> list[str]:
        parts = [f"<h2>{self.title}</h2>", *(f"<p>{sentence}</p>" for sentence in self.sentences)]
        for figure, caption in self.figures.values():
            parts.append(
                svg_figure(figure, caption) if isinstance(figure, str) else image_figure(figure, caption)
            )
        return parts + [html_table(*table) for table in self.tables.values()]


@dataclass
class Result:
    """What a study found."""

    title: str
    sentence: str  #: the finding
    sections: list[Section]
    protocol: dict[str, str]


@contextmanager
def alone(is_quiet: bool = False, lock_file: Path = _LOCK) -> Iterator[None]:
    """Waits until no other timed study runs on this machine, and keeps others waiting."""
    with lock_file.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another timed study runs on this machine: waiting for it to end", is_quiet)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def environment(arguments: argparse.Namespace) -> dict[str, str]:
    """Command, programs, libraries and machine of a study."""
    text = {"command": "./testbed " + " ".join(arguments.words), **machine.describe(PROGRAMS)}
    return {"command, programs and machine": json.dumps(text, indent=2)}


def write(folder: Path, result: Result) -> None:
    """Writes figures, tables and, last, report.html."""
    folder.mkdir(parents=True, exist_ok=True)
    parts: list[str] = []
    for section in result.sections:
        parts += section.html()
        for name, (figure, _) in section.figures.items():
            if isinstance(figure, str):
                write_text(folder / f"{name}.svg", figure)
        for name, (head, rows) in section.tables.items():
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerows([head, *rows])
            write_text(folder / f"{name}.csv", text.getvalue())
    write_text(folder / "report.html", page(result.title, result.sentence, parts, result.protocol))


def text_of(result: Result) -> str:
    """The study for a terminal."""
    parts = [result.sentence]
    for section in result.sections:
        parts.append("\n".join([section.title, *section.sentences]))
        parts += [text_table(*table) for table in section.tables.values()]
    return "\n\n".join(parts)


def study_work_precision(arguments: argparse.Namespace, folder: Path) -> Result:
    """Error against seconds for every method."""
    files = arguments.scenes or [
        SCENES / f"{name}.toml" for name in ("bar_sag", "torus_hang", "bar_bend", "bar_swing")
    ]
    effort = work_precision.QUICK if arguments.quick else work_precision.FULL
    effort = replace(effort, repetitions=arguments.repetitions or effort.repetitions)
    timed, store = Store(folder / "points", arguments.time_limit), Store(folder / "points")
    sections: list[Section] = []
    findings: list[str] = []
    protocol: dict[str, str] = {}
    with alone(arguments.quiet):
        for file in files:
            scene = work_precision.SceneStudy(file.resolve(), effort, timed, store)
            scene.run(arguments.quiet)
            sentences = work_precision.in_words(work_precision.curves_of(scene.measurements))
            findings.append(
                f"{scene.name}: {sentences[0]}" if sentences else f"{scene.name}: no method gave a result."
            )
            figure: Figures = (
                {f"{scene.name}_work_precision": (work_precision.plot(scene), work_precision.CAPTION)}
                if sentences
                else {}
            )
            sentences.append(work_precision.noise(scene.measurements))
            sections.append(Section(scene.name, sentences, figure, {scene.name: work_precision.table(scene)}))
            protocol[f"{scene.name}: the scene, before the ladder's values"] = file.read_text()
    protocol = environment(arguments) | {"how it is measured": work_precision.__doc__ or ""} | protocol
    return Result("Work and precision", " ".join(findings), sections, protocol)


def study_scaling(arguments: argparse.Namespace, folder: Path) -> Result:
    """Seconds, memory and non-zeros over the number of nodes."""
    sizes, repetitions = ([300.0, 1000.0], 2) if arguments.quick else ([1e3, 1e4, 1e5, 2e6], 3)
    repetitions = arguments.repetitions or repetitions
    with alone(arguments.quiet):
        measured = scaling.measure(
            SCENES / "bar_sag.toml", Store(folder / "points", _LARGE), sizes, repetitions, arguments.quiet
        )
    figures: Figures = {
        "scaling_seconds": (
            scaling.plot_seconds(measured),
            "Seconds of every stage on one thread, median; slopes in brackets.",
        ),
        "scaling_memory": (scaling.plot_memory(measured), "Largest resident memory of the whole run."),
        "scaling_lemma_1": (scaling.plot_lemma(measured), "Lemma 1: non-zero blocks of the springs' matrix."),
    }
    section = Section("Every stage", [], figures, {"scaling": scaling.table(measured)})
    protocol = environment(arguments) | {"how it is measured": scaling.__doc__ or ""}
    return Result("Scaling", scaling.finding(measured), [section], protocol)


def study_cost(arguments: argparse.Namespace, folder: Path) -> Result:
    """Instructions of a step, part by part."""
    store = Store(folder / "points")
    costs = cost.measure(folder, store, arguments.quiet)
    figures: Figures = {}
    if cost.shares(costs):
        figures = {"cost": (cost.plot(costs), "What each part adds to a step, counted instructions.")}
    section = Section("Part by part", [], figures, {"cost": cost.table(costs)})
    scene = (folder / "cost.toml").read_text()
    protocol = environment(arguments) | {
        "how it is measured": cost.__doc__ or "",
        "cost.toml: springs alone": scene,
    }
    return Result("What each part costs", cost.finding(costs), [section], protocol)


def study_stability(arguments: argparse.Namespace, folder: Path) -> Result:
    """What becomes of a body let go from bad starts; --quick: explicit Euler alone."""
    n_cells = 210 if arguments.quick else None
    rows = stability.measure(folder, PROGRAMS / "stability", n_cells, arguments.quiet)
    figures: Figures = {"stability": (stability.plot(rows), stability.CAPTION)}
    section = Section("Every scheme", [], figures, {"outcomes": stability.table(rows)})
    protocol = environment(arguments) | {"how it is measured": stability.__doc__ or ""}
    return Result("Stability", stability.finding(rows), [section], protocol)


def study_paper(arguments: argparse.Namespace, folder: Path) -> Result:
    """Table 1 and the figures."""
    repetitions = arguments.repetitions or (2 if arguments.quick else 5)
    with alone(arguments.quiet):
        table = paper.table_1(paper.benchmark(PROGRAMS / "bench_step", folder, repetitions))
    figures: Figures = {
        "figure_7": (paper.figure_7(folder), "Figure 7: the ball before and after PCP."),
        "figure_9": (
            paper.figure_9(),
            "Figure 9: how far a spring collapses in a step, over its distance from the pivot.",
        ),
        "figure_10": (
            paper.figure_10(),
            "Figure 10: time warps: the simulation's time, and its speed, over the film's.",
        ),
    }
    scenes = arguments.scenes or [SCENES / f"{name}.toml" for name in paper.FIGURE_11]
    strips, ended = paper.figure_11(scenes, Store(folder / "points"), folder)
    sections = [Section("Table 1", [], {}, {"table_1": table}), Section("Figures", [], figures)]
    shown: Figures = {name: (file, f"Figure 11: {name}.") for name, file in strips.items()}
    sections.append(
        Section(
            "Figure 11",
            [],
            shown,
            {"figure_11": ended},
        )
    )
    protocol = environment(arguments) | {"how it is measured": paper.__doc__ or ""}
    return Result("The paper's results, rebuilt", paper.finding(table), sections, protocol)


_LARGE = 1800  # s, for one run of a large body
_STUDIES = {
    "work-precision": study_work_precision,
    "stability": study_stability,
    "scaling": study_scaling,
    "cost": study_cost,
    "paper": study_paper,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", choices=_STUDIES)
    parser.add_argument(
        "scenes", nargs="*", type=Path, metavar="SCENE.toml", help="instead of the study's own"
    )
    parser.add_argument("--quick", action="store_true", help="few and small: to try it out")
    parser.add_argument(
        "--repetitions",
        type=int,
        metavar="N",
        help="of every timed run (5; of scaling 3); their median counts",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: out/study/NAME")
    parser.add_argument(
        "--time-limit",
        type=float,
        default=120,
        metavar="SECONDS",
        help="for one timed run (120); what takes longer is a row that says so",
    )


def main(arguments: argparse.Namespace) -> int:
    """./testbed study"""
    arguments.words = sys.argv[1:]
    folder = arguments.out or ROOT / "out" / "study" / arguments.name
    result = _STUDIES[arguments.name](arguments, folder)
    write(folder, result)
    print(f"{text_of(result)}\n\nreport: {folder / 'report.html'}")
    return 0
