"""The PCP paper's claims, each measured over ten seeds of the random network, with a verdict.

Bodies are coarse, so that all runs take minutes. A measured value is its range over the seeds, medians are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from ..compare import displacement_error, volume
from ..methods import FEM_P1, label_of
from ..paths import PACKAGE, SCENES
from ..report import Table
from ..reproduce import tables_of
from ..run_store import Outcome, RunRequest, Store, each
from ..runs import Run, RunError, load_run
from ..surface_points import on_points_of
from ..verdict import SERVES
from ..wording import significant
from .stability import NAMES

N_SEEDS = 10
_NAMES = ("bar_sag", "ball_pressure", "ball_patches", "ball_deflates", "ball_inflates")
SAG, _BALL, _PATCHES, _SHRINKS, _THERE_AND_BACK = (SCENES / f"{name}.toml" for name in _NAMES)
RESULTS = PACKAGE / "RESULTS.md"
COARSE = ("surface.n_vertices=300", "network.calibration=uniform")
HOLDS, FAILS = "holds", "fails"


class Claim(NamedTuple):
    """A row of the table."""

    section: str  #: of the paper
    claim: str  #: in our words
    measured: str
    how: str  #: scene and keys
    verdict: str


class Seeds:
    """Runs of springs from ten seeds."""

    def __init__(self, store: Store, n: int = N_SEEDS) -> None:
        self.store = store
        self.seeds = range(1, n + 1)

    def outcomes(self, scene: Path, overrides: Sequence[str]) -> list[Outcome]:
        requests = [
            RunRequest("massspring", scene, (*overrides, f"network.seed={seed}"), ("--no-diagnostics",))
            for seed in self.seeds
        ]
        return list(each(self.store.run, requests))

    def values(
        self, scene: Path, overrides: Sequence[str], measure: Callable[[Outcome], float]
    ) -> list[float]:
        """Of the runs that were solved."""
        return [measure(o) for o in self.outcomes(scene, overrides) if o.status == "ok"]

    def n_ok(self, scene: Path, overrides: Sequence[str]) -> int:
        return sum(o.status == "ok" for o in self.outcomes(scene, overrides))


def span(values: Sequence[float], unit: str = "") -> str:
    """The range, as "1 to 2"."""
    if not values:
        return "no run was solved"
    low, high = (significant(float(f"{value:.2g}")) for value in (min(values), max(values)))
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def is_rising(groups: Sequence[Sequence[float]]) -> bool:
    """Whether medians rise from group to group."""
    medians = [median(group) for group in groups if group]
    return len(medians) == len(groups) and all(a < b for a, b in pairwise(medians))


def verdict(holds: bool) -> str:
    return HOLDS if holds else FAILS


def _key(name: str) -> Callable[[Outcome], float]:
    return lambda outcome: float(outcome.record[name])


def _end(name: str) -> Callable[[Outcome], float]:
    """A curve's last value over its first."""

    def measure(outcome: Outcome) -> float:
        curve = load_run(outcome.folder).curves[name]
        return float(curve[-1] / curve[0])

    return measure


def roughness(run: Run) -> float:
    """Area of the surface over that of a ball of its volume."""
    area, volume = run.curves["area"][-1], run.curves["volume"][-1]
    return float(area / (36 * np.pi * volume**2) ** (1 / 3))


def reference_of(store: Store, scene: Path, overrides: Sequence[str]) -> Outcome:
    """Quadratic elements. Raises RunError where they are not solved."""
    reference = store.run(RunRequest("fem_reference", scene, tuple(overrides)))
    if reference.status != "ok":
        raise RunError(f"{scene}: the reference ended with {reference.status}: {reference.message}")
    return reference


def error_against(reference: Run) -> Callable[[Outcome], float]:
    """Of the displacement at the end (%)."""
    frame = reference.last

    def measure(outcome: Outcome) -> float:
        u = on_points_of(load_run(outcome.folder), reference).last.u
        return 100 * displacement_error(frame.X, frame.F, u, frame.u, False).l2

    return measure


def of_network(seeds: Seeds) -> list[Claim]:
    """Sections 4.2 and 4.3: what links, nodes and multiplicity are worth."""
    error = error_against(load_run(reference_of(seeds.store, SAG, COARSE[:1]).folder))
    how = "bar_sag, 300 vertices, uniform"

    def errors(*overrides: str) -> list[float]:
        return seeds.values(SAG, (*COARSE, "network.connectivity=pcp", *overrides), error)

    floppy = seeds.values(SAG, (*COARSE, "network.connectivity=pcp"), _key("n_floppy_motions"))
    completed = seeds.values(SAG, (*COARSE, "network.connectivity=completed_pcp"), _key("n_floppy_motions"))
    by_links = [errors(f"network.multiplicity={m}") for m in (3, 5, 8)]
    springs = [
        seeds.values(
            SAG, (*COARSE, "network.connectivity=pcp", f"network.multiplicity={m}"), _key("n_springs")
        )
        for m in (3, 5, 8)
    ]
    small = ("network.phi=0.15", "network.psi=0.1")
    by_nodes = [errors(f"network.k={k}", *small) for k in (50, 150, 450)]
    best = min((median(group), k) for group, k in zip(by_nodes, (50, 150, 450), strict=True) if group)
    blocks = [
        seeds.values(
            _BALL,
            (f"surface.n_vertices={n}", "network.calibration=uniform", "network.connectivity=pcp"),
            lambda o: o.record["n_blocks"] / o.record["n_nodes"],
        )
        for n in (162, 642, 2562)
    ]
    return [
        Claim(
            "4.2",
            "PCP makes a solid of a shell",
            f"motions without energy: {span(floppy)}; completed PCP: {span(completed)}",
            how,
            verdict(max(floppy) == 0),
        ),
        Claim(
            "4.2",
            "higher multiplicity is more convincing",
            "error with 3, 5, 8: " + "; ".join(span(group, " %") for group in by_links),
            how,
            verdict(is_rising(by_links[::-1])),
        ),
        Claim(
            "4.2",
            "and slower",
            "springs with 3, 5, 8: " + "; ".join(map(span, springs)),
            how,
            verdict(is_rising(springs)),
        ),
        Claim(
            "4.2",
            "inner nodes need not be dense",
            "error with k = 50, 150, 450: " + "; ".join(span(group, " %") for group in by_nodes),
            f"{how}, phi 0.15, psi 0.1",
            verdict(best[1] < 450),
        ),
        Claim(
            "4.3",
            "k sets the accuracy",
            "the same runs",
            f"{how}, phi 0.15, psi 0.1",
            verdict(is_rising(by_nodes[::-1])),
        ),
        Claim(
            "4.3",
            "the matrix is linear in the nodes (Lemma 1)",
            "blocks a node, 162, 642, 2562 vertices: " + "; ".join(map(span, blocks)),
            "ball_pressure, uniform",
            verdict(max(map(median, blocks)) < 1.5 * min(map(median, blocks))),
        ),
    ]


def of_bodies(seeds: Seeds) -> list[Claim]:
    """Sections 3.3, 4.2 and 5: which surfaces are filled, what keeps their volume, how solves grow with them."""
    own = ("network.calibration=uniform", "network.connectivity=pcp", "surface.n_vertices=400")
    shapes = ("ball", "torus", "bar", "handle", "head")
    filled = [seeds.n_ok(_BALL, (*own, f"surface.shape={shape}")) for shape in shapes]
    pressed = (
        "network.calibration=uniform",
        "network.connectivity=completed_pcp",
        "surface.n_vertices=300",
        "material.law=neo_hookean",
    )
    changes = [
        seeds.values(_PATCHES, (*pressed, f"volume.coefficient={P}"), lambda o: abs(_end("volume")(o) - 1))
        for P in ("0", "1e7")
    ]
    kept = [b / a for a, b in zip(*changes, strict=False)]
    sizes = (162, 642, 2562)
    iterations = [
        seeds.values(
            _SHRINKS,
            ("output.frames_every=0", "network.k=0", f"surface.n_vertices={n}", "time.end=0.2"),
            lambda o: o.record["linear_iterations"] / o.record["n_steps_done"],
        )
        for n in sizes
    ]
    longest = [
        seeds.n_ok(_SHRINKS, ("output.frames_every=0", f"time.integrator={integrator}", "time.step=0.05"))
        for integrator in ("implicit_euler", "symplectic_euler")
    ]
    n = len(seeds.seeds)
    return [
        Claim(
            "4.2",
            "PCP fills any closed mesh",
            f"{sum(filled)} of {n * len(shapes)} runs solved",
            f"ball_pressure on {', '.join(shapes)}, 400 vertices, uniform",
            verdict(min(filled) == n),
        ),
        Claim(
            "3.3",
            "volume is preserved",
            f"change of volume that is left: {span(kept)} of that without",
            "ball_patches, 300 vertices, uniform on completed PCP, volume.coefficient = 1e7",
            f"holds within {max(kept):.1%} of the change" if len(kept) == n else FAILS,
        ),
        Claim(
            "5",
            "implicit solvers take linear time",
            f"iterations a step, {', '.join(map(str, sizes))} vertices: " + "; ".join(map(span, iterations)),
            "ball_deflates without inner nodes, 0.2 s",
            verdict(not is_rising(iterations)),
        ),
        Claim(
            "5",
            "implicit steps may be longer",
            f"{longest[0]} of {n} runs solved in steps of 50 ms; explicit: {longest[1]}",
            "ball_deflates, symplectic Euler beside",
            verdict(longest[0] == n and longest[1] < n),
        ),
    ]


#: The ball falls on a floor, free of gravity.
_IMPACT = 2.0  # m/s
_DROP = (
    "surface.n_vertices=162", "loads=[]", "material.E=1e6", "network.calibration=uniform",
    "obstacles=[{plane={point=[0,-1,0],normal=[0,1,0]}}]", f"initial=[{{velocity=[0,{-_IMPACT},0]}}]",
    "time.mode=dynamic", "time.integrator=symplectic_euler", "time.step=0.0002", "time.end=0.3", "output.frames_every=10",
)  # fmt: skip


def answer_and_oscillation(run: Run) -> tuple[float, float]:
    """Time until the far side has lost a tenth of its speed (ms), and the part of the energy that is no common motion in the
    last tenth of the time."""
    u = np.array([run.frame(k).u for k in range(len(run.times))])
    v = np.diff(u, axis=0) / np.diff(run.times)[:, None, None]
    top = run.last.X[:, 1].argmax()
    slower = np.flatnonzero(v[:, top, 1] > -0.9 * _IMPACT)
    relative = v - v.mean(axis=1, keepdims=True)
    parts = (relative**2).sum(axis=2).mean(axis=1) / _IMPACT**2
    answer = 1e3 * (run.times[slower[0]] + run.times[slower[0] + 1]) / 2 if len(slower) else np.inf
    return float(answer), float(parts[-len(parts) // 10 :].mean())


def of_impact(seeds: Seeds) -> list[Claim]:
    """Section 4.1: how an isotropic mesh and PCP answer a floor."""
    links = ("surface", "central", "complete", "pcp")
    found = [
        [
            answer_and_oscillation(load_run(o.folder))
            for o in seeds.outcomes(_BALL, (*_DROP, f"network.connectivity={link}"))
            if o.status == "ok"
        ]
        for link in links
    ]
    answers, oscillations = ([[pair[k] for pair in group] for group in found] for k in (0, 1))
    how = "ball_pressure's ball falls on a floor at 2 m/s, uniform, network.connectivity"
    return [
        Claim(
            "4.1, 5",
            "an isotropic mesh answers slowly, PCP at once",
            "the far side answers, surface, one central node, all pairs, PCP: "
            + "; ".join(span(group, " ms") for group in answers),
            how,
            verdict(median(answers[3]) < median(answers[0])),
        ),
        Claim(
            "4.1, 5",
            "an isotropic mesh oscillates, PCP less",
            "part of the energy that oscillates, likewise: " + "; ".join(map(span, oscillations)),
            how,
            verdict(median(oscillations[3]) < median(oscillations[0])),
        ),
    ]


def of_steps(seeds: Seeds) -> list[Claim]:
    """Sections 4 and 5: steps in time, solvers, skin."""
    own = ("output.frames_every=0",)
    volume = _end("volume")
    plain = seeds.values(_SHRINKS, own, volume)
    dropped = seeds.values(_SHRINKS, (*own, "time.volume_gradient=false", "time.bend_gradient=false"), volume)
    explicit_keys = (*own, "time.integrator=symplectic_euler", "time.step=0.001")
    explicit = seeds.values(_SHRINKS, explicit_keys, volume)
    rigid = seeds.n_ok(_SHRINKS, (*explicit_keys, "material.E=4e8"))
    iterations = [
        seeds.values(_SHRINKS, (*own, f"time.linear_solver={solver}"), _key("linear_iterations"))
        for solver in ("cg", "bicg")
    ]
    products = [2 * b / a for a, b in zip(*iterations, strict=False)]
    rough = [
        seeds.values(_SHRINKS, (*own, f"skin.stiffness={stiffness}"), lambda o: roughness(load_run(o.folder)))
        for stiffness in (1250, 5000, 20000)
    ]
    published = {
        integrator: seeds.n_ok(
            _SHRINKS,
            (
                *own,
                "paper=true",
                f"time.integrator={integrator}",
                "collapse.coefficient=0.00356",
                "skin.relaxation=0.00105",
            ),
        )
        for integrator in ("implicit_euler", "explicit_euler")
    }
    links = ("surface", "central", "pcp")
    stable = [
        seeds.values(
            _SHRINKS,
            (
                "time.integrator=symplectic_euler",
                "time.step=0",
                "time.end=1e-9",
                f"network.connectivity={link}",
            ),
            lambda o: 2e3 * o.record["step"],  # half the limit is taken
        )
        for link in links
    ]
    n = len(seeds.seeds)
    how = "ball_deflates"

    def off(values: list[float]) -> float:
        return abs(median(values) / median(plain) - 1) if values else float("inf")

    return [
        Claim(
            "4.1, 5",
            "PCP tolerates longer explicit steps than an isotropic mesh",
            "longest stable step, surface, one central node, PCP: "
            + "; ".join(span(s, " ms") for s in stable),
            f"{how}, network.connectivity, time.step = 0",
            verdict(median(stable[2]) > median(stable[0])),
        ),
        Claim(
            "4",
            "a stiffer skin wrinkles more",
            "area over a ball's, skin of 1250, 5000, 20000 N/m: " + "; ".join(map(span, rough)),
            how,
            verdict(is_rising(rough)),
        ),
        Claim(
            "5",
            "bi-conjugate gradients take twice the time",
            f"products over those of conjugate gradients: {span(products)}",
            how,
            f"holds within {max(abs(p / 2 - 1) for p in products):.0%}" if products else "not testable",
        ),
        Claim(
            "5",
            "terms of the matrix can be dropped",
            f"{len(dropped)} of {n} runs solved; volume left {span(dropped)}, with them {span(plain)}",
            how,
            f"holds within {off(dropped):.0%} of the volume left" if len(dropped) == n else FAILS,
        ),
        Claim(
            "5",
            "explicit and implicit results hardly differ",
            f"volume left {span(explicit)}, implicit {span(plain)}",
            f"{how}, symplectic Euler in steps of 1 ms",
            f"holds within {off(explicit):.0%} of the volume left" if len(explicit) == n else FAILS,
        ),
        Claim(
            "5",
            "but for very rigid bodies",
            f"{rigid} of {n} explicit runs solved at E = 4e8 Pa",
            f"{how}, the same steps",
            verdict(rigid == 0),
        ),
        Claim(
            "5",
            "no oscillation or instability, as published",
            f"implicit: {published['implicit_euler']} of {n} runs solved; "
            f"explicit: {published['explicit_euler']} of {n}",
            f"{how}, paper = true",
            verdict(min(published.values()) == n),
        ),
    ]


_REAL_TIME, _NEARLY = 25.0, 12.5  # frames a second
_STRIPS = "11 The paper's scenes"
PUBLISHED = "uniform, as published"  #: the paper's network and scheme, as a method
EXPLICIT, IMPLICIT = "explicit Euler", "linearised implicit Euler"  #: columns of table 1


def of_tables(page: str) -> list[Claim]:
    """Claims that other studies measure, from the tables that they publish on a page of results (Markdown).

    Raises RunError where a table, a row or a column is missing.
    """

    def table(heading: str) -> Table:
        found = tables_of(page, heading)
        if not found:
            raise RunError(f"no table under '{heading}', expected that of RESULTS.md")
        return found[0][1]

    def row(heading: str, label: str) -> dict[str, str]:
        head, rows = table(heading)
        found = next((row for row in rows if row[0] == label), None)
        if not found:
            raise RunError(f"no row '{label}' under '{heading}', expected that of RESULTS.md")
        return dict(zip(head, found, strict=True))

    counts = {name: int(cell) for name, cell in list(row("6 Stability", NAMES["implicit_euler"]).items())[1:]}
    gained = counts["energy gained"]
    head_of_table = row("7 The paper's figures and table", "head")
    nodes, explicit, implicit = (_number(head_of_table[key]) for key in ("nodes", EXPLICIT, IMPLICIT))
    is_real_time = explicit >= _REAL_TIME and implicit >= _NEARLY
    head, rows = table("1 Statics at small strain")
    last = [row[head.index("uniform on PCP")] for row in rows]
    errors = [_number(cell) for cell in last if cell.endswith("%")]
    strips = table(_STRIPS)
    outlines = list(_of_strips(strips, PUBLISHED, "silhouette").values())
    seconds = [_of_strips(strips, method, "CPU s") for method in (PUBLISHED, FEM_P1)]
    costs = [of_network / seconds[1][scene] for scene, of_network in seconds[0].items()]
    return [
        Claim(
            "3.4", "implicit steps gain no kinetic energy", f"{gained} of {sum(counts.values())} starts gain energy",
            "./testbed study stability", FAILS if gained else HOLDS,
        ),
        Claim(
            "5, table 1", "explicit steps run in real time, implicit ones nearly",
            f"{nodes:.0f} nodes: {explicit:.0f} and {implicit:.0f} frames a second on one core", "build/bin/bench_step",
            HOLDS if is_real_time else FAILS,
        ),
        Claim(
            "5", "realistic at less cost than finite elements",
            f"its network errs by {min(errors):g} to {max(errors):g} % in statics", "./testbed reproduce statics",
            HOLDS if median(errors) <= 100 * SERVES else FAILS,
        ),
        Claim(
            "3.3, 5", "results are realistic", f"its outlines are {span(outlines, ' %')} off those of finite elements",
            "figure 11, ./testbed study strips", HOLDS if median(outlines) <= 100 * SERVES else FAILS,
        ),
        Claim(
            "5", "less cost than finite elements", f"CPU seconds over those of linear elements: {span(costs)}",
            "figure 11, ./testbed study strips", HOLDS if median(costs) < 1 else FAILS,
        ),
    ]  # fmt: skip


def _number(cell: str) -> float:
    return float(cell.split("(")[0].replace(" ", "").rstrip("%"))


def _of_strips(table: Table, method: str, column: str) -> dict[str, float]:
    """Scene -> the figure, of runs that came to the end."""
    rows = [dict(zip(table[0], row, strict=True)) for row in table[1]]
    return {
        row["scene"]: _number(row[column])
        for row in rows
        if row["method"] == label_of(method) and row["status"] == "ok"
    }


def of_playback(seeds: Seeds) -> list[Claim]:
    """Section 4.4: whether a body that is blown up again passes through the shapes that it had as it was sucked together."""
    differences = seeds.values(
        _THERE_AND_BACK, ("output.frames_every=1",), lambda o: difference_on_the_way_back(load_run(o.folder))
    )
    return [
        Claim(
            "4.4",
            "deflation played backwards is inflation",
            f"shapes of equal volume, there and back, differ by {span(differences, ' %')} of the motion",
            "ball_inflates, three quarters of the volume",
            verdict(bool(differences) and median(differences) <= 100 * SERVES),
        )
    ]


def difference_on_the_way_back(run: Run, part: float = 0.75) -> float:
    """Between the two shapes that enclose this part of the volume at rest, before the least volume and after it (%)."""
    frames = [run.frame(k) for k in range(len(run.times))]
    volumes = np.array([volume(frame.X + frame.u, frame.F) for frame in frames])
    off, least = np.abs(volumes / volumes[0] - part), int(volumes.argmin())
    there, back = frames[int(off[:least].argmin())], frames[least + int(off[least:].argmin())]
    return 100 * displacement_error(there.X, there.F, back.u, there.u, True).l2


def table_of(claims: Sequence[Claim]) -> Table:
    return ["section", "claim", "measured", "scene", "verdict"], [list(claim) for claim in claims]


def measure(seeds: Seeds) -> Table:
    """Every claim."""
    return table_of(
        [
            *of_network(seeds),
            *of_bodies(seeds),
            *of_impact(seeds),
            *of_steps(seeds),
            *of_playback(seeds),
            *of_tables(RESULTS.read_text()),
        ]
    )
