"""Cluster study: a sweep of small runs by one worker and by two, of which one is killed, and one killed itself and continued.

Each run solves the smallest ball by springs or elements. What a run costs besides itself is told twice: the seconds in which
a worker had no run, and the processor's seconds of asking, giving, sending, storing and comparing, both over the runs.
"""

from __future__ import annotations

import argparse
import csv
import json
import logging
import resource
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..cluster import Cluster, engine_of
from ..grid import sweep
from ..paths import ROOT, SCENES
from ..progress import say
from ..report import Table
from ..run_store import Here, made_by
from ..runs import RunError
from .result import Result, Section, alone

_N_POINTS, _N_QUICK = 500, 20  # of the sweep: two runs each
_SCENE = SCENES / "ball_pressure.toml"
_SMALL = {"surface.n_vertices": ["42"], "network.calibration": ["affine"], "reference.degree": ["1"]}
_N_WORKERS = 2
_ANALYSIS = (sys.executable, "-m", "analysis")


@dataclass(frozen=True)
class Measured:
    """A sweep by some workers."""

    name: str
    n_workers: int
    wall: float  #: s
    of_runs: float  #: s, of all runs together
    cpu: float | None  #: s, of the processes that asked and gave; None: they were killed
    n_runs: int
    table: list[dict[str, str]]  #: without its seconds


def grid(n: int) -> dict[str, list[str]]:
    return _SMALL | {"material.nu": [f"{nu:.6f}" for nu in np.linspace(0.1, 0.4, n)]}


def table_in(folder: Path) -> list[dict[str, str]]:
    """Of a sweep, without seconds, which are other ones each time."""
    rows = csv.DictReader((folder / "sweep.csv").read_text().splitlines())
    return [{key: cell for key, cell in row.items() if not key.startswith("seconds")} for row in rows]


def _cpu() -> float:
    """Seconds of this process, without those of the runs, which are its children."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def finished(folder: Path) -> list[Path]:
    """Outcomes of the runs in a sweep's store. A process works on a folder of another name, which a kill leaves."""
    return [file for file in (folder / "runs").glob("*/outcome.json") if ".part-" not in file.parent.name]


def _at_half(folder: Path, n_runs: int, act: Callable[[], None]) -> threading.Thread:
    """Does something once half of the runs are there."""

    def wait() -> None:
        while len(finished(folder)) < n_runs / 2:
            time.sleep(0.02)
        act()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


@contextmanager
def _workers(folder: Path) -> Iterator[tuple[Cluster, list[subprocess.Popen[bytes]]]]:
    """The engine, and processes of one run each as ./testbed worker starts them."""
    from distributed import LocalCluster

    kept = folder / "worker"
    shutil.rmtree(kept, ignore_errors=True)  # what workers keep would be sent at once
    with (
        LocalCluster(
            n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
        ) as scheduler,
        (folder / "workers.txt").open("w") as said,
        engine_of(argparse.Namespace(workers=1, cluster=scheduler.scheduler_address, quiet=True)) as engine,
    ):
        assert engine
        words = [scheduler.scheduler_address, "--cores", "1", "--out", str(kept)]
        processes = [
            subprocess.Popen([*_ANALYSIS, "worker", *words], cwd=ROOT, stdout=said, stderr=said)
            for _ in range(_N_WORKERS)
        ]
        engine.client.wait_for_workers(_N_WORKERS)
        try:
            yield engine, processes
        finally:
            for process in processes:
                process.kill()
                process.wait()


def _measured(name: str, n_workers: int, folder: Path, n: int, cpu: Callable[[], float]) -> Measured:
    """Of a sweep by the engine that makes runs now."""
    start, before = time.perf_counter(), cpu()
    sweep(_SCENE, grid(n), folder, is_quiet=True)
    return _ended(name, n_workers, time.perf_counter() - start, cpu() - before, folder)


def _ended(name: str, n_workers: int, wall: float, cpu: float | None, folder: Path) -> Measured:
    outcomes = [json.loads(file.read_text()) for file in finished(folder)]
    of_runs = sum(outcome["wall"] for outcome in outcomes)
    return Measured(name, n_workers, wall, of_runs, cpu, len(outcomes), table_in(folder))


def by_one(folder: Path, n: int) -> Measured:
    with made_by(Here()):
        return _measured("one worker", 1, folder / "one", n, _cpu)


def by_two(folder: Path, n: int) -> Measured:
    with _workers(folder) as (engine, _):

        def cpu() -> float:
            return _cpu() + sum(engine.client.run(_cpu).values())

        return _measured("two workers", _N_WORKERS, folder / "two", n, cpu)


def by_two_of_which_one_is_killed(folder: Path, n: int) -> Measured:
    out = folder / "one_killed"
    with _workers(folder) as (_, processes):
        thread = _at_half(out, 2 * n, processes[0].kill)
        found = _measured("two workers, one killed", _N_WORKERS, out, n, _cpu)
        thread.join()
    return replace(found, cpu=None)


def by_a_sweep_that_is_killed(folder: Path, n: int) -> Measured:
    """And continued. Raises RunError where a run that was there is made again."""
    out = folder / "sweep_killed"
    settings = [word for key, values in grid(n).items() for word in ("--set", f"{key}={','.join(values)}")]
    command = [*_ANALYSIS, "sweep", str(_SCENE), *settings, "--out", str(out), "--workers", str(_N_WORKERS)]
    start = time.perf_counter()
    with (folder / "sweep.txt").open("w") as said:
        first = subprocess.Popen(command, cwd=ROOT, stdout=said, stderr=said)
        _at_half(out, 2 * n, first.kill).join()
        first.wait()
        there = {file: file.stat().st_mtime_ns for file in finished(out)}
        subprocess.run(command, cwd=ROOT, stdout=said, stderr=said, check=True)
    if again := [file for file, when in there.items() if file.stat().st_mtime_ns != when]:
        raise RunError(f"{again[0].parent}: made again though it was there, expected none")
    return _ended("a sweep killed and continued", _N_WORKERS, time.perf_counter() - start, None, out)


def table(measured: list[Measured]) -> Table:
    """A line for each; cells that a kill leaves unknown have none."""
    head = ["sweep", "runs", "seconds", "without a run (ms)", "processor (ms)", "table"]
    lines = []
    for m in measured:
        idle = (m.n_workers * m.wall - m.of_runs) / m.n_runs
        is_known = m.cpu is not None
        lines.append(
            [
                m.name,
                str(m.n_runs),
                f"{m.wall:.0f}",
                f"{1e3 * idle:.1f}" if is_known else "-",
                f"{1e3 * (m.cpu or 0) / m.n_runs:.1f}" if is_known else "-",
                "the same" if m.table == measured[0].table else "another",
            ]
        )
    return head, lines


def finding(measured: list[Measured]) -> str:
    """The study in one sentence."""
    one, two = measured[:2]
    n_same = sum(m.table == one.table for m in measured[1:])
    more = 1e3 * ((two.cpu or 0) / two.n_runs - (one.cpu or 0) / one.n_runs)
    return (
        f"{n_same} of {len(measured) - 1} sweeps on a cluster give the table of one worker, and the engine takes "
        f"{more:.1f} ms of a processor for a run."
    )


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: 40 runs in place of 1000. All are made anew, as what is there takes no time."""
    n = _N_QUICK if arguments.quick else _N_POINTS
    sweeps = folder / "sweeps"
    shutil.rmtree(sweeps, ignore_errors=True)
    sweeps.mkdir(parents=True)
    measured = []
    with alone(arguments.quiet):
        for sweep_by in (by_one, by_two, by_two_of_which_one_is_killed, by_a_sweep_that_is_killed):
            say(sweep_by.__name__.replace("_", " "), arguments.quiet)
            measured.append(sweep_by(sweeps, n))
    return Result(
        "Runs on a cluster", finding(measured), [Section("Sweeps", [], {}, {"cluster": table(measured)})]
    )
