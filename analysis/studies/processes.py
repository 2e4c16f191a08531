"""Processes study: statics and implicit steps by one process, two and four, of one body and of growing ones.

A bar of quadratic elements hangs from its end, at small and finite strain, or is let go for ten steps. Seconds are those of
processors, of all processes together, without those spent in MPI, most of which are waiting. They and the memory, which is the
largest process', are counted beyond what as many processes take on a bar of hardly any elements. A model with the figures of
four extrapolates to the processes of a cluster.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from statistics import mean
from typing import Any

from ..paths import PROGRAMS, SCENES
from ..progress import say
from ..report import Table
from ..runs import RunError, built, record_of
from ..wording import percent, significant
from .result import Result, Section, alone

_COUNTS = (1, 2, 4)
_N_VERTICES, _N_QUICK = 4000, 400  # of the surface of the body that four processes solve
_N_SMALL = 100
_FAR = (64, 1024)  # processes
_LATENCY, _BANDWIDTH = 2e-6, 1e10  # s and byte/s, of a cluster's network
_STATICS = ("reference.degree=2", "time.load_steps=1", "gravity=[0,-1,0]")
_STEPS = (
    "reference.degree=2",
    "time.end=0.005",
    "output.frames_every=0",
    "output.curves=false",
    "surface.across=0",
)
_PROBLEMS = {
    "small strain": ("bar_sag.toml", _STATICS),
    "finite strain": ("bar_bend.toml", _STATICS),
    "ten steps": ("bar_swing.toml", _STEPS),
}
_ENVIRONMENT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


@dataclass(frozen=True)
class Solved:
    """A body by some processes."""

    record: dict[str, Any]

    @cached_property
    def of_processes(self) -> dict[str, list[float]]:
        """What each took: CPU seconds without MPI, messages, bytes, sums, largest memory (byte)."""
        alone = {
            "cpu": self.record["cpu"] + self.record["seconds"]["start-up"],
            "messages": 0,
            "bytes": 0,
            "sums": 0,
            "peak_memory": self.record["peak_memory"],
        }
        return self.record.get("of_processes", {name: [value] for name, value in alone.items()})


def solve(problem: str, n_vertices: int, n: int, folder: Path) -> Solved:
    """Raises RunError where it fails. A run that is there already is not repeated."""
    scene, overrides = _PROBLEMS[problem]
    launcher = ["mpirun", "--oversubscribe", "-np", str(n)] if n > 1 else []
    out = folder / f"{Path(scene).stem}_{n_vertices}_{n}"
    sets = [
        word for override in (*overrides, f"surface.n_vertices={n_vertices}") for word in ("--set", override)
    ]
    program = built(PROGRAMS, "fem_reference")
    done = subprocess.run(
        [*launcher, program, SCENES / scene, "--quiet", "--out", out, *sets],
        env=os.environ | _ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RunError(f"{out}: {done.stderr.strip()}")
    return Solved(record_of(out))


def vertices_for(n: int, n_vertices: int) -> int:
    """Of the surface, so that each of n processes has as many unknowns as each of the most: these grow as its power 3/2."""
    return round(n_vertices * (n / max(_COUNTS)) ** (2 / 3))


def cpu_beyond(solved: Solved, small: Solved) -> list[float]:
    """CPU seconds of each process beyond those on a body of hardly any elements."""
    pairs = zip(solved.of_processes["cpu"], small.of_processes["cpu"], strict=True)
    return [cpu - least for cpu, least in pairs]


def row(kind: str, problem: str, solved: Solved, small: Solved) -> list[str]:
    """Of the table. small: a body of hardly any elements by as many processes."""
    of, at_least = solved.of_processes, small.of_processes
    memory = max(of["peak_memory"]) - max(at_least["peak_memory"])
    return [
        kind,
        problem,
        str(solved.record["processes"]),
        str(solved.record["n_dofs"]),
        str(solved.record.get("linear_iterations", "-")),
        f"{sum(cpu_beyond(solved, small)):.2g}",
        f"{sum(of['messages']):.0f}",
        significant(sum(of["bytes"]) / 1e6, 2),
        f"{max(of['sums']):.0f}",
        f"{memory / 1e6:.0f}",
    ]


HEAD = [
    "body",
    "problem",
    "processes",
    "unknowns",
    "iterations",
    "CPU seconds",
    "messages",
    "MB sent",
    "sums over all",
    "MB a process",
]


@dataclass(frozen=True)
class Extrapolated:
    """Seconds of a solution by many processes, part by part."""

    work: float  #: of each, on its share of the body
    messages: float  #: of each, with those beside it
    sums: float  #: over all
    serial: float  #: of the first, which makes the mesh and deals it out, while the others wait

    @property
    def total(self) -> float:
        return self.work + self.messages + self.sums + self.serial


def extrapolate(n: int, n_dofs: float, several: Solved, small: Solved) -> Extrapolated:
    """To n processes and so many unknowns, from some processes' slices of a bar, each with one or two beside it.

    Blocks of many processes have 26 beside them, and as much border as six slices. Work grows as a share's unknowns, borders as
    their power 2/3, the serial part as all unknowns. A sum goes up and down a binary tree.
    """
    of, n_slices = several.of_processes, several.record["processes"]
    first, *others = cpu_beyond(several, small)
    all_over = n_dofs / several.record["n_dofs"]
    share = all_over * n_slices / n
    messages, sent = (sum(of[name]) / (2 * (n_slices - 1)) for name in ("messages", "bytes"))  # to one beside
    return Extrapolated(
        mean(others) * share,
        26 * messages * _LATENCY + 6 * sent * share ** (2 / 3) / _BANDWIDTH,
        2 * math.ceil(math.log2(n)) * max(of["sums"]) * _LATENCY,
        max(first - mean(others), 0) * all_over,
    )


FAR_HEAD = [
    "body",
    "problem",
    "processes",
    "unknowns",
    "own work",
    "messages",
    "sums",
    "serial",
    "efficiency",
]


def far_row(kind: str, problem: str, n: int, pairs: dict[int, tuple[Solved, Solved]]) -> list[str]:
    """Of the table. pairs: of each number of processes the body and that of hardly any elements."""
    one, several = pairs[1], pairs[max(_COUNTS)]
    grows = n / max(_COUNTS) if kind == "grows" else 1
    n_dofs = several[0].record["n_dofs"] * grows
    found = extrapolate(n, n_dofs, *several)
    # One process would take in proportion to its unknowns.
    of_one = sum(cpu_beyond(*one)) * n_dofs / one[0].record["n_dofs"]
    parts = (found.work, found.messages, found.sums, found.serial)
    cells = [significant(seconds, 2) for seconds in parts]
    return [kind, problem, str(n), significant(n_dofs, 2), *cells, percent(of_one / (n * found.total), 2)]


def measure(n_vertices: int, folder: Path, is_quiet: bool) -> tuple[Table, Table]:
    """What processes take, and what more of them would."""
    rows, far = [], []
    for kind in ("the same", "grows"):
        for problem in _PROBLEMS:
            pairs = {}
            for n in _COUNTS:
                size = n_vertices if kind == "the same" else vertices_for(n, n_vertices)
                say(f"{problem}, {size} vertices, {n} processes", is_quiet)
                solved, small = (solve(problem, vertices, n, folder) for vertices in (size, _N_SMALL))
                pairs[n] = solved, small
                rows.append(row(kind, problem, solved, small))
            far += [far_row(kind, problem, n, pairs) for n in _FAR]
    return (HEAD, rows), (FAR_HEAD, far)


def finding(table: Table) -> str:
    """The study in one sentence."""
    _, rows = table
    at = [HEAD.index(name) for name in ("CPU seconds", "MB a process")]
    first, last = rows[0], rows[len(_COUNTS) - 1]
    cpu, memory = (float(last[k]) / float(first[k]) for k in at)
    return (
        f"By {last[HEAD.index('processes')]} processes, linear statics of one body take {cpu:.2g} times the processor's"
        f" seconds of one, and each holds {memory:.2g} of the body."
    )


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """What several processes take."""
    with alone(arguments.quiet):
        taken, far = measure(_N_QUICK if arguments.quick else _N_VERTICES, folder / "runs", arguments.quiet)
    sections = [
        Section("What they take", [], {}, {"processes": taken}),
        Section("What more would take", [_FAR_WORDS], {}, {"extrapolated": far}),
    ]
    return Result("Processes", finding(taken), sections)


_NETWORK = f"a message takes {1e6 * _LATENCY:g} us, and the network carries {_BANDWIDTH / 1e9:g} GB/s"
_FAR_WORDS = (
    f"Seconds by a model: {_NETWORK}. "
    "Work grows as the unknowns of a process, messages as their power 2/3, the serial part as all unknowns. "
    "The first process makes and deals out the mesh alone. Efficiency is that beside one process, of as many unknowns."
)
