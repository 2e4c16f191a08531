"""Peers study: DOLFINx and CalculiX beside the reference on the same tetrahedra, Bullet beside the springs.

A bar hangs from one end under its weight, at small strain, by linear and quadratic elements. Iterations of both programs end at
the same residual over the load. DOLFINx has the faster one of multigrid and a Cholesky factor. Seconds go from tetrahedra to
displacement: our set-up, assembly and solution; DOLFINx's mesh, assembly and solution, its forms compiled before. All run on one
thread. Runs alternate, and the least of each counts. A peer that gives another answer has its difference and no ratio.
CalculiX is measured by build/bin/bench_reference, in CPU seconds without meshing. Bullet is by build/bin/bench_bullet: our steps
in a second over those of its deformable bodies, with the same nodes, springs, masses and steps.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyvista as pv

from ..paths import PROGRAMS, SCENES
from ..progress import say
from ..report import Table
from ..run_store import RunRequest, Store
from ..runs import Array, Run, RunError, load_run, scene_of
from .benchmarks import benchmarks_of
from .result import Result, Section, alone

_DEBIAN = "/usr/bin/python3"
_WORKER = Path(__file__).with_name("peer_dolfinx.py")
_SCENE = SCENES / "bar_sag.toml"
_VERTICES = (400, 1600)
_REPETITIONS = 3
_RESIDUAL = 1e-8
_SAME = 1e-5  # difference of two answers that are one


class Pair(NamedTuple):
    """Both programs on one mesh: seconds, and their difference over the largest displacement."""

    degree: int
    n_unknowns: int
    ours: float
    theirs: float
    solver: str  #: theirs
    difference: float


def has_peer() -> bool:
    words = [_DEBIAN, "-c", "import dolfinx"]
    return (
        Path(_DEBIAN).exists()
        and not subprocess.run(words, capture_output=True, env=_environment()).returncode
    )


def _environment() -> dict[str, str]:
    """Without what leads Debian's Python to the packages of another, on one thread."""
    kept = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))
    }
    return kept | {"OMP_NUM_THREADS": "1"}


def tetrahedra_of(run: Run) -> tuple[Array, Array, Array]:
    """Corners (n, 3) in m, tetrahedra (m, 4) and displacement of the corners (n, 3) in m of a run of finite elements."""
    grid = run.grid(-1)
    kinds = (pv.CellType.QUADRATIC_TETRA, pv.CellType.TETRA)
    cells = next(grid.cells_dict[kind][:, :4] for kind in kinds if kind in grid.cells_dict)
    corners, tetrahedra = np.unique(cells, return_inverse=True)
    X, u = (np.asarray(grid[name], dtype=float)[corners] for name in ("rest_position", "displacement"))
    return X, tetrahedra.reshape(cells.shape), u


def solve_by_dolfinx(run: Run, folder: Path) -> tuple[Array, int, str, float]:
    """Displacement of the corners, number of unknowns, solver and seconds. Raises RunError where it fails."""
    scene = scene_of(run)
    material = scene["material"]
    X, tetrahedra, _ = tetrahedra_of(run)
    given, found = folder / "given.npz", folder / "found.npz"
    np.savez(
        given, points=X, tetrahedra=tetrahedra, degree=scene["reference"]["degree"], E=material["E"], nu=material["nu"],
        weight=material["rho"] * np.array(scene["gravity"], dtype=float), tolerance=_RESIDUAL,
    )  # fmt: skip
    done = subprocess.run(
        [_DEBIAN, _WORKER, given, found], capture_output=True, text=True, env=_environment()
    )
    if done.returncode:
        raise RunError(f"DOLFINx: {done.stderr.strip().splitlines()[-1]}")
    with np.load(found) as answer:
        return answer["u"], int(answer["n_unknowns"]), str(answer["solver"]), float(answer["seconds"])


def measure(store: Store, folder: Path, n_vertices: int, degree: int) -> Pair:
    """The least seconds of each. Raises RunError where either fails."""
    ours, answers = [], []
    for repetition in range(_REPETITIONS):
        settings = (
            f"surface.n_vertices={n_vertices}",
            f"reference.degree={degree}",
            f"time.residual={_RESIDUAL}",
        )
        request = RunRequest("fem_reference", _SCENE, settings, repetition=100 * repetition, is_timed=True)
        outcome = store.run(request)
        if outcome.status != "ok":
            raise RunError(f"fem_reference: {outcome.status}: {outcome.message}")
        if repetition == 0:
            run = load_run(outcome.folder)
        ours.append(sum(outcome.record["seconds"][stage] for stage in ("setup", "assemble", "solve")))
        answers.append(solve_by_dolfinx(run, folder))
    u, n_unknowns, solver, seconds = min(answers, key=lambda answer: answer[-1])
    exact = tetrahedra_of(run)[2]
    difference = float(np.abs(u - exact).max() / np.abs(exact).max())
    return Pair(degree, n_unknowns, min(ours), seconds, solver, difference)


def table(pairs: list[Pair]) -> Table:
    head = ["degree", "unknowns", "ours (s)", "DOLFINx (s)", "its solver", "DOLFINx / ours", "difference"]
    return head, [
        [
            str(p.degree),
            str(p.n_unknowns),
            f"{p.ours:.2g}",
            f"{p.theirs:.2g}",
            p.solver,
            f"{p.theirs / p.ours:.2g}" if p.difference <= _SAME else "another answer",
            f"{p.difference:.1g}",
        ]
        for p in pairs
    ]


def table_of_calculix(benchmarks: list[dict[str, Any]]) -> Table:
    """CPU seconds of a bar by either program."""
    rows = []
    for row in benchmarks:
        ours = row["cpu"] - row["mesh_cpu"]
        degree = row["name"].partition("degree:")[2].partition("/")[0]
        rows.append(
            [
                degree,
                f"{row['dofs']:.0f}",
                f"{ours:.2g}",
                f"{row['ccx_cpu']:.2g}",
                f"{row['ccx_cpu'] / ours:.2g}",
            ]
        )
    return ["degree", "unknowns", "ours (s)", "CalculiX (s)", "CalculiX / ours"], rows


def table_of_bullet(benchmarks: list[dict[str, Any]]) -> Table:
    """Our steps over Bullet's: a row for each body."""
    rates = {row["name"]: float(row["FPS"]) for row in benchmarks}
    bodies = dict.fromkeys(name.split("/")[1] for name in rates)
    kinds = {
        "explicit": "explicit/soft",
        "implicit, a frame's step": "implicit/soft",
        "the same, E x 1000": "implicit/stiff",
    }
    return ["", *kinds], [
        [
            body,
            *(
                f"{rates[f'ours/{body}/{kind}'] / rates[f'bullet/{body}/{kind}']:.2g}"
                for kind in kinds.values()
            ),
        ]
        for body in bodies
    ]


def finding(pairs: list[Pair]) -> str:
    """The study in one sentence."""
    ratios = [p.theirs / p.ours for p in pairs if p.difference <= _SAME]
    if not ratios:
        return "DOLFINx gives other answers."
    return f"DOLFINx takes {min(ratios):.2g} to {max(ratios):.2g} times the seconds of the reference for the same answers."


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: the smallest bar."""
    if not has_peer():
        raise RunError(
            f"{_DEBIAN}: no dolfinx, expected Debian's python3-dolfinx (apt-get install python3-dolfinx)"
        )
    store = Store(folder / "runs")
    pairs = []
    with alone(arguments.quiet):
        for n_vertices in _VERTICES[: 1 if arguments.quick else None]:
            for degree in (1, 2):
                say(f"{n_vertices} vertices, degree {degree}", arguments.quiet)
                pairs.append(measure(store, folder, n_vertices, degree))
        size, body = ("25k", "ball") if arguments.quick else (".*", ".*")
        say("CalculiX", arguments.quiet)
        calculix = table_of_calculix(benchmarks_of(PROGRAMS / "bench_reference", f"^calculix/bar/{size}/"))
        say("Bullet", arguments.quiet)
        bullet = table_of_bullet(benchmarks_of(PROGRAMS / "bench_bullet", f"/{body}/"))
    return Result(
        "Peers",
        finding(pairs),
        [
            Section("DOLFINx on the same tetrahedra", [], {}, {"dolfinx": table(pairs)}),
            Section("CalculiX on the same tetrahedra", [], {}, {"calculix": calculix}),
            Section("Bullet on the same springs", [], {}, {"bullet": bullet}),
        ],
    )
