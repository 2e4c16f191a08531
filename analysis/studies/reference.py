"""The reference by itself: what its degree and refinement lose, what explicit steps of it cost, and frequencies beside springs'.

Locking is the elastic energy that is missing beside the finest mesh, of a sagging bar over Poisson's ratios. Explicit steps are
those of a swinging bar. Their CPU seconds are those of the solution at half the stable step. Their errors are those of one short
step for all, against refined quadratic elements in implicit steps. Frequencies are those of a free bar, over the reference's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..compare import trajectory_error
from ..paths import SCENES
from ..progress import say
from ..report import Table
from ..run_store import Outcome, RunRequest, Store, each
from ..runs import RunError, load_run
from ..wording import percent, percent_signed, significant
from .result import Result, Section, alone

RATIOS = ("0.25", "0.45", "0.49", "0.499")  # Poisson's
MESHES = (
    (1, 0),
    (1, 1),
    (1, 2),
    (2, 0),
    (2, 1),
    (2, 2),
)  # degree and refinement; nothing is missing of the last
_BAR = ("surface.shape=bar", "surface.size=[4,1,1.3]", "surface.n_vertices=1600", "material.nu=0.3")
_SPRINGS = {
    "node_averaged": ("network.calibration=node_averaged",),
    "the same, lumped masses": ("network.calibration=node_averaged", "network.mass=lumped"),
    "edge_coupled": ("network.calibration=edge_coupled",),
}
_N_FREQUENCIES = 6
#: Explicit method -> its program, keys and the step (s) at which its error is taken.
_EXPLICIT = {
    "linear elements": ("fem_reference", ("reference.degree=1", "reference.integrator=central_differences"), 2.0**-6),
    "quadratic elements": ("fem_reference", ("reference.degree=2", "reference.integrator=central_differences"), 2.0**-7),
    "edge_coupled": ("massspring", ("network.calibration=edge_coupled", "time.integrator=symplectic_euler"), 2.0**-6),
    "node_averaged": ("massspring", ("network.calibration=node_averaged", "time.integrator=symplectic_euler"), 2.0**-6),
}  # fmt: skip
_SQUASHED = 1.0  # m, of the ball's 2
#: Ends of a squashed ball -> degree, vertices and load steps, and how both ends are held.
_SQUASHES = {
    "clamped": ((2, 162, 8), (2, 162, 64), (2, 642, 8), (1, 162, 8), (1, 642, 8)),
    "rolling": ((2, 162, 8), (1, 162, 8)),
}
_ENDS = {"clamped": '"xyz"', "rolling": '"y"'}
_FEW_FILES = ("output.frames_every=0", "output.curves=false")  # of a run that is timed
_FRAMES = 2.0  # ms, between two of a motion
_IMPLICIT = 0.25  # ms, steps of the reference


def solved(store: Store, point: RunRequest) -> Outcome:
    """Raises RunError for a run that is not ok."""
    outcome = store.run(point)
    if outcome.status != "ok":
        raise RunError(f"{point.program}: {outcome.status}: {outcome.message}")
    return outcome


def locking(store: Store, n_vertices: int) -> Table:
    """Elastic energy that is missing, a row for each Poisson's ratio and a column for each mesh."""
    requests = [
        RunRequest(
            "fem_reference", SCENES / "bar_sag.toml",
            (
                f"surface.n_vertices={n_vertices}", f"material.nu={nu}", f"reference.degree={degree}",
                f"reference.refine={refine}",
            ),
        )
        for nu in RATIOS
        for degree, refine in MESHES
    ]  # fmt: skip
    made = each(lambda request: solved(store, request), requests)
    rows = []
    for nu in RATIOS:
        runs = [next(made) for _ in MESHES]
        *energies, all_of_it = (load_run(run.folder).curves["elastic_energy"][-1] for run in runs)
        rows.append([nu, *(percent(1 - energy / all_of_it, 2) for energy in energies)])
    sizes = [
        f"degree {degree}: {run.record['n_dofs']}" for (degree, _), run in zip(MESHES, runs, strict=True)
    ]
    return ["nu", *sizes[:-1]], rows


def frequencies(store: Store) -> Table:
    """Of springs over those of the reference, the lowest of a bar."""

    def lowest(program: str, *overrides: str) -> list[float]:
        point = RunRequest(
            program, SCENES / "ball_pressure.toml", (*_BAR, *overrides), ("--frequencies", str(_N_FREQUENCIES))
        )  # fmt: skip
        found: list[float] = solved(store, point).record["natural_frequencies"]
        return found

    exact = lowest("fem_reference")
    rows = [
        [name, *(percent_signed(f / g - 1) for f, g in zip(lowest("massspring", *keys), exact, strict=True))]
        for name, keys in _SPRINGS.items()
    ]
    return ["", "first", "second", "third", "fourth", "fifth", "sixth"], rows


def explicit(store: Store) -> Table:
    """Explicit steps of elements and springs on the surface of bar_swing."""
    scene = SCENES / "bar_swing.toml"

    def at(step: float) -> tuple[str, ...]:
        return f"time.step={step * 1e-3!r}", f"output.frames_every={round(_FRAMES / step)}"

    reference = RunRequest(
        "fem_reference", scene, ("reference.degree=2", "reference.refine=1", *at(_IMPLICIT))
    )
    exact = load_run(solved(store, reference).folder)
    rows = []
    for name, (program, keys, step) in _EXPLICIT.items():
        options = ("--no-diagnostics",) if program == "massspring" else ()
        words = (*keys, "time.step=0", *_FEW_FILES)
        timed = solved(store, RunRequest(program, scene, words, options, is_timed=True))
        error = trajectory_error(
            load_run(solved(store, RunRequest(program, scene, (*keys, *at(step)), options)).folder), exact
        )
        cells = [1e6 * timed.record["step"], timed.record["seconds"]["solve"]]
        rows.append(
            [name, str(timed.record["n_nodes"]), *(significant(c, 2) for c in cells), percent(error.l2, 2)]
        )
    return ["explicit", "nodes", "step (us)", "seconds of all steps", "error"], rows


def squashed(store: Store) -> Table:
    """How far a ball between two ends is squashed, and the least det F there."""
    rows = []
    for ends, tries in _SQUASHES.items():
        for degree, n_vertices, n_steps in tries:
            keys = [f"supports.{n}.components={_ENDS[ends]}" for n in (0, 1)]
            keys += [
                f"surface.n_vertices={n_vertices}",
                f"reference.degree={degree}",
                f"time.load_steps={n_steps}",
            ]
            keys.append(f"supports.1.displacement=[0, -{_SQUASHED}, 0]")
            outcome = store.run(RunRequest("fem_reference", SCENES / "squash.toml", tuple(keys)))
            run = load_run(outcome.folder, may_stop=True)
            least = [significant(float(run.curves[name][-1]), 2) for name in ("min_J", "min_J_nodes")]
            reached = percent(run.times[-1] * _SQUASHED / 2)
            rows.append(
                [
                    ends,
                    f"{degree}",
                    f"{n_vertices}",
                    f"{n_steps}",
                    reached,
                    *least,
                    outcome.message.partition(" was found")[0] or "ok",
                ]
            )
    return [
        "ends",
        "degree",
        "vertices",
        "load steps",
        "squashed by",
        "least det F",
        "at nodes",
        "ends with",
    ], rows


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: locking on few vertices alone."""
    store = Store(folder / "runs")
    say("locking", arguments.quiet)
    table = locking(store, 60 if arguments.quick else 300)
    sections = [Section("Locking: missing elastic energy", [], {}, {"locking": table})]
    if not arguments.quick:
        say("frequencies", arguments.quiet)
        sections.append(Section("Frequencies", [], {}, {"frequencies": frequencies(store)}))
        say("a ball squashed", arguments.quiet)
        sections.append(Section("Squashed as far as it goes", [], {}, {"squashed": squashed(store)}))
        say("explicit steps", arguments.quiet)
        with alone(arguments.quiet):
            sections.append(Section("Explicit steps", [], {}, {"explicit": explicit(store)}))
    _, (first, *_, last) = table
    finding = f"Linear elements miss {first[1]} of the elastic energy at nu = {first[0]}, {last[1]} at nu = {last[0]}."
    return Result("The reference by itself", finding, sections)
