"""Kernels: CPU seconds of what the solvers spend their time in, beside the machine's limits and, if asked for, an earlier state.

Whole runs and benchmarks of single kernels alternate between the two states, and the least of the repetitions counts. A state
of the sources runs its own scenes, with the same overrides. The limit of a kernel is the larger of the times that its
floating-point operations and its bytes take at the rates that the same benchmark measures on this machine.
"""

from __future__ import annotations

import argparse
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from ..paths import ROOT
from ..progress import say
from ..report import Table
from ..run_store import Outcome, RunRequest, Store
from ..runs import RunError
from ..wording import significant
from .benchmarks import benchmarks_of, cpu_seconds
from .result import Result, Section, alone

_FEW_FILES = ("output.frames_every=0", "output.curves=false")
_SOLVING = ("setup", "assemble", "solve")
_N_EXPLICIT = 1000
_EXPLICIT = ("time.mode=dynamic", "time.step=1e-6", f"time.end={_N_EXPLICIT * 1e-6}")
_PROGRAMS = ("massspring", "fem_reference", "gmsh_worker", "tetgen_worker", "bench_step", "bench_reference")
_KERNELS = "^(kernel|coupled|elements)/"  # of the benchmarks that know their limit
_VERTICES_OF_5E4_NODES = {"springs": 9760, "quadratic": 2600}  # of the bar's surface


@dataclass(frozen=True)
class Case:
    """A run of which `stages` are timed."""

    name: str
    program: str
    scene: str
    overrides: tuple[str, ...] = ()
    stages: tuple[str, ...] = _SOLVING
    n_steps: int = 1  #: by which seconds are divided


def _springs(calibration: str) -> str:
    return f"network.calibration={calibration}"


CASES = [
    *(
        Case(f"bar_bend, {name} elements", "fem_reference", "bar_bend", (f"reference.degree={degree}",))
        for degree, name in ((2, "quadratic"), (1, "linear"))
    ),
    *(
        Case(f"bar_bend, `{name}`", "massspring", "bar_bend", (_springs(name),))
        for name in ("node_averaged", "edge_coupled")
    ),
    *(
        Case(f"bar_sag, `node_averaged`, {n} vertices", "massspring", "bar_sag", (f"surface.n_vertices={n}",))
        for n in (900, 3600)
    ),
    Case("bar_sag, quadratic elements", "fem_reference", "bar_sag"),
    Case("bar_swing, `node_averaged`, midpoint", "massspring", "bar_swing", ("time.integrator=midpoint",)),
    Case("bar_swing, quadratic elements, Newmark", "fem_reference", "bar_swing"),
    *(
        Case(
            f"bar_swing, {name} elements, central differences",
            "fem_reference",
            "bar_swing",
            (f"reference.degree={degree}", "reference.integrator=central_differences", "time.step=0"),
        )
        for degree, name in ((1, "linear"), (2, "quadratic"))
    ),
    *(
        Case(
            f"bar_swing, `{name}`, symplectic Euler",
            "massspring",
            "bar_swing",
            (_springs(name), "time.integrator=symplectic_euler", "time.step=0"),
        )
        for name in ("edge_coupled", "node_averaged")
    ),
    Case(
        "static solve of 5e4 nodes, `node_averaged`",
        "massspring",
        "bar_sag",
        ("time.load_steps=1", f"surface.n_vertices={_VERTICES_OF_5E4_NODES['springs']}"),
    ),
    Case(
        "static solve of 5e4 nodes, quadratic elements",
        "fem_reference",
        "bar_sag",
        ("time.load_steps=1", f"surface.n_vertices={_VERTICES_OF_5E4_NODES['quadratic']}"),
    ),
    *(
        Case(
            f"explicit step on bar_bend, `{name}`",
            "massspring",
            "bar_bend",
            (_springs(name), "time.integrator=symplectic_euler", *_EXPLICIT),
            ("solve",),
            _N_EXPLICIT,
        )
        for name in ("edge_coupled", "node_averaged")
    ),
]


@dataclass(frozen=True)
class Tree:
    """A built state of the sources."""

    name: str
    root: Path
    overrides: tuple[str, ...] = ()  #: of keys that not every state knows

    @property
    def programs(self) -> Path:
        return self.root / "build" / "bin"

    def scene(self, name: str) -> Path:
        return self.root / "analysis" / "scenes" / f"{name}.toml"


@dataclass
class Timed:
    """A case, or a benchmark, in every tree."""

    name: str
    seconds: dict[str, float] = field(default_factory=dict)  #: tree -> least seconds
    cpu: dict[str, float] = field(default_factory=dict)  #: tree -> least CPU seconds of the whole process
    over_limit: float | None = None  #: in the present tree
    message: str = ""

    def note(self, tree: str, seconds: float) -> None:
        self.seconds[tree] = min(seconds, self.seconds.get(tree, seconds))


def build_at(commit: str, folder: Path, is_quiet: bool) -> Tree:
    """The programs of a commit, built apart, whose own start script installs the packages that they need.

    Raises RunError where there is no such commit or it does not build.
    """
    root = folder / f"before-{commit.replace('/', '-')}"
    tree = Tree(commit, root)
    if not (root / "CMakeLists.txt").exists():
        root.mkdir(parents=True, exist_ok=True)
        say(f"taking the sources of {commit}", is_quiet)
        archive = subprocess.run(
            ["git", "-C", str(ROOT), "archive", commit], capture_output=True, check=False
        )
        if archive.returncode != 0:
            raise RunError(f"--against {commit}: {archive.stderr.decode().strip()}")
        subprocess.run(["tar", "-x", "-C", str(root)], input=archive.stdout, check=True)
    say(f"building {commit}", is_quiet)
    for command in (
        [str(root / "testbed"), "massspring", "--help"],
        ["ninja", "-C", str(root / "build"), *_PROGRAMS],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RunError(f"--against {commit} does not build: {(done.stdout + done.stderr)[-2000:]}")
    return tree


def seconds_of(case: Case, outcome: Outcome) -> float:
    """Of the case's stages, a step of them where it has several."""
    stages: dict[str, float] = outcome.record["seconds"]
    return sum(stages.get(stage, 0) for stage in case.stages) / case.n_steps


def measure_runs(
    trees: list[Tree], folder: Path, repetitions: int, limit: float, is_quiet: bool
) -> list[Timed]:
    timed = {case: Timed(case.name) for case in CASES}
    stores = {tree: Store(folder / "runs" / tree.name, limit, tree.programs) for tree in trees}
    for repetition in range(repetitions):
        for case, result in timed.items():
            for tree, store in stores.items():
                request = RunRequest(
                    case.program,
                    tree.scene(case.scene),
                    (*case.overrides, *tree.overrides, *_FEW_FILES),
                    ("--no-diagnostics",) if case.program == "massspring" else (),
                    repetition=repetition,
                )
                outcome = store.run(request)
                if outcome.status != "ok":
                    result.message = f"{tree.name}: {outcome.status}: {outcome.message}"
                    continue
                result.note(tree.name, seconds_of(case, outcome))
                result.cpu[tree.name] = min(outcome.cpu, result.cpu.get(tree.name, outcome.cpu))
            seconds = ", ".join(f"{name} {value:.3g} s" for name, value in result.seconds.items())
            say(f"[{repetition + 1}/{repetitions}] {case.name}: {seconds} {result.message}", is_quiet)
    return list(timed.values())


def measure_kernels(trees: list[Tree], repetitions: int, is_quiet: bool) -> list[Timed]:
    timed: dict[str, Timed] = {}
    for repetition in range(repetitions):
        for program in ("bench_step", "bench_reference"):
            for tree in trees:
                say(f"[{repetition + 1}/{repetitions}] {program} of {tree.name}", is_quiet)
                for benchmark in benchmarks_of(tree.programs / program, _KERNELS):
                    result = timed.setdefault(benchmark["name"], Timed(benchmark["name"]))
                    result.note(tree.name, cpu_seconds(benchmark))
                    if tree is trees[-1] and "over_limit" in benchmark:
                        result.over_limit = min(
                            benchmark["over_limit"], result.over_limit or benchmark["over_limit"]
                        )
    return list(timed.values())


def ratio(timed: Timed, trees: list[Tree]) -> float | None:
    """How many times as fast the present tree is as the one before; None where one of them has no result."""
    first, last = trees[0].name, trees[-1].name
    if len(trees) < 2 or first not in timed.seconds or last not in timed.seconds:
        return None
    return timed.seconds[first] / timed.seconds[last]


def _cell(value: float | None, form: str = ".3g") -> str:
    return "-" if value is None else f"{value:{form}}"


def table_of_runs(timed: list[Timed], trees: list[Tree]) -> Table:
    head = [
        "run",
        *(f"{what} {tree.name}" for what in ("solving (s),", "CPU (s),") for tree in trees),
        "times as fast",
        "",
    ]
    rows = [
        [
            t.name,
            *(_cell(t.seconds.get(tree.name)) for tree in trees),
            *(_cell(t.cpu.get(tree.name)) for tree in trees),
            _cell(ratio(t, trees), ".2f"),
            t.message,
        ]
        for t in timed
    ]
    return head, rows


def table_of_kernels(timed: list[Timed], trees: list[Tree]) -> Table:
    names = [tree.name for tree in trees]
    head = ["kernel", *(f"us, {name}" for name in names), "times as fast", "over its limit"]
    rows = [
        [
            t.name,
            *(significant(1e6 * t.seconds[name], 4) if name in t.seconds else "-" for name in names),
            _cell(ratio(t, trees), ".2f"),
            _cell(t.over_limit, ".2f"),
        ]
        for t in timed
    ]
    return head, rows


def finding(runs: list[Timed], kernels: list[Timed], trees: list[Tree]) -> str:
    """The study in one or two sentences."""
    ratios = [(value, t.name) for t in runs if (value := ratio(t, trees)) is not None]
    limits = [(t.over_limit, t.name) for t in kernels if t.over_limit is not None]
    parts = []
    if ratios:
        least, most = min(ratios), max(ratios)
        parts.append(
            f"Since {trees[0].name} runs are {least[0]:.1f} ({least[1]}) to {most[0]:.1f} ({most[1]}) times as fast."
        )
    if limits:
        best, worst = min(limits), max(limits)
        parts.append(
            f"Kernels take {best[0]:.1f} ({best[1]}) to {worst[0]:.1f} ({worst[1]}) times their limit."
        )
    return " ".join(parts) or "No state to compare with (--against) and no kernel that knows its limit."


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Seconds of solving, and of single kernels, before and after."""
    repetitions = arguments.repetitions or (1 if arguments.quick else 5)
    trees = [Tree("now", ROOT, ("network.estimate=false",))]
    if arguments.against:
        trees.insert(0, build_at(arguments.against, folder, arguments.quiet))
    with alone(arguments.quiet):
        runs = measure_runs(trees, folder, repetitions, arguments.time_limit, arguments.quiet)
        kernels = measure_kernels(trees, 1 if arguments.quick else min(repetitions, 3), arguments.quiet)
    sections = [
        Section(
            "Whole runs",
            ["Solving is set-up, assembly and solution, without meshing."],
            {},
            {"runs": table_of_runs(runs, trees)},
        ),
        Section("Kernels", ["CPU time of one call."], {}, {"kernels": table_of_kernels(kernels, trees)}),
    ]
    return Result("Solvers and kernels", finding(runs, kernels, trees), sections)
