"""The race of all methods in one scene: their ladder of runs, timed, and what each is off by."""

from __future__ import annotations

import itertools
import os
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ..compare import compare_runs, free_motions, keeps_volume, trajectory_error, volume_change
from ..machine import has_waited
from ..methods import FEM_P1, FEM_P1_EXPLICIT, FEM_P2, FEM_P2_EXPLICIT
from ..progress import say
from ..run_store import Outcome, RunRequest, Store
from ..runs import Run, RunError, load_run

_NETWORKS = ("uniform", "affine", "van_gelder", "lloyd", "moment")
_COUPLED = ("edge_coupled", "node_averaged")
_AT_LARGE_STRAIN = ("uniform", "affine", *_COUPLED)
_MOVING = ("uniform", *_COUPLED)
_INTEGRATORS = {"symplectic_euler": ":", "implicit_euler": "--", "midpoint": "-"}
_EXPLICIT = {"symplectic_euler"}
_EXPLICIT_STEPS = tuple(2.0**-k for k in range(1, 7))  # over the scene's step; the longer ones may diverge
_RESIDUAL = {
    "linear statics": 1e-4,
    "large statics": 1e-6,
    "large motion": 1e-4,
    "contact": 1e-6,
}  # of every method alike
_TIGHTER = 1e-2
_TARGETS = (0.1, 0.05, 0.02, 0.01)  # errors for which adaptive springs add nodes
REFERENCE_LIMIT = 1800  #: s
_SLOWEST, _FASTEST = 1.3, 8  # ratio of changes by refining, as in fem_reference/solid/richardson.cpp
_MOST_AT_LARGE_STRAIN = 100_000  # tetrahedra of a reference
_STAGES = ("mesh", "adapt", "setup", "assemble", "solve")  # of a method's own seconds
_ATTEMPTS = 3
_TWO_THREADS = ("env", "OMP_NUM_THREADS=2", "DEAL_II_NUM_THREADS=2")

SMALL = "small_strain"  #: the law of linear regimes

#: Regime -> its scenes.
REGIMES = {
    "linear statics": ("bar_sag", "torus_hang", "ball_patches"),
    "linear motion": ("bar_swing",),
    "large statics": ("bar_bend", "squash", "inflate", "ball_collapses_far", "hollow_ball_inflates"),
    "large motion": ("bar_falls", "ball_let_go"),
    "contact": ("ball_pressed", "bar_pressed"),
}


def _plates(way: float) -> tuple[str, ...]:
    """Two plates that move so far (m) towards each other, in few steps."""
    motions = (f"obstacles.{n}.motion=[[0, 0, 0, 0], [1, 0, {to:g}, 0]]" for n, to in enumerate((way, -way)))
    return (*motions, "time.load_steps=6")


#: Scene -> what the race changes in it.
CHANGES = {
    "squash": ("supports.1.displacement=[0, -0.2, 0]",),
    "ball_pressed": _plates(0.3),
    "bar_pressed": _plates(0.0125),
    "ball_let_go": ("supports.1.motion=[[0, 0, 0, 0], [0.3, 0, -0.15, 0], [0.4, 0, -0.15, 0]]",),
}


@dataclass(frozen=True)
class Effort:
    """How much a study may do."""

    factors: tuple[float, ...]  #: on a static scene's number of vertices
    sizes: tuple[float, ...]  #: on a dynamic scene's
    steps: tuple[float, ...]  #: on its time step
    seeds: tuple[int, int]  #: of networks and of coupled springs
    repetitions: int  #: of elements
    reference_tetrahedra: (
        int  #: of a reference that is refined twice; motion or large strain allow a sixth, both an eighteenth
    )


FULL = Effort((0.0625, 0.125, 0.25, 0.5, 1, 2, 4), (0.25, 0.5, 1, 2), (0.5, 1, 2, 4), (10, 3), 3, 400_000)
QUICK = Effort((0.125, 0.25), (0.5,), (1, 2), (2, 2), 2, 60_000)


@dataclass(frozen=True)
class Method:
    """A solver with its settings: a line of the plot."""

    name: str
    program: str
    overrides: tuple[str, ...]
    model: str  #: whose colour it has
    line: str = "-"
    steps: tuple[float, ...] = ()  #: its own ladder instead of the study's
    targets: tuple[float, ...] = (0.0,)  #: errors for which nodes are added; 0: none are

    def n_draws(self, effort: Effort) -> int:
        """Runs of a rung: of networks and coupled springs each with a seed of its own."""
        if self.program != "massspring":
            return effort.repetitions
        return effort.seeds[self.model in _COUPLED]


@dataclass(frozen=True)
class Rung:
    """Of the ladder: factors on the scene's number of vertices and, of motions, its time step; a target error."""

    size: float
    step: float = 1
    target: float = 0


@dataclass
class Measurement:
    """One method at one rung of the ladder."""

    method: Method
    rung: Rung
    outcomes: list[Outcome] = field(default_factory=list)  #: of every draw
    timed: list[Outcome] = field(default_factory=list)  #: of those the seconds count: a core was theirs
    two_threads: Outcome | None = None
    errors: list[float] = field(default_factory=list)  #: of every draw
    volume_errors: list[float] = field(default_factory=list)
    reference_error: float | None = None
    message: str = ""

    @property
    def error(self) -> float | None:
        return median(self.errors) if self.errors else None

    @property
    def proven(self) -> float | None:
        """The error, or the reference's own where that is larger: no smaller one can be told."""
        return None if self.error is None else max(self.error, self.reference_error or 0)

    @property
    def is_good(self) -> bool:
        return bool(self.errors)

    def seconds(self, *stages: str) -> list[float]:
        """Of every run that counts, the sum over the stages; without any, over what the method itself takes."""
        return [seconds_of(run, *stages) for run in self.timed or self.outcomes]

    @property
    def seconds_on_two_threads(self) -> float:
        return seconds_of(self.two_threads) if self.two_threads else np.nan

    @property
    def memory(self) -> float:
        """Byte, largest of all draws."""
        return max(run.record.get("peak_memory", 0) for run in self.outcomes)

    @property
    def whole(self) -> float:
        return median(self.seconds())

    @property
    def is_resolved(self) -> bool:
        """The error stands clear of the reference's own."""
        return self.error is not None and self.error > 2 * (self.reference_error or 0)


def seconds_of(run: Outcome, *stages: str) -> float:
    spent = run.record["seconds"]
    return sum(spent.get(stage, 0) for stage in stages or _STAGES)


def is_dynamic(scene: dict[str, Any]) -> bool:
    return scene.get("time", {}).get("mode") == "dynamic"


def regime_of(scene: dict[str, Any], law: str) -> str:
    """Contact, or else statics or motion at small or large strain."""
    if scene.get("obstacles"):
        return "contact"
    return f"{'linear' if law == SMALL else 'large'} {'motion' if is_dynamic(scene) else 'statics'}"


def methods_of(scene: dict[str, Any], law: str) -> list[Method]:
    """Every method for a scene, each with the settings that suit it; law: of both programs."""
    regime = regime_of(scene, law)
    residual = (f"time.residual={_RESIDUAL[regime]}",) if regime in _RESIDUAL else ()
    # What friction holds depends on the steps: in contact they are the scene's.
    static = () if is_dynamic(scene) or regime == "contact" else ("time.load_steps=1",)
    elements = [
        Method(FEM_P1, "fem_reference", (*static, *residual, "reference.degree=1"), FEM_P1),
        Method(FEM_P2, "fem_reference", (*static, *residual, "reference.degree=2"), FEM_P2),
    ]
    if not is_dynamic(scene):
        models = (*_NETWORKS, *_COUPLED) if law == SMALL else _AT_LARGE_STRAIN
        springs = [
            Method(n, "massspring", (*static, *residual, f"network.calibration={n}"), n) for n in models
        ]
        best = springs[-1]
        adaptive = replace(best, name=f"{best.name}, adaptive", line=":", targets=_TARGETS)
        return [*springs, adaptive, *elements]
    springs = [
        Method(
            f"{name}, {scheme}", "massspring", (*residual, f"network.calibration={name}", f"time.integrator={scheme}"),
            name, line, _EXPLICIT_STEPS if scheme in _EXPLICIT else (),
        )
        for name in _MOVING
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
        if not self.scene.get("surface", {}).get("shape"):
            raise RunError(
                f"{file}: surface.shape is missing, expected a generated shape for a ladder of resolutions"
            )
        if is_dynamic(self.scene) and not self.scene["time"].get("step"):
            raise RunError(f"{file}: time.step is missing, expected the step that the ladder starts from")
        self.law = timed.law_of(file)
        self.measurements = [
            Measurement(method, rung)
            for method in methods_of(self.scene, self.law)
            for rung in self._ladder(method)
        ]
        self.measurements.sort(key=lambda m: (m.rung.size, -m.rung.step, -m.rung.target))  # coarse ones first
        self.references: dict[float, tuple[Run, float] | RunError] = {}
        self.tolerances: list[tuple[Method, float]] = []  #: what a tighter residual changes the error by

    def _ladder(self, method: Method) -> list[Rung]:
        if not is_dynamic(self.scene):
            finest = 1 if method.model in _NETWORKS else 4 if self.is_linear else 2
            sizes = [factor for factor in self.effort.factors if factor <= finest]
            return [Rung(size, 1, target) for size in sizes for target in method.targets]
        return [Rung(size, step) for size in self.effort.sizes for step in method.steps or self.effort.steps]

    @property
    def is_linear(self) -> bool:
        return self.law == SMALL

    @property
    def regime(self) -> str:
        return regime_of(self.scene, self.law)

    @property
    def name(self) -> str:
        return self.scene.get("name", self.file.stem)

    def overrides(self, rung: Rung) -> tuple[str, ...]:
        """Of a rung of the ladder."""
        vertices = f"surface.n_vertices={round(rung.size * self.scene['surface'].get('n_vertices', 642))}"
        surface = (vertices, "surface.across=0", *CHANGES.get(self.name, ()))
        if not is_dynamic(self.scene):
            return (*surface, "output.frames_every=0", "network.estimate=false")
        # All runs write frames at the same moments, one in each longest step of the ladder.
        longest = max(self.effort.steps)
        return (
            *surface,
            f"time.step={rung.step * self.scene['time']['step']!r}",
            f"output.frames_every={round(longest / rung.step)}",
        )

    def request(self, m: Measurement, draw: int, attempt: int = 0) -> RunRequest:
        overrides = (*self.overrides(m.rung), *m.method.overrides)
        if m.method.program == "massspring":
            target = (f"network.target_error={m.rung.target}",) if m.rung.target else ()
            seeded = (*overrides, *target, f"network.seed={draw + 1}")
            return RunRequest(
                m.method.program, self.file, seeded, ("--no-diagnostics",), repetition=attempt, is_timed=True
            )
        return RunRequest(
            m.method.program, self.file, overrides, repetition=draw + 100 * attempt, is_timed=True
        )

    def run(self, is_quiet: bool) -> None:
        """Solves the references, times every method on the surfaces that have one, then measures their errors."""
        for m in self.measurements:
            known = self._reference(m.rung.size, is_quiet)
            if isinstance(known, RunError):
                m.message = str(known)
            else:
                _, m.reference_error = known
        slow: dict[Method, int] = {}  # number of the rung that took too long
        n_draws = max(m.method.n_draws(self.effort) for m in self.measurements)
        for draw in range(n_draws):
            for number, m in enumerate(self.measurements, 1):
                if draw >= m.method.n_draws(self.effort) or (m.message and not m.outcomes):
                    continue
                if number > slow.get(m.method, number):
                    m.message = "not tried: beyond the time limit on a coarser rung"
                    continue
                self._draw(m, draw)
                # A target can cost less on a finer surface, to which fewer nodes are added.
                if m.message.startswith("time limit") and not m.rung.target:
                    slow.setdefault(m.method, number)
                done = f"{self.name} [{draw + 1}/{n_draws}, {number}/{len(self.measurements)}]"
                said = m.message or f"{m.outcomes[-1].wall:.2f} s"
                say(f"{done} {m.method.name} x {m.rung.size:g}: {said}", is_quiet)
        for m in self.measurements:
            if m.timed and len(os.sched_getaffinity(0)) > 1:
                two = self.timed.run(replace(self.request(m, 0, attempt=_ATTEMPTS), prefix=_TWO_THREADS))
                m.two_threads = two if two.status == "ok" else None
            if m.outcomes:
                self._compare(m)
        if self.regime in _RESIDUAL:
            self._tighten(is_quiet)

    def _draw(self, m: Measurement, draw: int) -> None:
        outcome = self.timed.run(self.request(m, draw))
        if outcome.status != "ok":
            m.message = f"{outcome.status}: {outcome.message}".removesuffix(": ")
            return
        m.outcomes.append(outcome)
        for attempt in range(1, _ATTEMPTS):
            if not has_waited(outcome.cpu, outcome.wall):
                break
            outcome = self.timed.run(self.request(m, draw, attempt))
        if outcome.status == "ok" and not has_waited(outcome.cpu, outcome.wall):
            m.timed.append(outcome)

    def _compare(self, m: Measurement) -> None:
        known = self.references[m.rung.size]
        assert not isinstance(known, RunError)
        try:
            # Elements have nothing random: their later runs are only timed.
            for outcome in m.outcomes if m.method.program == "massspring" else m.outcomes[:1]:
                error, volume = self._errors(outcome, known[0])
                m.errors.append(error)
                m.volume_errors.append(volume)
        except RunError as error:
            m.message = str(error)

    def _errors(self, outcome: Outcome, exact: Run) -> tuple[float, float]:
        run = load_run(outcome.folder)
        figures = compare_runs(run, exact, free_motions(exact.record))
        if is_dynamic(self.scene):
            return trajectory_error(run, exact).l2, figures.volume_change_error
        # Curves of a static solve in one step have no points between.
        change, exact_change = (volume_change(end)[1][-1] for end in (run, exact))
        volume_error = np.nan if keeps_volume(exact) else abs(change / exact_change - 1)
        return figures.displacement_error_l2, volume_error

    def _tighten(self, is_quiet: bool) -> None:
        """How much a residual of a hundredth changes the error, on the finest rung where all of a method's runs went well."""
        for method in dict.fromkeys(m.method for m in self.measurements if m.is_good):
            m = [m for m in self.measurements if m.method == method and m.is_good and not m.message][-1:]
            if not m or method.model not in (*_COUPLED, FEM_P1, FEM_P2) or method.steps:
                continue
            say(f"{self.name}: {method.name} to a tighter residual", is_quiet)
            residual = f"time.residual={_TIGHTER * _RESIDUAL[self.regime]:g}"
            request = self.request(m[0], 0)
            outcome = self.timed.run(replace(request, overrides=(*request.overrides, residual)))
            if outcome.status == "ok":
                known = self.references[m[0].rung.size]
                assert not isinstance(known, RunError)
                tighter, _ = self._errors(outcome, known[0])
                self.tolerances.append((method, tighter / m[0].errors[0] - 1 if m[0].errors[0] else 0.0))

    def _reference(self, size: float, is_quiet: bool) -> tuple[Run, float] | RunError:
        """The converged reference of a surface and its own estimated error, or why there is none."""
        if size not in self.references:
            say(f"{self.name}: reference x {size:g}", is_quiet)
            solve = self._dynamic_reference if is_dynamic(self.scene) else self._static_reference
            try:
                self.references[size] = solve(size)
            except RunError as error:
                self.references[size] = error
        return self.references[size]

    def _run_reference(self, *overrides: str, options: tuple[str, ...] = ()) -> Outcome:
        outcome = self.store.run(RunRequest("fem_reference", self.file, overrides, options))
        if outcome.status != "ok":
            raise RunError(f"no reference: {outcome.status}: {outcome.message}")
        return outcome

    def _refinements(self, plain: Outcome) -> int:
        dearer = (1, 6, 18)[is_dynamic(self.scene) + (not self.is_linear)]
        limit = self.effort.reference_tetrahedra // dearer
        n_tetrahedra = plain.record["n_tetrahedra"]
        if not self.is_linear and 8 * n_tetrahedra > _MOST_AT_LARGE_STRAIN:
            raise RunError(
                f"no reference: {8 * n_tetrahedra} tetrahedra, expected {_MOST_AT_LARGE_STRAIN} at most"
            )
        return 2 if 64 * n_tetrahedra <= limit else 1

    def _static_reference(self, size: float) -> tuple[Run, float]:
        base = (
            *self.overrides(Rung(size)),
            *(("time.load_steps=1",) if self.is_linear else ()),
            "reference.degree=2",
        )
        n = self._refinements(self._run_reference(*base))
        fine = self._run_reference(*base, f"reference.refine={n}")
        study = self._run_reference(*base, options=("--converge", "2")).record["convergence"]
        if study["status"] != "ok":
            raise RunError(f"no reference: its refinements are {study['status']}")
        # Estimated from the first refinement; every further one reduces it as much, at least.
        return load_run(fine.folder), study["estimated_error_l2_finest"] / study["error_ratio"] ** (n - 1)

    def _dynamic_reference(self, size: float) -> tuple[Run, float]:
        """Refined in space and time; its error is that of halving the step, of second order, and of refining."""
        shortest = min(self.effort.steps)

        def run(step: float, *more: str) -> Outcome:
            return self._run_reference(*self.overrides(Rung(size, step)), "reference.degree=2", *more)

        def change(a: Outcome, b: Outcome) -> float:
            return trajectory_error(load_run(a.folder), load_run(b.folder)).l2

        in_time, coarse = run(shortest / 4), run(shortest / 2)
        levels = [in_time]
        for n in range(1, self._refinements(coarse) + 1):
            levels.append(run(shortest / 4, f"reference.refine={n}"))
        changes = [change(a, b) for a, b in itertools.pairwise(levels)]
        ratio = changes[-2] / changes[-1] if len(changes) > 1 else 2  # one refinement: cautiously
        if ratio < _SLOWEST:
            raise RunError(
                f"no reference: its refinements are not converging, each to 1 / {ratio:.2g} of the last, expected 1 / {_SLOWEST}"
            )
        of_space = changes[-1] / (min(ratio, _FASTEST) - 1)
        return load_run(levels[-1].folder), change(coarse, in_time) / 3 + of_space
