"""What a study gives: a report, its tables as CSV and its figures as SVG in one folder."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from .. import machine
from ..paths import PROGRAMS, write_text
from ..progress import say
from ..report import Table, csv_table, html_table, image_figure, page, svg_figure, text_table
from ..run_store import is_of_one_machine

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
    protocol: dict[str, str] = field(
        default_factory=dict
    )  #: name -> text of what the study alone needs to be repeated


@contextmanager
def alone(is_quiet: bool = False, lock_file: Path = machine.LOCK) -> Iterator[None]:
    """Waits until no other timed study runs on this machine, and keeps others waiting; of a cluster that is the engine's."""
    if not is_of_one_machine():
        yield
        return
    with lock_file.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another timed study runs on this machine: waiting for it to end", is_quiet)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def protocol_of(words: Sequence[str], method: str | None) -> dict[str, str]:
    """What every study needs to be repeated: the words of its command, programs, libraries and machine, and its method."""
    text = {"command": " ".join(["./testbed", *words]), **machine.describe(PROGRAMS)}
    return {"command, programs and machine": json.dumps(text, indent=2), "how it is measured": method or ""}


def write(folder: Path, result: Result, protocol: dict[str, str]) -> None:
    """Writes figures, tables and, last, report.html. protocol: of every study, before the result's own."""
    folder.mkdir(parents=True, exist_ok=True)
    parts: list[str] = []
    for section in result.sections:
        parts += section.html()
        for name, (figure, _) in section.figures.items():
            if isinstance(figure, str):
                write_text(folder / f"{name}.svg", figure)
        for name, table in section.tables.items():
            write_text(folder / f"{name}.csv", csv_table(*table))
    write_text(folder / "report.html", page(result.title, result.sentence, parts, protocol | result.protocol))


def text_of(result: Result) -> str:
    """The study for a terminal."""
    parts = [result.sentence]
    for section in result.sections:
        parts.append("\n".join([section.title, *section.sentences]))
        parts += [text_table(*table) for table in section.tables.values()]
    return "\n\n".join(parts)
