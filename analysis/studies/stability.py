"""Stability: what becomes of a small body let go from six bad starts, by the paper's schemes and ours.

Every start (rest, squashed to half, crushed to a twentieth with noise, mirrored, flattened, random in the
box) meets every stiffness from 1 kPa to 1 GPa, every step from 0.1 ms to 1 s and every method. The paper's
schemes step its own network (Hooke's springs, global volume force, a ball of 102 nodes); ours minimise the
incremental potential, on the same network with springs that stay definite and on the coupled springs of a
cube of 125 nodes. Nothing damps the motion but the scheme, no load does work: the energy must not grow. A
run lasts ten crossings of a wave, or as far as 2000 explicit or 100 implicit steps reach. Inverted is a
body with a tetrahedron turned inside out, or, without tetrahedra, one that encloses no volume.

--seeds N,N... lets coupled springs alone go from starts that other seeds draw. Their bodies can end inverted although no
patch of their tetrahedra, on which the law looks, is inside out.

--candidates tries other laws on crushed and random bodies of four seeds.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..drawing.style import svg_of
from ..paths import PROGRAMS, write_text
from ..progress import say
from ..report import Table
from ..runs import RunError
from ..wording import percent
from .result import Figures, Result, Section

Row = dict[str, str]

# Outcome -> colour and meaning, from best to worst; colours from Okabe & Ito 2008.
OUTCOMES = {
    "ok": ("#009E73", "ends sound"),
    "short": ("#A6D8C8", "sound so far, still inverted: the steps end before the body can have turned back"),
    "inverted": ("#56B4E9", "ends with an inverted part"),
    "not_converged": ("#E69F00", "a step's iterations ran out; energy fell all the same"),
    "energy_gained": ("#CC79A7", "energy grew by more than 1 %"),
    "diverged": ("#000000", "diverged"),
}


#: Method -> what it is called in the table.
NAMES = {
    "explicit_euler": "explicit Euler (the paper)",
    "symplectic_euler": "symplectic Euler",
    "implicit_euler": "linearised implicit Euler (the paper)",
    "minimising_definite_springs": "minimising Euler, PCP, definite law",
    "minimising_edge_coupled": "minimising Euler, edge_coupled",
    "minimising_node_averaged": "minimising Euler, node_averaged",
}
_HEAD = ["method", "sound", "still turning back", "inverted", "not converged", "energy gained", "diverged"]


def measure(
    folder: Path, program: Path, n_cells: int | None = None, is_quiet: bool = True, seed: int | None = None
) -> list[Row]:
    """The map's cells, or the first of them, as the program writes them (all: some three minutes).

    seed: of other starts of coupled springs alone.

    A killed measurement continues behind its last whole row; another program starts anew. Raises RunError when the program
    breaks down.
    """
    folder.mkdir(parents=True, exist_ok=True)
    of_seed = [] if seed is None else [str(seed)]
    digest = hashlib.sha256(program.read_bytes()).hexdigest()[:16]
    file = folder / f"{'-'.join(['cells', digest, *of_seed])}.csv"
    lines = file.read_text().splitlines(keepends=True) if file.exists() else []
    if lines and not lines[-1].endswith("\n"):
        del lines[-1]  # half of a row
    n_known = max(len(lines) - 1, 0)
    write_text(file, "".join(lines) if n_known else "")
    if n_cells is None or n_known < n_cells:
        # The program dies with this process, so that a killed study leaves nobody working.
        command = ["setpriv", "--pdeathsig", "KILL", str(program), str(n_known), *of_seed]
        with file.open("a") as rows, subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
            assert running.stdout
            for line in running.stdout:
                rows.write(line)
                rows.flush()
                if not line.startswith(("method,", "candidate,")):
                    n_known += 1
                    if n_known % 35 == 0:
                        say(f"[{n_known} cells] {' from '.join(line.split(',')[:3:2])}", is_quiet)
                if n_known == n_cells:
                    running.kill()
                    break
        if n_known != n_cells and running.returncode not in (0, 1):  # 1: one of our schemes is not sound
            raise RunError(f"{program}: exit status {running.returncode} after {n_known} cells")
    with file.open(newline="") as table_file:
        return list(csv.DictReader(table_file))[:n_cells]


def finding(rows: Iterable[Row]) -> str:
    """One sentence for each side."""
    sentences = []
    for is_papers, name in (("1", "The paper's schemes"), ("0", "Ours")):
        side = [row for row in rows if row["is_papers"] == is_papers]
        if not side:
            continue
        counts = Counter(row["outcome"] for row in side)
        bad = ", ".join(
            f"{counts[o]} {o.replace('_', ' ')}"
            for o in reversed(OUTCOMES)
            if counts[o] and o not in ("ok", "short")
        )
        sentences.append(f"{name}: {len(side)} cells, {bad or 'all sound'}.")
    return " ".join(sentences)


def table(rows: Iterable[Row]) -> Table:
    """Number of cells of every method and outcome."""
    counts = Counter((row["method"], row["outcome"]) for row in rows)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    return _HEAD, [[NAMES.get(m, m), *(str(counts[m, o]) for o in OUTCOMES)] for m in methods]


def table_of_seeds(rows: Sequence[Row]) -> Table:
    """A line for each method and start: cells, those that end inverted, and of these those whose patches all are sound."""
    lines = []
    for method, start in dict.fromkeys((row["method"], row["start"]) for row in rows):
        of = [row for row in rows if (row["method"], row["start"]) == (method, start)]
        inverted = [row for row in of if row["outcome"] == "inverted"]
        n_sound = sum(float(row["least_patch"]) > 0 for row in inverted)
        lines.append([NAMES.get(method, method), start, str(len(of)), str(len(inverted)), str(n_sound)])
    return ["method", "start", "cells", "inverted", "patches sound"], lines


def table_of_candidates(rows: Sequence[Row]) -> Table:
    """A line for each law and model: its errors, cells, those that end inverted or do not converge, iterations."""
    lines = []
    for law, method in dict.fromkeys((row["candidate"], row["method"]) for row in rows):
        of = [row for row in rows if (row["candidate"], row["method"]) == (law, method)]
        counts = Counter(row["outcome"] for row in of)
        n_iterations = sum(int(row["newton_iterations"]) for row in of)
        errors = [percent(float(of[0][key])) for key in ("bend_error", "squash_error")]
        bad = [str(counts[outcome]) for outcome in ("inverted", "not_converged")]
        lines.append(
            [law, method.removeprefix("minimising_"), *errors, str(len(of)), *bad, str(n_iterations)]
        )
    head = [
        "law",
        "springs",
        "error, bent",
        "changed, squashed",
        "cells",
        "inverted",
        "not converged",
        "iterations",
    ]
    return head, lines


def plot(rows: list[Row]) -> str:
    """A square for every cell: a row of maps for each method, a column for each start."""
    methods, starts, stiffnesses, steps = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("method", "start", "E", "h")
    )
    number = {(r["method"], r["start"], r["E"], r["h"]): list(OUTCOMES).index(r["outcome"]) for r in rows}
    colours = ListedColormap([colour for colour, _ in OUTCOMES.values()])
    norm = BoundaryNorm(np.arange(len(OUTCOMES) + 1) - 0.5, len(OUTCOMES))
    figure = Figure(figsize=(1.75 * len(starts), 1.0 + 1.45 * len(methods)), layout="constrained")
    axes = figure.subplots(len(methods), len(starts), sharex=True, sharey=True, squeeze=False)
    for line, method in zip(axes, methods, strict=True):
        for axis, start in zip(line, starts, strict=True):
            cells = [[number[method, start, E, h] for E in stiffnesses] for h in steps]
            axis.pcolormesh(
                cells, cmap=colours, norm=norm, edgecolors="white", linewidth=0.5, rasterized=True
            )
            labels = [f"{float(E):.0e}".replace("e+0", "e") for E in stiffnesses[::2]]
            axis.set_xticks(np.arange(len(stiffnesses))[::2] + 0.5, labels, fontsize=7)
            axis.set_yticks(np.arange(len(steps)) + 0.5, [f"{float(h):g}" for h in steps], fontsize=7)
            axis.grid(False)
            if method == methods[0]:
                axis.set_title(start, fontsize=9)
            if method == methods[-1]:
                axis.set_xlabel("E (Pa)", fontsize=8)
        name = method.replace("_", " ").replace("minimising ", "minimising\n")
        line[0].set_ylabel(f"{name}\nstep (s)", fontsize=8)
    figure.legend(
        handles=[Patch(color=colour, label=meaning) for colour, meaning in OUTCOMES.values()],
        loc="outside lower center",
        ncols=2,
        fontsize=8,
    )
    return svg_of(figure)


CAPTION = "Outcome of every cell; step over stiffness, a column for each start."


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """What becomes of a body let go from bad starts; --quick: the first method alone."""
    n_cells = 210 if arguments.quick else None
    if arguments.candidates:
        rows = measure(folder, PROGRAMS / "stability_candidates", is_quiet=arguments.quiet)
        laws = {row["candidate"] for row in rows}
        failing = {row["candidate"] for row in rows if row["outcome"] == "inverted"}
        section = Section("Crushed and random bodies", [], {}, {"candidates": table_of_candidates(rows)})
        sentence = f"Of {len(laws)} laws {len(laws - failing)} leave no body inverted."
        return Result("Other laws of coupled springs", sentence, [section])
    if arguments.seeds:
        rows = [
            row
            for seed in arguments.seeds
            for row in measure(folder, PROGRAMS / "stability", n_cells, arguments.quiet, seed)
        ]
        return Result(
            "Stability from other seeds",
            finding(rows),
            [Section("Coupled springs", [], {}, {"seeds": table_of_seeds(rows)})],
        )
    rows = measure(folder, PROGRAMS / "stability", n_cells, arguments.quiet)
    figures: Figures = {"stability": (plot(rows), CAPTION)}
    section = Section("Every scheme", [], figures, {"outcomes": table(rows)})
    return Result("Stability", finding(rows), [section])
