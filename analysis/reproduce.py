"""./testbed reproduce: every published table and figure made again by its command, and what differs from the stored one.

manifest.toml lists them. A table of runs is made cell by cell from the runs' comparison.json; a study leaves its tables as CSV
and its figures, which are taken over. What is written to a page is written to published/, too: these are the stored figures, and
a test compares the page with them. reproduced.json tells of what commit and machine they are. Rows of bodies that are not on
this machine are left out, and it is said beforehand where these are found.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .cluster import engine_of
from .comparison import compare, without_nan
from .experiment import run_solvers
from .folder_lock import locked
from .machine import describe
from .outputs import forget
from .paths import MESHES, OUT, PACKAGE, PROGRAMS, ROOT, SCENES, write_text
from .progress import Progress, reminders, say
from .report import Table, csv_table
from .reproduction import Compared, compare_files, compare_tables, keep, write_report
from .run_store import Store, each
from .runs import RunError
from .wording import percent

MANIFEST, STORED, PUBLISHED = PACKAGE / "manifest.toml", PACKAGE / "reproduced.json", PACKAGE / "published"
_ROUNDING = 1e-8
_TIME_LIMIT = 200.0  # s, of a reference that is refined for its error, where a table shows that
_NAME = re.compile(r"(?<![\w/-])([a-z_]+\.toml|[a-z]+(_[a-z]+)+)")


@dataclass(frozen=True)
class Entry:
    """A table or figures of a page, by the manifest."""

    name: str
    page: str  #: from the project's root
    heading: str  #: of the section
    minutes: float  #: on two cores
    tables: tuple[int, ...] = ()  #: which of the section's tables; none: figures alone
    tolerance: float = 0.1  #: of a number, relative
    head: tuple[str, ...] = ()  #: of a table of runs: what its columns are called
    columns: tuple[str, ...] = ()  #: keys of comparison.json; of a study's table its columns, or all of them
    rows: tuple[
        dict[str, Any], ...
    ] = ()  #: of a table of runs: label (the first columns), scene, set, surface
    command: str = ""  #: of others
    sources: tuple[
        str, ...
    ] = ()  #: CSV that the command leaves, one for each table; none: it writes the page itself
    figures: dict[str, str] = field(default_factory=dict)  #: published file -> file of the command


def entries() -> dict[str, Entry]:
    """Of the manifest, by name."""
    listed = tomllib.loads(MANIFEST.read_text())
    return {
        name: Entry(
            name,
            **entry
            | {key: tuple(entry.get(key, ())) for key in ("tables", "head", "columns", "rows", "sources")},
        )
        for name, entry in listed.items()
        if name not in ("schemes", "meshes")
    }


def missing_meshes(chosen: Iterable[Entry]) -> dict[str, str]:
    """File -> where it is found, of the bodies that rows need and that are not on this machine, or are other files."""
    wanted = {row["surface"] for entry in chosen for row in entry.rows if "surface" in row}
    meshes = tomllib.loads(MANIFEST.read_text())["meshes"]
    return {
        name: f"{file} of https://github.com/{repository} at commit {commit}, SHA-256 {digest}"
        for name, (repository, commit, file, digest) in meshes.items()
        if name in wanted and _digest_of(MESHES / name) != digest
    }


def _digest_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else ""


def tables_of(page: str, heading: str) -> list[tuple[int, Table]]:
    """Of a section: the line at which each table begins, its head and its rows, without the marks of code."""
    lines = page.splitlines()
    found: list[tuple[int, Table]] = []
    here = False
    for number, line in enumerate(lines):
        if line.startswith("#"):
            here = line.lstrip("# ") == heading
        elif here and re.fullmatch(r"\|[-| :]+\|", line):
            end = next((n for n in range(number, len(lines)) if not lines[n].startswith("|")), len(lines))
            found.append(
                (number - 1, (_cells(lines[number - 1]), [_cells(row) for row in lines[number + 1 : end]]))
            )
    return found


def _cells(line: str) -> list[str]:
    return [
        cell.strip().replace("`", "") for cell in line.strip().removeprefix("|").removesuffix("|").split("|")
    ]


def on_page(entry: Entry, number: int, text: str = "") -> Table:
    """A table as it stands on its page, or in a text of that. Raises RunError where the section has fewer."""
    tables = tables_of(text or (ROOT / entry.page).read_text(), entry.heading)
    if len(tables) < number:
        raise RunError(f"{entry.page}: '{entry.heading}' has {len(tables)} tables, expected {number}")
    return tables[number - 1][1]


def stored_file(entry: Entry, number: int) -> Path:
    """Where the figures of a table lie that its command has left."""
    return PUBLISHED / f"{entry.name}_{number}.csv"


def read_table(file: Path, columns: tuple[str, ...] = ()) -> Table:
    """Of a CSV file: these columns, or all that have a name or a cell, without the marks of code.

    Raises RunError where there is no column of a name.
    """
    head, *rows = csv.reader(file.read_text().replace("`", "").splitlines())
    if missing := [column for column in columns if column not in head]:
        raise RunError(f"{file}: no column '{missing[0]}', expected one of {', '.join(head)}")
    kept = [head.index(column) for column in columns] or [
        n for n, name in enumerate(head) if name or any(row[n] for row in rows)
    ]
    return [head[n] for n in kept], [[row[n] for n in kept] for row in rows]


def publish(entry: Entry, number: int, table: Table) -> None:
    """Writes a table to its place on the page and to the stored figures."""
    head, rows = table
    page = (ROOT / entry.page).read_text()
    _, old = on_page(entry, number)
    start = tables_of(page, entry.heading)[number - 1][0]
    lines = page.splitlines()
    lines[start : start + 2 + len(old)] = map(_line, [head, ["---"] * len(head), *rows])
    write_text(ROOT / entry.page, "\n".join(lines) + "\n")
    PUBLISHED.mkdir(exist_ok=True)
    write_text(stored_file(entry, number), csv_table(head, rows))


def _line(cells: list[str]) -> str:
    """Of Markdown. Names of scenes and models are code."""
    return _NAME.sub(r"`\g<0>`", f"| {' | '.join(cells)} |")


def fresh_cells(entry: Entry, row: dict[str, Any]) -> list[str]:
    """The cells of a row behind its label, by running its pair now; what has not changed is not run again."""
    surface = MESHES / row["surface"] if "surface" in row else None
    out = OUT / "reproduce" / entry.name
    folder = out / re.sub(r"\W+", "_", " ".join(row["label"]))
    needs_error = any(column.startswith("reference.") for column in entry.columns)
    with locked(folder):
        experiment = run_solvers(
            SCENES / row["scene"], folder, surface, [*row.get("set", ())], is_quiet=True,
            time_limit=_TIME_LIMIT if needs_error else 0, is_refined_once=True, store=Store(out / "runs"),
        )  # fmt: skip
        values = without_nan(compare(experiment, is_as_in_scene=True).as_json())
    return [cell_of(values, key) for key in entry.columns]


def cell_of(values: dict[str, Any], key: str) -> str:
    """A figure of comparison.json as it is published: counts, shares in per cent, or the word that stands for it."""
    if not key:
        return ""
    value: Any = values
    for part in key.split("."):
        if not isinstance(value, dict) or part not in value:
            model = values["models"].get(key.split(".")[1], {}) if key.startswith("models.") else {}
            return "" if model.get("status", "ok") == "ok" else "not converged"
        value = value[part]
    if isinstance(value, int):
        return str(value)
    return "rounding" if value is not None and abs(value) < _ROUNDING else percent(value, 2)


def reproduce_runs(entry: Entry, is_written: bool, is_quiet: bool) -> list[Compared]:
    """A table of runs beside the stored one; written anew where that is asked for.

    Rows whose body is not on this machine are left out. Raises RunError where they would have to be written.
    """
    missing = missing_meshes([entry])
    if is_written and missing:
        raise RunError(f"{entry.name}: not written without {', '.join(missing)}")
    (number,) = entry.tables
    head, stored = on_page(entry, number)
    if len(stored) != len(entry.rows):
        raise RunError(f"{entry.page}: '{entry.heading}', expected a table of {len(entry.rows)} rows")
    here = [
        (row, old) for row, old in zip(entry.rows, stored, strict=True) if row.get("surface") not in missing
    ]
    fresh = []
    progress = Progress(len(here), is_quiet)
    made = each(lambda pair: fresh_cells(entry, pair[0]), here)
    for (row, _), cells in zip(here, made, strict=True):
        fresh.append([*row["label"], *cells])
        progress.say(f"{entry.name}: {', '.join(row['label'])}")
    table = (list(entry.head), fresh)
    found = compare_tables(number, (head, [old for _, old in here]), table, entry.tolerance)
    if is_written:
        publish(entry, number, table)
    return [found]


def reproduce_command(
    entry: Entry, is_written: bool, cluster: str = "", has_run: bool = False
) -> list[Compared]:
    """Tables and figures of a study beside the stored ones. Raises RunError where it fails.

    cluster: address of the scheduler whose workers make the study's runs, if there is one. has_run: what the command leaves is
    there, as the entry before has run it.
    """
    out = OUT / "reproduce" / entry.name
    out.mkdir(parents=True, exist_ok=True)
    own = {} if entry.sources or entry.figures else {file: _committed(file) for file in _files_of(entry)}
    if not has_run:
        _run(entry, out / "output.txt", cluster)
    found = [
        compare_tables(
            number,
            on_page(entry, number, (own[entry.page] or b"").decode()),
            on_page(entry, number),
            entry.tolerance,
        )
        for number in (entry.tables if own else ())
    ]
    found += [compare_files(file, stored, ROOT / file, out) for file, stored in own.items()]
    for number, source in zip(entry.tables, entry.sources, strict=bool(entry.sources)):
        fresh = read_table(ROOT / source, entry.columns)
        found.append(compare_tables(number, on_page(entry, number), fresh, entry.tolerance))
        if is_written:
            publish(entry, number, fresh)
    for published, made in entry.figures.items():
        old, new = ROOT / published, ROOT / made
        found.append(compare_files(published, old.read_bytes() if old.exists() else None, new, out))
        if is_written:
            shutil.copyfile(new, old)
    return found


def _run(entry: Entry, output: Path, cluster: str) -> None:
    study = f"./testbed study --cluster {cluster} " if cluster else "./testbed study "
    command = entry.command.replace("./testbed study ", study)
    with output.open("w") as said:
        done = subprocess.run(command, shell=True, cwd=ROOT, stdout=said, check=False)
    if done.returncode:
        raise RunError(f"{entry.name}: '{entry.command}' ended with {done.returncode}, see {output}")


def _files_of(entry: Entry) -> list[str]:
    """A page that a command writes itself, and its pictures."""
    page = ROOT / entry.page
    pictures = re.findall(r"!\[[^]]*\]\(([^):]*)\)", page.read_text())
    return [entry.page, *(str((page.parent / link).relative_to(ROOT)) for link in pictures)]


def _committed(file: str) -> bytes | None:
    """As git has it, since a command that was killed may have written it; without git as it is."""
    shown = subprocess.run(["git", "-C", ROOT, "show", f"HEAD:./{file}"], capture_output=True, check=False)
    if shown.returncode == 0:
        return shown.stdout
    return (ROOT / file).read_bytes() if (ROOT / file).exists() else None


def reproduce(
    entry: Entry, is_written: bool, is_quiet: bool = False, cluster: str = "", has_run: bool = False
) -> list[Compared]:
    """What it makes beside what is stored. With is_written the page is written anew, and what it is of is noted.

    cluster, has_run: as reproduce_command.
    """
    found = (
        reproduce_runs(entry, is_written, is_quiet)
        if entry.rows
        else reproduce_command(entry, is_written, cluster, has_run)
    )
    if is_written:
        stored = _stored()
        of = describe(PROGRAMS)
        stored[entry.name] = {"commit": of["commit"], "machine": of["processor"]}
        write_text(STORED, json.dumps(dict(sorted(stored.items())), indent=2) + "\n")
    return found


def _stored() -> dict[str, Any]:
    """Entry -> what the stored figures are of."""
    found: dict[str, Any] = json.loads(STORED.read_text()) if STORED.exists() else {}
    return found


def main(arguments: argparse.Namespace) -> int:
    """./testbed reproduce"""
    with engine_of(arguments) as engine:
        return _reproduce_all(arguments, engine.address if engine else "")


def _reproduce_all(arguments: argparse.Namespace, cluster: str) -> int:
    listed = entries()
    if unknown := [name for name in arguments.names if name not in listed]:
        raise RunError(f"no entry '{unknown[0]}' (known: {', '.join(listed)})")
    chosen = [listed[name] for name in arguments.names or listed]
    commit = describe(PROGRAMS)["commit"]
    if arguments.write and not re.fullmatch("[0-9a-f]+", commit):
        raise RunError(f"--write: the tree is {commit}, expected a commit without further changes")
    minutes = {entry.command or entry.name: entry.minutes for entry in chosen}
    say(
        f"{len(chosen)} entries, {sum(minutes.values()):.0f} min at most on two cores: what is kept takes none",
        arguments.quiet,
    )
    missing = missing_meshes(chosen)
    if missing:
        print(f"Rows of {len(missing)} bodies are left out until these files lie in {MESHES}:")
        for name, source in missing.items():
            print(f"  {name}: {source}")
    out = OUT / "reproduce"
    stored = _stored()
    n_different = 0
    last = ""  # command, if nothing that it may read was published since
    if arguments.force:
        for folder in {
            folder
            for entry in chosen
            for folder in (out / entry.name, *((ROOT / source).parent for source in entry.sources))
        }:
            forget(folder)
    for number, entry in enumerate(chosen, 1):
        place = f"[{number}/{len(chosen)}, {sum(minutes.values()):.0f} min left at most]"
        say(f"{place} {entry.name}: {entry.command or entry.heading}", arguments.quiet)
        found, error = [], ""
        try:
            with reminders(entry.name, arguments.quiet):
                found = reproduce(entry, arguments.write, arguments.quiet, cluster, entry.command == last)
            last = "" if arguments.write and (entry.sources or entry.figures) else entry.command
        except RunError as failure:
            error, last = str(failure), ""
        minutes.pop(entry.command or entry.name, None)
        n_left_out = sum(row.get("surface") in missing for row in entry.rows)
        left_out = f"{n_left_out} of {len(entry.rows)} rows left out" if n_left_out else ""
        keep(out, entry.name, {"commit": commit, "error": error, "note": left_out}, found)
        report = write_report(out, {name: _listing(of) for name, of in listed.items()}, _stored())
        said = [error] if error else [line for item in found for line in item.differences]
        of = stored.get(entry.name, {}).get("commit", "an unknown commit")
        print(
            f"{entry.name} (stored of {of}): {', '.join(filter(None, ['' if said else 'as stored', left_out]))}"
        )
        for line in said:
            print(f"  {line}")
        n_different += bool(said)
    print(f"\nreport: {report}")
    return 1 if n_different else 0


def _listing(entry: Entry) -> tuple[str, list[str]]:
    """Its place, and the names of what it makes."""
    names = [f"table {number}" for number in entry.tables] + list(entry.figures)
    return f"{entry.page}, {entry.heading}", names or [entry.page]
