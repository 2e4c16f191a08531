"""What each part of a scene costs in a time step, and that a part costs nothing where a scene does not have it.

Parts are switched on one at a time beside the springs alone. Counted are the processor's instructions (valgrind), which do not
depend on who else uses the machine: those of a run of 2 n steps less those of one of n, over n, so that set-up and
start-up do not count. A part that the program only checks for costs its row's difference at the most.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from ..drawing.style import style_of, svg_of
from ..paths import write_text
from ..progress import say
from ..report import Table
from ..run_store import RunRequest, Store
from .result import Figures, Result, Section

_VALGRIND = ("valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null")
STEP = 1e-4  # s
_N_STEPS = 20
SCENE = f"""name = "cost"
[surface]
shape = "ball"
n_vertices = 642
[time]
mode = "dynamic"
step = {STEP}
integrator = "symplectic_euler"
[network]
calibration = "uniform"
[[initial]] # a body that nothing moves is refused
velocity = [0, 1e-3, 0]
[output]
frames_every = 0
curves = false
"""
ALONE = "springs alone"

# Name -> overrides. A new part is a new line.
PARTS: dict[str, tuple[str, ...]] = {
    ALONE: (),
    "gravity": ("gravity=[0, -9.81, 0]",),
    "pressure": ("loads=[{ pressure = 100 }]",),
    "pressure that follows": ("loads=[{ pressure = 100, follower = true }]",),
    "supports": ("supports=[{ region = { box = { low = [0, 0, 0], high = [1, 0.1, 1] }, relative = true } }]",),
    "damping of the motion": ("material.damping=1",),
    "damping of springs": ("network.spring_damping=0.1",),
    "collapse": ("collapse={ coefficient = 0.1, pivots = [{ point = [0, 0, 0] }] }",),
    "volume, enclosed": ("volume.coefficient=1e5",),
    "skin, membrane": ("skin.stiffness=100",),
    "skin, bending": ("skin.bending=0.1",),
    "skin, relaxation": ("skin.bending=0.1", "skin.relaxation=0.1"),
    "floor, far away": ("obstacles=[{ plane = { point = [0, -9, 0], normal = [0, 1, 0] } }]",),
    "ceiling, touched": ("obstacles=[{ plane = { point = [0, 1, 0], normal = [0, -1, 0] } }]",),
    "self-contact": ("self_contact.on=true",),
    "curves": ("output.curves=true",),
    "a frame every step": ("output.frames_every=1",),
    "implicit Euler": ("time.integrator=implicit_euler",),
    "node_averaged springs": ("network.calibration=node_averaged",),
    "the same, volume of tetrahedra": ("network.calibration=node_averaged", "volume.local=1e5"),
}  # fmt: skip


@dataclass(frozen=True)
class Cost:
    part: str
    instructions: float | None  #: a step
    message: str = ""


def instructions_of(messages: str) -> float:
    """The count in valgrind's messages. Raises ValueError where there is none."""
    found = re.search(r"I\s+refs:\s+([\d,]+)", messages)
    if not found:
        raise ValueError("valgrind counted nothing")
    return float(found[1].replace(",", ""))


def measure(folder: Path, store: Store, is_quiet: bool) -> list[Cost]:
    """Instructions of a step with each part."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = folder / "cost.toml"
    write_text(scene, SCENE)
    costs = []
    for part, overrides in PARTS.items():
        counts = []
        message = ""
        for n in (_N_STEPS, 2 * _N_STEPS):
            request = RunRequest(
                "massspring", scene, (f"time.end={n * STEP}", *overrides), ("--no-diagnostics",), _VALGRIND
            )
            outcome = store.run(request)
            if outcome.status != "ok":
                message = f"{outcome.status}: {outcome.message}"
                break
            counts.append(instructions_of((outcome.folder / "messages.txt").read_text()))
        cost = Cost(part, None, message) if message else Cost(part, (counts[1] - counts[0]) / _N_STEPS)
        costs.append(cost)
        say(f"{part}: {message or f'{cost.instructions:.3g} instructions a step'}", is_quiet)
    return costs


def shares(costs: list[Cost]) -> list[tuple[str, float]]:
    """What a part adds to a step, as a fraction of the step of the springs alone."""
    alone = next(cost.instructions for cost in costs if cost.part == ALONE)
    if not alone:
        return []
    return [
        (c.part, c.instructions / alone - 1) for c in costs if c.part != ALONE and c.instructions is not None
    ]


def table(costs: list[Cost]) -> Table:
    known = dict(shares(costs))
    rows = [
        [
            cost.part,
            "-" if cost.instructions is None else f"{cost.instructions:.4g}",
            f"{100 * known[cost.part]:+.1f} %" if cost.part in known else "-",
            cost.message,
        ]
        for cost in costs
    ]
    return ["part", "instructions a step", "of the springs alone", ""], rows


def plot(costs: list[Cost]) -> str:
    known = shares(costs)
    figure = Figure(figsize=(7, 0.8 + 0.28 * len(known)))
    axes = figure.subplots()
    bars = axes.barh(
        [name for name, _ in known], [100 * share for _, share in known], color=style_of("uniform").colour
    )
    axes.bar_label(bars, [f"{100 * share:+.1f}" for _, share in known], padding=3, fontsize=8)
    axes.set_xscale("symlog", linthresh=1)
    axes.invert_yaxis()
    axes.margins(x=0.15)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("added to a step of the springs alone (% of its instructions)")
    return svg_of(figure)


def finding(costs: list[Cost]) -> str:
    """The study in one sentence."""
    known = sorted(shares(costs), key=lambda share: -share[1])
    failed = [cost.part for cost in costs if cost.message]
    if not known:
        return "Nothing could be counted: " + next(cost.message for cost in costs if cost.message)
    dear = ", ".join(f"{name} {100 * share:+.0f} %" for name, share in known[:3])
    free = ", ".join(name for name, share in known if abs(share) < 0.01)
    words = f"Beside the springs alone the dearest parts of a step are {dear}"
    words += f"; below 1 % stay {free}" if free else ""
    return words + (f". No result: {', '.join(failed)}." if failed else ".")


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Instructions of a step, part by part."""
    store = Store(folder / "runs")
    costs = measure(folder, store, arguments.quiet)
    figures: Figures = {}
    if shares(costs):
        figures = {"cost": (plot(costs), "What each part adds to a step, counted instructions.")}
    section = Section("Part by part", [], figures, {"cost": table(costs)})
    protocol = {"cost.toml: springs alone": (folder / "cost.toml").read_text()}
    return Result("What each part costs", finding(costs), [section], protocol)
