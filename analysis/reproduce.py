"""./testbed reproduce: every published table and figure made again by its command, and what differs from the stored one.

manifest.toml lists them. A table of runs is made cell by cell from the runs' comparison.json; what a study or a benchmark
gives is made by its command, and its figures are copied. reproduced.json tells of what commit and machine the stored ones are.
Rows of bodies that are not on this machine are left out, and it is said beforehand where these are found.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import time
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .comparison import compare, without_nan
from .experiment import run_solvers
from .machine import describe
from .paths import MESHES, OUT, PACKAGE, PROGRAMS, ROOT, SCENES, write_text
from .run_store import reminders, say
from .runs import RunError
from .wording import percent

MANIFEST, STORED = PACKAGE / "manifest.toml", PACKAGE / "reproduced.json"
_ROUNDING = 1e-8
_TIME_LIMIT = 200.0  # s, of a reference that is refined for its error, where a table shows that
_NUMBER = re.compile(r"[-+]?\d[\d ]*(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Entry:
    """A table or figures of a page, by the manifest."""

    name: str
    page: str  #: from the project's root
    heading: str  #: of the section
    minutes: float  #: on two cores
    tables: tuple[int, ...] = ()  #: which of the section's tables; none: figures alone
    tolerance: float = 0.1  #: of a number, relative
    columns: tuple[str, ...] = ()  #: of a table of runs: keys of comparison.json
    rows: tuple[dict[str, Any], ...] = ()  #: of the same: scene, set, surface
    command: str = ""  #: of others
    figures: dict[str, str] = field(default_factory=dict)  #: published file -> file of the command


def entries() -> dict[str, Entry]:
    """Of the manifest, by name."""
    listed = tomllib.loads(MANIFEST.read_text())
    return {
        name: Entry(name, **entry | {key: tuple(entry.get(key, ())) for key in ("tables", "columns", "rows")})
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


def tables_of(page: str, heading: str) -> list[tuple[int, list[str]]]:
    """Of a section: the line at which each table's rows begin, behind head and rule, and these rows."""
    lines = page.splitlines()
    found: list[tuple[int, list[str]]] = []
    here = False
    for number, line in enumerate(lines):
        if line.startswith("#"):
            here = line.lstrip("# ") == heading
        elif here and re.fullmatch(r"\|[-| ]+\|", line):
            end = next((n for n in range(number, len(lines)) if not lines[n].startswith("|")), len(lines))
            found.append((number + 1, lines[number + 1 : end]))
    return found


def stored_rows(entry: Entry) -> list[list[str]]:
    """Cells of the stored table of runs. Raises RunError where the page has none, or of other rows."""
    tables = tables_of((ROOT / entry.page).read_text(), entry.heading)
    if len(tables) < entry.tables[0] or len(tables[entry.tables[0] - 1][1]) != len(entry.rows):
        raise RunError(f"{entry.page}: '{entry.heading}', expected a table of {len(entry.rows)} rows")
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in tables[entry.tables[0] - 1][1]]


def fresh_cells(entry: Entry, row: dict[str, Any]) -> list[str]:
    """The cells of a row behind its label, by running its pair now; what has not changed is not run again."""
    surface = MESHES / row["surface"] if "surface" in row else None
    folder = OUT / "reproduce" / entry.name / re.sub(r"\W+", "_", row["label"])
    needs_error = any(column.startswith("reference.") for column in entry.columns)
    experiment = run_solvers(
        SCENES / row["scene"], folder, surface, [*row.get("set", ())], is_quiet=True,
        time_limit=_TIME_LIMIT if needs_error else 0, is_refined_once=True,
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
    return "rounding" if value is not None and value < _ROUNDING else percent(value, 2)


def differences(stored: list[str], fresh: list[str], tolerance: float) -> list[str]:
    """ "a -> b" for cells whose words differ, or whose numbers differ by more than a share of them."""
    found = []
    for old, new in zip(stored, fresh, strict=True):
        numbers = [[float(n.replace(" ", "")) for n in _NUMBER.findall(cell)] for cell in (old, new)]
        words = [_NUMBER.sub("", cell).strip(" %") for cell in (old, new)]
        is_same = words[0] == words[1] and len(numbers[0]) == len(numbers[1])
        if not is_same or any(
            abs(a - b) > tolerance * max(abs(a), abs(b)) for a, b in zip(*numbers, strict=True)
        ):
            found.append(f"{old or 'nothing'} -> {new or 'nothing'}")
    return found


def reproduce_runs(entry: Entry, is_written: bool, is_quiet: bool) -> list[str]:
    """Differences of a table of runs, each with its row's label; written anew where that is asked for.

    Rows whose body is not on this machine are left out. Raises RunError where they would have to be written.
    """
    said, lines = [], []
    missing = missing_meshes([entry])
    if is_written and missing:
        raise RunError(f"{entry.name}: not written without {', '.join(missing)}")
    for row, (label, *stored) in zip(entry.rows, stored_rows(entry), strict=True):
        if row.get("surface") in missing:
            continue
        say(f"{entry.name}: {row['label']}", is_quiet)
        n_words = len(stored) - len(entry.columns)  # that stand before the figures
        fresh = fresh_cells(entry, row)
        said += [f"{row['label']}: {text}" for text in differences(stored[n_words:], fresh, entry.tolerance)]
        lines.append(f"| {' | '.join([label, *stored[:n_words], *fresh])} |")
    if is_written:
        page = (ROOT / entry.page).read_text()
        start, old = tables_of(page, entry.heading)[entry.tables[0] - 1]
        all_lines = page.splitlines()
        all_lines[start : start + len(old)] = lines
        write_text(ROOT / entry.page, "\n".join(all_lines) + "\n")
    return said


def reproduce_command(entry: Entry, is_written: bool, is_quiet: bool) -> list[str]:
    """Runs a study or benchmark, and names the figures that have changed. Raises RunError where it fails."""
    say(f"{entry.name}: {entry.command}", is_quiet)
    out = OUT / "reproduce" / entry.name
    out.mkdir(parents=True, exist_ok=True)
    with (out / "output.txt").open("w") as output:
        done = subprocess.run(entry.command, shell=True, cwd=ROOT, stdout=output, check=False)
    if done.returncode:
        raise RunError(
            f"{entry.name}: '{entry.command}' ended with {done.returncode}, see {out / 'output.txt'}"
        )
    said = [f"compare {out / 'output.txt'} with {entry.page}, '{entry.heading}'"] if entry.tables else []
    for published, made in entry.figures.items():
        old, new = ROOT / published, ROOT / made
        if not old.exists() or old.read_bytes() != new.read_bytes():
            said.append(f"{published} has changed")
        if is_written:
            shutil.copyfile(new, old)
    return said


def reproduce(entry: Entry, is_written: bool, is_quiet: bool = False) -> list[str]:
    """What differs from what is stored. With is_written the page is written anew, and what it is of is noted."""
    start = time.monotonic()
    said = (reproduce_runs if entry.rows else reproduce_command)(entry, is_written, is_quiet)
    if is_written:
        stored = json.loads(STORED.read_text()) if STORED.exists() else {}
        of = describe(PROGRAMS)
        minutes = round((time.monotonic() - start) / 60, 1)
        stored[entry.name] = {"commit": of["commit"], "machine": of["processor"], "minutes": minutes}
        write_text(STORED, json.dumps(dict(sorted(stored.items())), indent=2) + "\n")
    return said


def main(arguments: argparse.Namespace) -> int:
    """./testbed reproduce"""
    listed = entries()
    if unknown := [name for name in arguments.names if name not in listed]:
        raise RunError(f"no entry '{unknown[0]}' (known: {', '.join(listed)})")
    chosen = [listed[name] for name in arguments.names or listed]
    commit = describe(PROGRAMS)["commit"]
    if arguments.write and not re.fullmatch("[0-9a-f]+", commit):
        raise RunError(f"--write: the tree is {commit}, expected a commit without further changes")
    minutes = sum(entry.minutes for entry in chosen)
    say(
        f"{len(chosen)} tables and figures, {minutes:.0f} min at most on two cores: what is kept takes none",
        arguments.quiet,
    )
    missing = missing_meshes(chosen)
    if missing:
        print(f"Rows of {len(missing)} bodies are left out until these files lie in {MESHES}:")
        for name, source in missing.items():
            print(f"  {name}: {source}")
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    n_different = 0
    for entry in chosen:
        try:
            with reminders(entry.name, arguments.quiet):
                said = reproduce(entry, arguments.write, arguments.quiet)
        except RunError as error:
            said = [str(error)]
        of = stored.get(entry.name, {}).get("commit", "an unknown commit")
        n_left_out = sum(row.get("surface") in missing for row in entry.rows)
        left_out = f"{n_left_out} of {len(entry.rows)} rows left out" if n_left_out else ""
        print(
            f"{entry.name} (stored of {of}): {', '.join(filter(None, ['' if said else 'as stored', left_out]))}"
        )
        for line in said:
            print(f"  {line}")
        n_different += bool(said)
    return 1 if n_different else 0
