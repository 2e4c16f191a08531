"""The paper's strips with a referee: each scene of figure 11 by finite elements and by springs, on one surface.

Such bodies fold and wrinkle where chance decides, so vertices are not compared one by one. Measured is what two bodies share
all the same [analysis/shape_measures.py], at every frame that both have. Runs of slightly moved copies of the surface tell how
far apart chance alone sets two runs of one method [analysis/spread.py].
"""

from __future__ import annotations

import argparse
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from ..compare import triangle_normals
from ..drawing.film import draw_film, draw_strip
from ..drawing.style import style_of, svg_of
from ..methods import FEM_P1, FEM_P2, label_of
from ..paths import SCENES, write_text
from ..progress import Progress, say
from ..report import Table
from ..run_store import Outcome, RunRequest, Store, each
from ..runs import Array, Run, RunError, load_frames, read_toml
from ..shape_measures import (
    Surface,
    curvature_histogram,
    earth_movers_distance,
    mass_properties,
    shared_edges,
    silhouette_differences,
    surface_distance,
)
from ..spread import Spread, spread
from ..wording import percent, significant
from .bodies import random_of
from .claims import PUBLISHED
from .published import overrides_of, sound_part
from .result import Figures, Result, Section

STRIPS = ("ball_deflates", "torus_implodes", "handle_folds", "head_crushes", "ball_inflates")
_N_VERTICES = 300  # of the surfaces, as near as shapes allow
_N_COPIES, _JITTER = 10, 1e-3  # of the surface for chance; what vertices move by, of the mean edge
_N_COLOURS = 256  # of a picture, which halves its file
_N_FRAMES = 8  # of a motion, at which shapes are compared
_LIMIT, _QUICK_LIMIT = 3000.0, 120.0  # s of a run
_COUPLED = "node_averaged"


def _elements(degree: int) -> tuple[str, tuple[str, ...]]:
    return "fem_reference", (f"reference.degree={degree}", 'reference.integrator="minimising_euler"')


def _springs(model: str) -> tuple[str, tuple[str, ...]]:
    return "massspring", (f"network.calibration={model}", "time.integrator=minimising_euler")


#: Method -> program and overrides; both programs minimise the same potential of a step.
METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    FEM_P2: _elements(2),
    FEM_P1: _elements(1),
    _COUPLED: _springs(_COUPLED),
    "edge_coupled": _springs("edge_coupled"),
    "uniform": _springs("uniform"),
}


@dataclass(frozen=True)
class Difference:
    """Of two motions, the mean over their shared frames but the first; lengths over the body's size at rest."""

    volume: float  #: over that at rest
    area: float  #: over that at rest
    centre: float
    inertia: float  #: Frobenius norm, over that at rest
    mean_distance: float
    distance_95: float  #: that 95 % of the surface keeps
    hausdorff: float
    silhouette: float  #: area of the symmetric difference over that of the union
    curvature: float  #: earth mover's distance, times the body's size


def size_of(X: Array) -> float:
    """Diagonal of the box around points (m)."""
    return float(np.linalg.norm(np.ptp(X, axis=0)))


def surface_at(run: Run, time: float) -> Surface:
    """The surface at a time (s), linear between frames."""
    after = int(np.clip(np.searchsorted(run.times, time), 1, len(run.times) - 1))
    a, b = run.frame(after - 1), run.frame(after)
    share = np.clip((time - run.times[after - 1]) / (run.times[after] - run.times[after - 1]), 0, 1)
    return a.X + (1 - share) * a.u + share * b.u, a.F


def shared_times(run: Run, referee: Run, n: int) -> Array:
    """Moments (n,) to the end of the one that ends first. Raises RunError where there is one frame alone."""
    end = min(run.times[-1], referee.times[-1])
    if min(len(run.times), len(referee.times)) < 2 or not end > referee.times[0]:
        raise RunError(f"{run.folder}: expected two frames")
    times: Array = np.linspace(referee.times[0], end, n + 1)[1:]
    return times


def contact_and_energy(run: Run) -> dict[str, Array]:
    """What a run has of: kinetic energy, that stored in solid and skin (J), contact force (N) and area in touch (m2)."""
    curves = run.curves
    stored = [
        curves[name] for name in ("elastic_energy", "membrane_energy", "surface_energy") if name in curves
    ]
    areas = [name for name in curves if name.startswith("obstacle_") and name.endswith("_area")]
    forces = [[curves[name.replace("area", f"force_{axis}")] for axis in "xyz"] for name in areas]
    found: dict[str, Array] = {"kinetic energy": curves["kinetic_energy"]}
    if stored:
        found["stored energy"] = np.sum(stored, axis=0)
    if areas:
        found["contact force"] = np.linalg.norm(forces, axis=1).sum(axis=0)
        found["in touch"] = np.sum([curves[name] for name in areas], axis=0)
    return found


def curve_differences(run: Run, referee: Run, n_frames: int = _N_FRAMES) -> dict[str, float]:
    """Of what both have, the mean over shared frames, over the referee's largest; without what is always nothing there."""
    times = shared_times(run, referee, n_frames)
    here, there = contact_and_energy(run), contact_and_energy(referee)
    found = {}
    for name in here.keys() & there.keys():
        if (largest := np.abs(there[name]).max()) > 0:
            a, b = (
                np.interp(times, of.curves["time"], row[name]) for of, row in ((run, here), (referee, there))
            )
            found[name] = float(np.abs(a - b).mean() / largest)
    return found


def differences(run: Run, referee: Run, n_frames: int = _N_FRAMES) -> Difference:
    """Of a run from its referee, to the end of the one that ends first. Raises RunError where there is one frame alone."""
    times = shared_times(run, referee, n_frames)
    rest = referee.frame(0)
    of_rest, size = mass_properties((rest.X, rest.F)), size_of(rest.X)
    rows = []
    for time in times:
        first, second = surface_at(run, time), surface_at(referee, time)
        a, b = mass_properties(first), mass_properties(second)
        apart = surface_distance(first, second)
        edges = shared_edges([first, second])
        histograms = [curvature_histogram(surface, edges) for surface in (first, second)]
        rows.append(
            [
                abs(a.volume - b.volume) / of_rest.volume,
                abs(a.area - b.area) / of_rest.area,
                np.linalg.norm(a.centre - b.centre) / size,
                np.linalg.norm(a.inertia - b.inertia) / np.linalg.norm(of_rest.inertia),
                apart.mean / size,
                apart.quantile_95 / size,
                apart.hausdorff / size,
                silhouette_differences(first, second).mean(),
                earth_movers_distance(histograms[0], histograms[1], edges) * size,
            ]
        )
    return Difference(*(float(value) for value in np.mean(rows, axis=0)))


def jittered(X: Array, F: Array, name: str) -> Array:
    """Vertices (n, 3) moved at random along their normals, in the same way for the same name; inwards, where no obstacle is."""
    edges = X[F] - X[np.roll(F, 1, axis=1)]
    by = (
        _JITTER
        * float(np.linalg.norm(edges, axis=2).mean())
        * np.abs(random_of(name).standard_normal(len(X)))
    )
    normals = np.zeros_like(X)
    np.add.at(normals, F.ravel(), np.repeat(triangle_normals(X, F), 3, axis=0))
    moved: Array = X - (by / np.linalg.norm(normals, axis=1))[:, None] * normals
    return moved


def _write_obj(file: Path, X: Array, F: Array) -> None:
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in X]
    lines += [f"f {a} {b} {c}" for a, b, c in F + 1]
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, "\n".join(lines) + "\n")


def methods_of(scene: Path) -> dict[str, tuple[str, tuple[str, ...]]]:
    """The methods, and the paper's own where the scene has what it is made of."""
    published = ("massspring", overrides_of(scene, "implicit_euler", 1))
    return METHODS | {PUBLISHED: published}


class Strip:
    """One scene by every method."""

    def __init__(self, scene: Path, store: Store, overrides: Sequence[str]) -> None:
        self.scene, self.store, self.overrides = scene, store, tuple(overrides)
        self.outcomes: dict[str, Outcome] = {}
        self.runs: dict[str, Run] = {}

    def run(self, method: str, overrides: Sequence[str] = ()) -> Outcome:
        program, own = methods_of(self.scene)[method]
        options = ("--no-diagnostics",) if program == "massspring" else ()
        return self.store.run(RunRequest(program, self.scene, (*self.overrides, *own, *overrides), options))

    def take(self, method: str, outcome: Outcome) -> None:
        """Of a method's run."""
        self.outcomes[method] = outcome
        if (outcome.folder / "run.json").exists() and (outcome.folder / "frames.pvd").exists():
            run = sound_part(load_frames(outcome.folder))
            if len(run.times) > 1:
                self.runs[method] = run

    @property
    def referee(self) -> str | None:
        """The finest elements that came to the end."""
        for method in (FEM_P2, FEM_P1):
            if method in self.outcomes and self.outcomes[method].status == "ok":
                return method
        return None

    def rows(self) -> list[list[str]]:
        rows = []
        for method, outcome in self.outcomes.items():
            seconds = outcome.record.get("cpu")
            row = [
                self.scene.stem,
                label_of(method),
                outcome.status,
                "-" if seconds is None else f"{seconds:.3g}",
            ]
            if self.referee and method in self.runs and method != self.referee:
                of = differences(self.runs[method], self.runs[self.referee])
                row += [percent(value, 2) for value in (of.volume, of.area, of.centre, of.inertia)]
                row += [
                    percent(value, 2)
                    for value in (of.mean_distance, of.distance_95, of.hausdorff, of.silhouette)
                ]
                row += [f"{of.curvature:.2g}"]
                of_curves = curve_differences(self.runs[method], self.runs[self.referee])
                row += [percent(of_curves.get(name), 2) for name in CURVES]
            else:
                row += ["0" if method == self.referee else "-"] * (len(HEAD) - len(row))
            rows.append(row)
        return rows

    def copies(self, method: str, n: int, folder: Path) -> list[Surface]:
        """Ends of runs of moved copies of the surface."""
        rest = next(iter(self.runs.values())).frame(0)

        def run(number: int) -> Outcome:
            file = folder / f"{self.scene.stem}_{number}.obj"
            _write_obj(file, jittered(rest.X, rest.F, file.stem), rest.F)
            as_file = [
                f'surface.file="{file}"', 'surface.shape=""', "surface.size=[0,0,0]", "surface.across=0"
            ]  # fmt: skip
            return self.run(method, as_file)

        ended = [load_frames(copy.folder) for copy in each(run, range(n)) if copy.status == "ok"]
        return [surface_at(run, run.times[-1]) for run in ended]


def curves(strip: Strip) -> str:
    """Volume, area and kinetic energy of every method over time."""
    figure = Figure(figsize=(9, 3))
    for axes, name in zip(figure.subplots(1, 3), ("volume", "area", "kinetic_energy"), strict=True):
        for number, (method, run) in enumerate(strip.runs.items()):
            first = run.curves[name][0] if name != "kinetic_energy" else 1
            axes.plot(
                run.curves["time"],
                run.curves[name] / first,
                color=style_of(method, number).colour,
                linestyle="--" if method == strip.referee else "-",
                label=label_of(method),
            )
        axes.set_xlabel("time (s)")
        axes.set_ylabel("kinetic energy (J)" if name == "kinetic_energy" else f"{name} over that at rest")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    figure.set_layout_engine("constrained")
    return svg_of(figure)


def chance(strip: Strip, n: int, folder: Path) -> Spread | None:
    """Of the ends of copies of coupled springs and of linear elements, over the size; None where too few ended."""
    first, second = (strip.copies(method, n, folder) for method in (_COUPLED, FEM_P1))
    if min(len(first), len(second)) < 2:
        return None
    size = size_of(first[0][0])
    return spread(first, second, lambda a, b: surface_distance(a, b).mean / size)


def chance_row(name: str, found: Spread | None) -> list[str]:
    """Cells below CHANCE."""
    if found is None:
        return [name, "-", "-", "-", "-"]
    shares = (found.first, found.second, found.between, found.probability)
    return [name, *(percent(share, 2) for share in shares)]


def lost_to_scheme(run: Run) -> float:
    """Energy that the integrator and blows take, over the work put in, at the end of a motion."""
    work = sum(values[-1] for name, values in run.curves.items() if name.startswith("work_of_"))
    return float(run.curves["lost_to_scheme"][-1] / work)


def step_rows(strip: Strip) -> list[list[str]]:
    """Cells below STEPS: coupled springs and linear elements in the scene's step, and in half of it."""
    step = read_toml(strip.scene)["time"]["step"]
    rows = []
    for length, overrides in ((step, []), (step / 2, [f"time.step={step / 2}"])):
        outcomes = [strip.run(method, overrides) for method in (_COUPLED, FEM_P1)]
        cells = ["-"] * 3
        if all(outcome.status == "ok" for outcome in outcomes):
            first, second = (load_frames(outcome.folder) for outcome in outcomes)
            shares = (lost_to_scheme(first), lost_to_scheme(second), differences(first, second).mean_distance)
            cells = [percent(share, 2) for share in shares]
        rows.append([strip.scene.stem, significant(1e3 * length), *cells])
    return rows


STEPS = ["scene", "step (ms)", f"lost, {label_of(_COUPLED)}", f"lost, {label_of(FEM_P1)}", "apart"]
CHANCE = [
    "scene",
    f"two of {label_of(_COUPLED)}",
    f"two of {label_of(FEM_P1)}",
    "one of each",
    "chance does as much",
]
CURVES = ("kinetic energy", "stored energy", "contact force", "in touch")
HEAD = [
    "scene", "method", "status", "CPU s", "volume", "area", "centre", "inertia", "distance", "95 %", "Hausdorff",
    "silhouette", "curvature", *CURVES,
]  # fmt: skip


def finding(rows: list[list[str]]) -> str:
    """The study in one sentence."""
    scenes = sorted({row[0] for row in rows})
    judged = [row for row in rows if row[1] == label_of(_COUPLED) and row[8] not in ("-", "0")]
    return (
        f"{len({row[0] for row in judged})} of {len(scenes)} strips have a referee; surfaces of {_COUPLED} lie "
        + ", ".join(f"{row[8]} ({row[0]})" for row in judged)
        + " of the body's size from it in the mean."
    )


def compare(
    scenes: Sequence[Path],
    store: Store,
    folder: Path,
    *,
    without: Container[str] = (),
    n_copies: int = 0,
    is_quiet: bool = True,
) -> tuple[dict[str, Table], list[Section]]:
    """Scenes by every method but those left out: tables of them all, and a section of each scene with its film."""
    strips = []
    for scene in scenes:
        has_shape = "shape" in read_toml(scene).get("surface", {})
        strips.append(Strip(scene, store, [f"surface.n_vertices={_N_VERTICES}"] if has_shape else []))
    wanted = [
        (strip, method) for strip in strips for method in methods_of(strip.scene) if method not in without
    ]
    progress = Progress(len(wanted), is_quiet)
    outcomes = each(lambda of: of[0].run(of[1]), wanted)
    for (strip, method), outcome in zip(wanted, outcomes, strict=True):
        strip.take(method, outcome)
        progress.say(f"{strip.scene.stem}, {method}: {outcome.status}")
    rows: list[list[str]] = []
    by_chance: list[list[str]] = []
    by_step: list[list[str]] = []
    sections = []
    for strip in strips:
        scene = strip.scene
        rows += strip.rows()
        figures: Figures = {}
        if len(strip.runs) > 1:
            film = folder / f"{scene.stem}_methods.gif"
            draw_film(film, strip.runs)
            figures[f"{scene.stem}_methods"] = (film, f"{scene.stem} by each method.")
            picture = folder / f"{scene.stem}_methods.png"
            draw_strip(picture, strip.runs)
            Image.open(picture).convert("RGB").quantize(_N_COLOURS).save(picture, optimize=True)
            figures[f"{scene.stem}_curves"] = (curves(strip), "Dashed: what judges.")
        if n_copies and strip.referee:
            say(f"{scene.stem}, half the step and copies", is_quiet)
            by_step += step_rows(strip)
            by_chance.append(chance_row(scene.stem, chance(strip, n_copies, folder / "surfaces")))
        sections.append(Section(scene.stem, [], figures))
    tables = {"strips": (HEAD, rows)}
    if n_copies:
        tables |= {"steps": (STEPS, by_step), "chance": (CHANCE, by_chance)}
    return tables, sections


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """--quick: the first scene, without quadratic elements and copies."""
    is_quick = arguments.quick
    names = STRIPS[:1] if is_quick else STRIPS
    tables, sections = compare(
        arguments.scenes or [SCENES / f"{name}.toml" for name in names],
        Store(folder / "runs", time_limit=_QUICK_LIMIT if is_quick else _LIMIT),
        folder,
        without=(FEM_P2,) if is_quick else (),
        n_copies=0 if is_quick else _N_COPIES,
        is_quiet=arguments.quiet,
    )
    sections.insert(0, Section("Differences", [HOW, _HOW_BESIDE], {}, tables))
    return Result("The paper's strips with a referee", finding(tables["strips"][1]), sections)


HOW = (
    "Each row is the mean over the motion's frames; CPU seconds are those of the whole program. Volume, area and inertia are "
    "over those at rest, lengths over the body's size, silhouettes over their union. Quadratic elements judge where they come "
    "to the end, linear ones elsewhere. A motion that ends early is compared up to its end."
)
_HOW_BESIDE = (
    "What the scheme takes is over the work put in. Of ends of slightly moved copies the mean distances are over the body's "
    "size. Where chance does as much in many cases, methods are not told apart."
)
