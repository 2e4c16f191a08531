"""Scaling: seconds of every stage, memory and non-zeros of the matrices from a thousand nodes to a million.

One body, the clamped bar of bar_sag.toml, at finer and finer surfaces. Springs on the paper's network (`uniform`) and on
tetrahedra (`node_averaged`) take explicit and implicit steps; finite elements solve the static scene. Lemma 1 of the paper
says that the non-zero blocks of the springs' matrix, a diagonal one for each node and two for each spring, grow like the nodes.
Sampling, PCP and completion are timed by themselves, by build/bin/bench_meshing.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure

from ..drawing.style import number_logarithmic, style_of, svg_of
from ..methods import FEM_P1, FEM_P2, label_of
from ..paths import PROGRAMS, SCENES
from ..progress import say
from ..report import Table
from ..run_store import Outcome, RunRequest, Store
from .benchmarks import benchmarks_of, cpu_seconds
from .result import Figures, Result, Section, alone

_VERTICES = 900  # of the bar's surface, which give
_NODES = 1400  # nodes with the paper's sampling; half as many for each in a large body
_FILLED = "network.k=100000000"  # as many as fit, where the default is bounded
_EXPLICIT_STEPS, _IMPLICIT_STEPS = 50, 10
_TIME_LIMIT = 1800  # s, for one run of a large body
_NETWORK = "uniform"  # the model whose springs are single ones, as Lemma 1 counts them


@dataclass(frozen=True, eq=False)
class Line:
    """A method and what of it is timed."""

    model: str
    program: str
    overrides: tuple[str, ...]
    stages: dict[str, str]  #: stage of run.json -> what it is called
    n_steps: int = 1  #: by which the solve is divided
    largest: float = 1e5  #: nodes


def _dynamic(integrator: str, step: float, n_steps: int) -> tuple[str, ...]:
    return (
        "time.mode=dynamic",
        f"time.integrator={integrator}",
        f"time.step={step}",
        f"time.end={n_steps * step}",
    )


LINES = [
    Line("uniform", "massspring", ("network.calibration=uniform", *_dynamic("symplectic_euler", 1e-6, _EXPLICIT_STEPS)),
         {"mesh": "sampling and PCP", "setup": "set-up", "solve": "explicit step"}, _EXPLICIT_STEPS, 2e6),
    Line("uniform", "massspring", ("network.calibration=uniform", *_dynamic("implicit_euler", 1e-3, _IMPLICIT_STEPS)),
         {"solve": "implicit step of 1 ms"}, _IMPLICIT_STEPS, 4e5),
    Line("node_averaged", "massspring",
         ("network.calibration=node_averaged", *_dynamic("symplectic_euler", 1e-6, _EXPLICIT_STEPS)),
         {"mesh": "tetrahedra", "setup": "set-up", "solve": "explicit step"}, _EXPLICIT_STEPS),
    Line("node_averaged", "massspring", ("network.calibration=node_averaged", "time.load_steps=1", "network.estimate=false"),
         {"solve": "static solve"}, largest=2e6),
    Line(FEM_P1, "fem_reference", ("reference.degree=1", "time.load_steps=1"),
         {"mesh": "tetrahedra", "assemble": "assembly", "solve": "static solve"}),
    Line(FEM_P2, "fem_reference", ("reference.degree=2", "time.load_steps=1"),
         {"mesh": "tetrahedra", "assemble": "assembly", "solve": "static solve"}),
]  # fmt: skip


@dataclass
class Size:
    """One line at one number of nodes; no outcomes where it failed."""

    line: Line
    outcomes: list[Outcome]
    message: str = ""

    @property
    def n_nodes(self) -> int:
        return self.outcomes[0].record["n_nodes"]

    def seconds(self, stage: str) -> float:
        """Median over the repetitions."""
        return median(run.record["seconds"].get(stage, 0) for run in self.outcomes) / (
            self.line.n_steps if stage == "solve" else 1
        )

    @property
    def memory(self) -> float:
        return max(run.record.get("peak_memory", 0) for run in self.outcomes)

    @property
    def n_blocks(self) -> int:
        """Non-zero 3 x 3 blocks of the springs' matrix; where a run forms none, those that Lemma 1 counts for its springs."""
        record = self.outcomes[0].record
        return record.get("n_blocks") or record["n_nodes"] + 2 * record["n_springs"]

    @property
    def blocks_per_node(self) -> float:
        return self.n_blocks / self.n_nodes


def slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Exponent of y ~ x^p by least squares in the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def measure(scene: Path, store: Store, sizes: list[float], repetitions: int, is_quiet: bool) -> list[Size]:
    """Every line at every number of nodes up to its largest, interleaved."""
    measured: dict[tuple[Line, float], Size] = {}
    for repetition in range(repetitions):
        for n in sizes:
            for line in LINES:
                size = measured.setdefault((line, n), Size(line, []))
                if n > line.largest or len(size.outcomes) != repetition:
                    continue
                vertices = round(_VERTICES * (n / _NODES) ** (2 / 3))
                options = ("--no-diagnostics",) if line.program == "massspring" else ()
                few = (
                    f"surface.n_vertices={vertices}",
                    _FILLED,
                    "output.frames_every=0",
                    "output.curves=false",
                )
                outcome = store.run(
                    RunRequest(
                        line.program,
                        scene,
                        (*few, *line.overrides),
                        options,
                        repetition=repetition,
                        is_timed=True,
                    )
                )
                if outcome.status == "ok":
                    size.outcomes.append(outcome)
                else:
                    size.message = f"{outcome.status}: {outcome.message}"
                what = f"{line.model}, {', '.join(line.stages.values())}"
                say(
                    f"[{repetition + 1}/{repetitions}] {n:g} nodes, {what}: {size.message or f'{outcome.wall:.2f} s'}",
                    is_quiet,
                )
    return [size for size in measured.values() if size.outcomes or size.message]


def _lines(sizes: list[Size]) -> list[tuple[Line, list[Size]]]:
    return [
        (line, good)
        for line in LINES
        if (good := [size for size in sizes if size.line == line and size.outcomes])
    ]


def plot_seconds(sizes: list[Size]) -> str:
    """Seconds of every stage over the nodes, springs and elements side by side."""
    figure = Figure(figsize=(12, 5))
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    drawn: set[tuple[str, str]] = set()
    dashes = ["-", "--", ":", "-."]
    for line, good in _lines(sizes):
        axis = axes[int(line.program == "fem_reference")]
        for stage, name in line.stages.items():
            nodes, seconds = [s.n_nodes for s in good], [s.seconds(stage) for s in good]
            if (line.model, name) in drawn or min(seconds) <= 0:
                continue
            drawn.add((line.model, name))
            label = f"{label_of(line.model)}: {name}" + (
                f" ({slope(nodes, seconds):.2f})" if len(nodes) > 1 else ""
            )
            style = style_of(line.model)
            dash = dashes[sum(model == line.model for model, _ in drawn) % len(dashes) - 1]
            axis.loglog(nodes, seconds, color=style.colour, marker=style.marker, linestyle=dash, label=label)
    for axis, title in zip(axes, ("springs", "finite elements"), strict=True):
        axis.set_title(title, fontsize=11)
        axis.set_xlabel("nodes")
        if axis.lines:  # below the plot, where it covers no line
            axis.legend(
                fontsize=8, title="(slope)", title_fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12)
            )
    axes[0].set_ylabel("time (s)")
    number_logarithmic(axes[0].xaxis, axes[0].yaxis)
    return svg_of(figure)


def plot_memory(sizes: list[Size]) -> str:
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    for line, good in _lines(sizes):
        style = style_of(line.model)
        last = list(line.stages.values())[-1]
        label = f"{label_of(line.model)}, {last}"
        axis.loglog(
            [s.n_nodes for s in good], [s.memory / 1e6 for s in good], marker=style.marker, color=style.colour, label=label,
            linestyle="--" if "explicit" in last else "-",
        )  # fmt: skip
    axis.set_xlabel("nodes")
    axis.set_ylabel("largest resident memory (MB)")
    number_logarithmic(axis.xaxis, axis.yaxis)
    figure.legend(fontsize=7, loc="outside upper left", ncols=2)
    return svg_of(figure)


def plot_lemma(sizes: list[Size]) -> str:
    """Lemma 1: non-zero blocks of the paper's network over nodes."""
    figure = Figure(figsize=(7, 4.5))
    axis = figure.subplots()
    if good := next((good for line, good in _lines(sizes) if line.model == _NETWORK), []):
        nodes, blocks = [s.n_nodes for s in good], [s.n_blocks for s in good]
        power = f" ({slope(nodes, blocks):.3f})" if len(nodes) > 1 else ""
        style = style_of(_NETWORK)
        axis.loglog(nodes, blocks, color=style.colour, marker=style.marker, label=f"PCP network{power}")
        axis.margins(0.15)
        for x, y, size in zip(nodes, blocks, good, strict=True):
            axis.annotate(
                f"{size.blocks_per_node:.1f} a node", (x, y), (4, -12), textcoords="offset points", fontsize=7
            )
        axis.legend(fontsize=8, title="(slope; Lemma 1: 1)", title_fontsize=8, loc="upper left")
        number_logarithmic(axis.xaxis, axis.yaxis)
    axis.set_xlabel("nodes")
    axis.set_ylabel("non-zero 3 x 3 blocks")
    return svg_of(figure)


def table(sizes: list[Size]) -> Table:
    head = [
        "method",
        "timed",
        "nodes",
        "stage",
        "seconds",
        "slope to the row before",
        "memory (MB)",
        "blocks a node",
    ]
    rows = []
    for line, good in _lines(sizes):
        for stage, name in line.stages.items():
            before: Size | None = None
            for s in good:
                step = "-"
                if before and before.seconds(stage) > 0 and s.seconds(stage) > 0:
                    step = (
                        f"{slope([before.n_nodes, s.n_nodes], [before.seconds(stage), s.seconds(stage)]):.2f}"
                    )
                is_known = line.model == _NETWORK or "n_blocks" in s.outcomes[0].record
                blocks = f"{s.blocks_per_node:.2f}" if is_known else "-"
                rows.append(
                    [
                        label_of(line.model),
                        name,
                        str(s.n_nodes),
                        stage,
                        f"{s.seconds(stage):.3g}",
                        step,
                        f"{s.memory / 1e6:.0f}",
                        blocks,
                    ]
                )
                before = s
    rows += [
        [label_of(s.line.model), ", ".join(s.line.stages.values()), *["-"] * 5, s.message]
        for s in sizes
        if s.message
    ]
    return head, rows


def table_of_exponents(sizes: list[Size]) -> Table:
    """How seconds of the solution grow with the nodes, and the memory of the largest body."""
    rows = []
    for line, good in _lines(sizes):
        seconds = [size.seconds("solve") for size in good]
        if len(good) < 2 or min(seconds) <= 0:
            continue
        nodes = [size.n_nodes for size in good]
        rows.append(
            [
                label_of(line.model),
                line.stages["solve"],
                f"{nodes[0]} to {nodes[-1]}",
                f"{slope(nodes, seconds):.2f}",
                f"{good[-1].memory / 1e3 / nodes[-1]:.2g}",
            ]
        )
    return ["method", "stage", "nodes", "exponent of seconds", "memory a node (kB)"], rows


def table_of_networks(most: float) -> Table:
    """CPU seconds of sampling, PCP and completion over the internal nodes, up to so many."""
    names = "|".join(f"{n:.0f}" for n in (1e3, 1e4, 1e5, 1e6) if n <= most)
    found = benchmarks_of(PROGRAMS / "bench_meshing", f"^whole/({names})$")
    head = [f"{float(row['name'].split('/')[1]):,.0f}" for row in found]
    return ["internal nodes", *head], [["seconds", *(f"{cpu_seconds(row):.2g}" for row in found)]]


def finding(sizes: list[Size]) -> str:
    """The study in one sentence."""
    parts = []
    for line, good in _lines(sizes):
        for stage, name in line.stages.items():
            seconds = [s.seconds(stage) for s in good]
            if stage == "solve" and len(good) > 1 and min(seconds) > 0:
                power = slope([s.n_nodes for s in good], seconds)
                parts.append(f"{name} of {label_of(line.model)} {power:.2f}")
    blocks = next((good for line, good in _lines(sizes) if line.model == _NETWORK), [])
    lemma = ""
    if blocks:
        first, last = blocks[0].blocks_per_node, blocks[-1].blocks_per_node
        lemma = f"; the PCP network keeps {first:.1f} to {last:.1f} blocks a node, as Lemma 1 says"
    return f"Seconds grow with the nodes to the power of: {', '.join(parts)}{lemma}."


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Seconds, memory and non-zeros over the number of nodes."""
    sizes, repetitions = ([300.0, 1000.0], 2) if arguments.quick else ([1e3, 1e4, 1e5, 4e5, 2e6], 3)
    repetitions = arguments.repetitions or repetitions
    with alone(arguments.quiet):
        measured = measure(
            SCENES / "bar_sag.toml",
            Store(folder / "runs", _TIME_LIMIT),
            sizes,
            repetitions,
            arguments.quiet,
        )
        networks = table_of_networks(1e3 if arguments.quick else 1e6)
    figures: Figures = {
        "scaling_seconds": (
            plot_seconds(measured),
            "Seconds of every stage on one thread, median; slopes in brackets.",
        ),
        "scaling_memory": (plot_memory(measured), "Largest resident memory of the whole run."),
        "scaling_lemma_1": (plot_lemma(measured), "Lemma 1: non-zero blocks of the springs' matrix."),
    }
    sections = [
        Section("Growth with the nodes", [], figures, {"exponents": table_of_exponents(measured)}),
        Section("Every stage", [], {}, {"scaling": table(measured)}),
        Section("Sampling, PCP and completion", [], {}, {"networks": networks}),
    ]
    return Result("Scaling", finding(measured), sections)
