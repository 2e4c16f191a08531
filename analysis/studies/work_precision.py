"""Work and precision: the error that every method reaches, and the seconds that it takes.

Static scenes of a generated shape are solved on a ladder of surfaces, dynamic ones with a ladder of time steps. The error is
that of the displacement at the surface's vertices against quadratic finite elements on the same surface, its tetrahedra
refined: the same polyhedron with the same vertices, so that nothing is interpolated and the error is the solver's
alone, none of it the surface's distance from a smooth shape. How far that reference itself can be trusted is
estimated from its own refinements.

Static solves of both programs stop at a residual of 1e-4 of load plus internal forces, which changes displacements by less
than a millionth. Both take one thread.

Runs are timed one at a time, interleaved: every method once, then every method again. Seconds leave out the writing of
files, and what the springs' program spends on diagnosing itself.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..compare import compare_runs, trajectory_error
from ..drawing.plots import SMALLEST
from ..drawing.style import style_of, svg_of
from ..front import seconds_for
from ..methods import ELEMENTS, FEM_P1, FEM_P1_EXPLICIT, FEM_P2, FEM_P2_EXPLICIT, label_of
from ..paths import SCENES
from ..points import Outcome, Point, Store, say
from ..report import Table
from ..runs import RunError, load_run
from ..wording import percent, significant
from ..wording import seconds as seconds_in_words
from .result import Figures, Result, Section, alone

CALIBRATIONS = [
    "uniform", "affine", "van_gelder", "lloyd", "moment", "edge_coupled", "node_averaged"
]  # fmt: skip
_DYNAMIC = ["uniform", "edge_coupled", "node_averaged"]
_INTEGRATORS = {"symplectic_euler": ":", "implicit_euler": "--", "midpoint": "-"}
_EXPLICIT = {"symplectic_euler"}
_EXPLICIT_STEPS = tuple(2.0**-k for k in range(1, 7))  # over the scene's step; the longer ones may diverge
_LEVELS = (0.1, 0.03, 0.01, 0.003, 0.001)  # errors at which methods are compared in words
_TOLERANCE = (
    1e-4  # of linear statics, of every method alike: changes displacements by less than 1e-6, measured
)
_USABLE = 0.3  # what is further off is no answer, however fast
_SETUP = ("mesh", "setup", "assemble")


@dataclass(frozen=True)
class Effort:
    """How much a study may do."""

    factors: tuple[float, ...]  #: on a static scene's number of vertices
    steps: tuple[float, ...]  #: on a dynamic scene's time step
    repetitions: int
    reference_tetrahedra: int  #: a linear static reference is refined while it has fewer; others get a sixth


FULL = Effort((0.0625, 0.125, 0.25, 0.5, 1, 2, 4), (0.25, 0.5, 1, 2, 4), 5, 400_000)
QUICK = Effort((0.125, 0.25), (1, 2), 2, 60_000)


@dataclass(frozen=True)
class Method:
    """A solver with its settings: a line of the plot."""

    name: str
    program: str
    overrides: tuple[str, ...]
    model: str  #: whose colour it has
    line: str = "-"
    factors: tuple[float, ...] = ()  #: its own ladder instead of the study's


@dataclass
class Measurement:
    """One method at one rung of the ladder."""

    method: Method
    factor: float
    outcomes: list[Outcome] = field(default_factory=list)
    error: float | None = None
    reference_error: float | None = None
    message: str = ""

    @property
    def is_good(self) -> bool:
        return self.error is not None

    def seconds(self, *stages: str) -> list[float]:
        """Of every repetition, the sum over the stages; without any, over all but the output."""
        return [
            sum(
                s
                for stage, s in run.record["seconds"].items()
                if (stage in stages if stages else stage != "output")
            )
            for run in self.outcomes
        ]

    @property
    def memory(self) -> float:
        """Byte, largest of all repetitions."""
        return max(run.record.get("peak_memory", 0) for run in self.outcomes)

    @property
    def whole(self) -> float:
        return median(self.seconds())

    @property
    def is_resolved(self) -> bool:
        """The error stands clear of the reference's own."""
        return self.error is not None and self.error > 2 * (self.reference_error or 0)


def is_dynamic(scene: dict[str, Any]) -> bool:
    return scene.get("time", {}).get("mode") == "dynamic"


def is_linear(scene: dict[str, Any]) -> bool:
    """The law that a scene names, or else the one that the solvers take [large_strain_part of meshing/scene]."""
    if "law" in scene.get("material", {}):
        return scene["material"]["law"] == "small_strain"
    return not (
        scene.get("obstacles")
        or scene.get("self_contact", {}).get("on")
        or "skin" in scene
        or "volume" in scene
        or any(load.get("follower") for load in scene.get("loads", []))
        or ("collapse" in scene and is_dynamic(scene))
    )


def methods_of(scene: dict[str, Any]) -> list[Method]:
    """Every method for a scene, each with the settings that suit it."""
    # One step is enough where the displacement is proportional to the load.
    is_one_step = not is_dynamic(scene) and is_linear(scene)
    loose = ("time.load_steps=1", f"time.residual={_TOLERANCE}") if is_one_step else ()
    elements = [
        Method(FEM_P1, "fem_reference", (*loose, "reference.degree=1"), FEM_P1),
        Method(FEM_P2, "fem_reference", (*loose, "reference.degree=2"), FEM_P2),
    ]
    if not is_dynamic(scene):
        springs = [Method(n, "massspring", (*loose, f"network.calibration={n}"), n) for n in CALIBRATIONS]
        return springs + elements
    springs = [
        Method(
            f"{name}, {scheme}", "massspring", (f"network.calibration={name}", f"time.integrator={scheme}"), name, line,
            _EXPLICIT_STEPS if scheme in _EXPLICIT else (),
        )
        for name in _DYNAMIC
        for scheme, line in _INTEGRATORS.items()
    ]  # fmt: skip
    explicit = [
        Method(name, m.program, (*m.overrides, "reference.integrator=central_differences"), m.model, ":", _EXPLICIT_STEPS)
        for name, m in zip((FEM_P1_EXPLICIT, FEM_P2_EXPLICIT), elements, strict=True)
    ]  # fmt: skip
    return springs + elements + explicit


class SceneStudy:
    """All measurements of one scene."""

    def __init__(self, file: Path, effort: Effort, timed: Store, store: Store) -> None:
        """timed: runs the methods, store: the references, which may take longer."""
        self.file, self.effort, self.timed, self.store = file, effort, timed, store
        self.scene = tomllib.loads(file.read_text())
        surface = self.scene.get("surface", {})
        if not is_dynamic(self.scene) and not surface.get("shape"):
            raise RunError(
                f"{file}: surface.shape is missing, expected a generated shape for a ladder of resolutions"
            )
        if is_dynamic(self.scene) and not self.scene["time"].get("step"):
            raise RunError(f"{file}: time.step is missing, expected the step that the ladder starts from")
        self.measurements = [
            Measurement(method, factor)
            for factor in (sorted(effort.steps, reverse=True) if is_dynamic(self.scene) else effort.factors)
            for method in methods_of(self.scene)
            if not method.factors
        ] + [
            Measurement(method, factor)
            for method in methods_of(self.scene)
            for factor in method.factors
        ]  # fmt: skip
        self.references: dict[float, tuple[Outcome, float]] = {}

    @property
    def name(self) -> str:
        return self.scene.get("name", self.file.stem)

    def rung(self, factor: float) -> tuple[str, ...]:
        """Overrides of a rung of the ladder."""
        if not is_dynamic(self.scene):
            return (
                f"surface.n_vertices={round(factor * self.scene['surface'].get('n_vertices', 642))}",
                "output.frames_every=0",
            )
        # All runs write frames at the same moments, one in each longest step of the ladder.
        longest = max(self.effort.steps)
        return (
            f"time.step={factor * self.scene['time']['step']!r}",
            f"output.frames_every={round(longest / factor)}",
        )

    def point(self, m: Measurement, repetition: int) -> Point:
        options = ("--no-diagnostics",) if m.method.program == "massspring" else ()
        overrides = (*self.rung(m.factor), *m.method.overrides)
        return Point(m.method.program, self.file, overrides, options, repetition=repetition)

    def run(self, is_quiet: bool) -> None:
        """Times every method, then measures their errors."""
        slow: set[Method] = set()
        for repetition in range(self.effort.repetitions):
            for number, m in enumerate(self.measurements, 1):
                if len(m.outcomes) != repetition:
                    continue  # it failed at first
                if repetition == 0 and m.method in slow:
                    m.message = "not tried: beyond the time limit on a coarser rung"
                    continue
                outcome = self.timed.run(self.point(m, repetition))
                if outcome.status == "ok":
                    m.outcomes.append(outcome)
                elif repetition == 0:
                    if outcome.status == "time limit":
                        slow.add(m.method)
                    m.message = f"{outcome.status}: {outcome.message}".removesuffix(": ")
                done = f"{self.name} [{repetition + 1}/{self.effort.repetitions}, {number}/{len(self.measurements)}]"
                say(
                    f"{done} {m.method.name} x {m.factor:g}: {m.message or f'{outcome.wall:.2f} s'}", is_quiet
                )
        for m in self.measurements:
            if m.outcomes:
                self._compare(m, is_quiet)

    def _compare(self, m: Measurement, is_quiet: bool) -> None:
        try:
            reference, m.reference_error = self._reference(m.factor, is_quiet)
            run, exact = load_run(m.outcomes[0].folder), load_run(reference.folder)
            if is_dynamic(self.scene):
                m.error = trajectory_error(run, exact).l2
            else:
                m.error = compare_runs(run, exact, exact.record["is_free"]).displacement_error_l2
        except RunError as error:
            m.message = str(error)

    def _reference(self, factor: float, is_quiet: bool) -> tuple[Outcome, float]:
        """The converged reference of a rung and its own estimated error; dynamic scenes have one for all."""
        if is_dynamic(self.scene):
            factor = 1.0
        if factor not in self.references:
            say(f"{self.name}: reference x {factor:g}", is_quiet)
            self.references[factor] = (
                self._dynamic_reference() if is_dynamic(self.scene) else self._static_reference(factor)
            )
        return self.references[factor]

    def _run_reference(self, *overrides: str, options: tuple[str, ...] = ()) -> Outcome:
        outcome = self.store.run(Point("fem_reference", self.file, overrides, options))
        if outcome.status != "ok":
            raise RunError(f"no reference: {outcome.status}: {outcome.message}")
        return outcome

    def _refinements(self, plain: Outcome) -> int:
        limit = self.effort.reference_tetrahedra
        if is_dynamic(self.scene) or not is_linear(self.scene):
            limit //= 6
        return 2 if 64 * plain.record["n_tetrahedra"] <= limit else 1

    def _static_reference(self, factor: float) -> tuple[Outcome, float]:
        base = (
            *self.rung(factor),
            *(("time.load_steps=1",) if is_linear(self.scene) else ()),
            "reference.degree=2",
        )
        n = self._refinements(self._run_reference(*base))
        fine = self._run_reference(*base, f"reference.refine={n}")
        study = self._run_reference(*base, options=("--converge", "2")).record["convergence"]
        if study["status"] != "ok":
            raise RunError(f"no reference: its refinements are {study['status']}")
        # Estimated from the first refinement; every further one reduces it as much, at least.
        return fine, study["estimated_error_l2_finest"] / study["error_ratio"] ** (n - 1)

    def _dynamic_reference(self) -> tuple[Outcome, float]:
        """Refined in space and time; its error is what halving the step again (of second order) and refining changed."""
        shortest = min(self.effort.steps)

        def run(step: float, *more: str) -> Outcome:
            return self._run_reference(*self.rung(step), "reference.degree=2", *more)

        in_time, coarse = run(shortest / 4), run(shortest / 2)
        refine = f"reference.refine={self._refinements(coarse)}"
        fine = run(shortest / 4, refine)
        error_in_time = trajectory_error(load_run(coarse.folder), load_run(in_time.folder)).l2 / 3
        return fine, error_in_time + trajectory_error(load_run(in_time.folder), load_run(fine.folder)).l2


Curves = dict[str, list[tuple[float, float]]]


def curves_of(measurements: Iterable[Measurement]) -> Curves:
    """Method -> (seconds, error) of its good rungs."""
    curves: Curves = {}
    for m in measurements:
        if m.error is not None:
            curves.setdefault(m.method.name, []).append((m.whole, max(m.error, m.reference_error or 0)))
    return curves


def winners(curves: Curves) -> list[tuple[str, float, float]]:
    """Which method is the fastest at which errors, from _USABLE down: (method, from, down to), largest errors first."""
    errors = [error for curve in curves.values() for _, error in curve]
    if not errors:
        return []
    parts: list[tuple[str, float, float]] = []
    for error in np.geomspace(max(min(max(errors), _USABLE), min(errors)), min(errors), 400):
        known = {
            name: s
            for name, curve in curves.items()
            if (s := seconds_for(curve, error * (1 + 1e-9))) is not None
        }
        best = min(known, key=lambda name: known[name])
        if parts and parts[-1][0] == best:
            parts[-1] = (best, parts[-1][1], error)
        else:
            parts.append((best, error, error))
    return parts


def in_words(curves: Curves, elements: Sequence[str] = ELEMENTS) -> list[str]:
    """Sentences: who is fastest where, and the best springs against the best elements at round errors."""
    sentences = []
    parts = winners(curves)
    if len(parts) == 1:
        sentences.append(f"{label_of(parts[0][0])} is the fastest at every error reached.")
    elif parts:
        words = [f"{label_of(name)} down to {percent(low)}" for name, _, low in parts]
        sentences.append(f"The fastest is {', then '.join(words)}.")
    fem = {name: curve for name, curve in curves.items() if name in elements}
    springs = {name: curve for name, curve in curves.items() if name not in elements}
    for error in _LEVELS:
        best = [
            min(
                ((s, name) for name, curve in side.items() if (s := seconds_for(curve, error)) is not None),
                default=None,
            )
            for side in (springs, fem)
        ]
        if best[0] and best[1]:
            (a, spring), (b, element) = best  # type: ignore[misc]
            sentences.append(
                f"At {percent(error)} the best springs ({spring}) take {seconds_in_words(a)}, the best elements "
                f"({label_of(element)}) {seconds_in_words(b)}."
            )
        elif best[1]:
            sentences.append(
                f"No springs reach {percent(error)}; {label_of(best[1][1])} do in {seconds_in_words(best[1][0])}."
            )
        elif best[0]:
            sentences.append(
                f"No elements reach {percent(error)} on this ladder; {label_of(best[0][1])} do in {seconds_in_words(best[0][0])}."
            )
    return sentences


def advice(curves: Curves) -> list[list[str]]:
    """Rows: an error that may be asked for, down to the next, the fastest method that stays within, and its seconds."""
    rows = []
    for name, high, low in winners(curves):
        times = [seconds_for(curves[name], error * (1 + 1e-9)) for error in (high, low)]
        words = [seconds_in_words(time) for time in times if time is not None]
        rows.append(
            [f"{percent(high, 2)} to {percent(low, 2)}", label_of(name), " to ".join(dict.fromkeys(words))]
        )
    return rows


def plot(study: SceneStudy) -> str:
    """Error over the seconds of the whole run, and over those of the solve alone."""
    figure = Figure(figsize=(11, 5))
    axes: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    known = [m for m in study.measurements if m.error is not None]
    band = max((m.reference_error or 0 for m in known), default=0)
    methods = list(dict.fromkeys(m.method for m in known))
    for axis, stages, title in zip(
        axes, ((), ("solve",)), ("whole run, no files written", "solve alone"), strict=True
    ):
        for method in methods:
            rungs = [m for m in known if m.method == method]
            seconds = np.array([[median(s), min(s), max(s)] for m in rungs if (s := m.seconds(*stages))]).T
            errors = np.maximum([100 * m.error for m in rungs], SMALLEST)  # type: ignore[operator]
            colour, marker = style_of(method.model)
            label = label_of(method.name)
            if np.ptp(seconds[0]) > 0:
                label += f" ({np.polyfit(np.log(seconds[0]), np.log(errors), 1)[0]:.1f})"
            spread = [seconds[0] - seconds[1], seconds[2] - seconds[0]]
            axis.errorbar(
                seconds[0],
                errors,
                xerr=spread,
                color=colour,
                linestyle=method.line,
                elinewidth=1,
                label=label,
            )
            filled = np.array([m.is_resolved for m in rungs])
            for part, face in ((filled, colour), (~filled, "white")):
                axis.plot(
                    seconds[0][part], errors[part], marker, markerfacecolor=face, markeredgecolor=colour
                )
        axis.set_xscale("log")
        axis.set_yscale("log")
        if band > 0:
            low = max(min(100 * m.error for m in known), SMALLEST)  # type: ignore[operator]
            axis.axhspan(min(low, 100 * band) / 2, 100 * band, color="grey", alpha=0.2, linewidth=0)
            axis.set_ylim(bottom=min(low, 100 * band) / 2)
        axis.set_xlabel(f"seconds: {title}")
    axes[0].set_ylabel("displacement error (%)")
    axes[1].legend(fontsize=7, title="(slope)", title_fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    figure.suptitle(study.name, fontsize=11)
    return svg_of(figure)


CAPTION = (
    "Error over seconds on one thread: median of the repetitions, bars from the fastest to the slowest. Down and to the left "
    "is better. Grey: the largest estimated error of the references; a hollow marker lies within twice the reference's "
    "own. In brackets: slope in the logarithms."
)


_ADVICE = (
    "The fastest method whose error is no larger than asked for, between its measured rungs by interpolation."
)


def table(study: SceneStudy) -> Table:
    """Head and rows, every measurement of the scene."""
    rung = "step (s)" if is_dynamic(study.scene) else "vertices"
    head = [
        "method",
        rung,
        "nodes",
        "error",
        "of reference",
        "set-up (s)",
        "solve (s)",
        "whole (s)",
        "spread (s)",
        "memory (MB)",
        "",
    ]
    rows = []
    for m in study.measurements:
        at = study.rung(m.factor)[0].split("=")[1]
        at = significant(float(at)) if is_dynamic(study.scene) else at
        if not m.outcomes:
            rows.append([label_of(m.method.name), at, *["-"] * 8, m.message])
            continue
        seconds = m.seconds()
        rows.append(
            [
                label_of(m.method.name), at, str(m.outcomes[0].record["n_nodes"]), percent(m.error),
                percent(m.reference_error), *(significant(median(m.seconds(*s))) for s in (_SETUP, ("solve",), ())),
                f"{significant(min(seconds))} to {significant(max(seconds))}", f"{m.memory / 1e6:.0f}", m.message,
            ]
        )  # fmt: skip
    return head, rows


def noise(measurements: Iterable[Measurement]) -> str:
    """How far the timed runs had the machine for themselves, in words."""
    runs = [run for m in measurements for run in m.outcomes]
    shared = sum(run.cpu < 0.9 * run.wall for run in runs)
    if not shared:
        return "Every timed run had a core for itself."
    return (
        f"{shared} of {len(runs)} timed runs waited for a core or a disk more than a tenth of their time: "
        "times with a wide spread are not to be relied on."
    )


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Error against seconds for every method."""
    files = arguments.scenes or [
        SCENES / f"{name}.toml" for name in ("bar_sag", "torus_hang", "bar_bend", "bar_swing")
    ]
    effort = QUICK if arguments.quick else FULL
    effort = replace(effort, repetitions=arguments.repetitions or effort.repetitions)
    timed, store = Store(folder / "points", arguments.time_limit), Store(folder / "points")
    sections: list[Section] = []
    findings: list[str] = []
    advised: list[list[str]] = []
    protocol: dict[str, str] = {}
    with alone(arguments.quiet):
        for file in files:
            scene = SceneStudy(file.resolve(), effort, timed, store)
            scene.run(arguments.quiet)
            curves = curves_of(scene.measurements)
            sentences = in_words(curves)
            advised += [[scene.name, *row] for row in advice(curves)]
            findings.append(
                f"{scene.name}: {sentences[0]}" if sentences else f"{scene.name}: no method gave a result."
            )
            figure: Figures = {f"{scene.name}_work_precision": (plot(scene), CAPTION)} if sentences else {}
            sentences.append(noise(scene.measurements))
            sections.append(Section(scene.name, sentences, figure, {scene.name: table(scene)}))
            protocol[f"{scene.name}: the scene, before the ladder's values"] = file.read_text()
    head = ["scene", "an error may be", "use", "it takes"]
    sections.append(Section("Use X when", [_ADVICE], {}, {"use_when": (head, advised)}))
    return Result("Work and precision", " ".join(findings), sections, protocol)
