"""Contact beside closed forms and quadratic elements: a sphere on a half-space, bodies between plates, a skin under refinement.

A rigid sphere of radius R that is pressed by d into a half-space meets the force 4/3 E / (1 - nu^2) sqrt(R d^3) within the
radius sqrt(R d) [Hertz 1881]. The half-space is an octant of a ball, graded towards the contact. Of plates quadratic elements
judge, at the last load that both have reached. The skin is that of a ball of radius R under tension from within. A membrane of
stiffness K then stretches by p / (2 K / (1 - nu) / R), less what the soft body in it bears.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..compare import compare_runs, free_motions
from ..methods import FEM_P1, FEM_P2, label_of
from ..paths import SCENES
from ..progress import say
from ..report import Table
from ..run_store import RunRequest, Store
from ..runs import Array, Run, load_run, read_toml
from ..wording import percent, percent_signed, significant
from .half_space import write_octant
from .reference import solved
from .result import Result, Section

HERTZ = Path(__file__).with_name("hertz.toml")
_PLATES = ("bar_pressed", "ball_pressed")

#: Method -> program and overrides.
METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    FEM_P2: ("fem_reference", ("reference.degree=2",)),
    FEM_P1: ("fem_reference", ("reference.degree=1",)),
    "node_averaged": ("massspring", ("network.calibration=node_averaged",)),
    "edge_coupled": ("massspring", ("network.calibration=edge_coupled",)),
}


class Contact(NamedTuple):
    """A sphere on a half-space at every load step but the first, whose contact is but a few edges wide."""

    depth: Array  #: m
    force: Array  #: over the closed form's
    radius: Array  #: likewise

    @property
    def slope(self) -> float:
        """Exponent of the force over the depth; 3/2 in closed form."""
        return 1.5 + float(np.polyfit(np.log(self.depth), np.log(self.force), 1)[0])


def press_sphere(store: Store, method: str) -> tuple[Contact, Run]:
    """Raises RunError where the method does not reach the full depth."""
    scene = read_toml(HERTZ)
    radius = scene["obstacles"][0]["sphere"]["radius"]
    depths = -np.array(scene["obstacles"][0]["motion"])[:, 2]
    widest = float(np.sqrt(radius * depths[-1]))
    surface = store.folder / "half_space.off"
    write_octant(surface, 200 * widest, 1.3 * widest, widest / 6)
    program, overrides = METHODS[method]
    words = (f'surface.file="{surface}"', *overrides, "network.sampling=mesher")
    run = load_run(solved(store, RunRequest(program, HERTZ, words)).folder)
    material, curves = scene["material"], {name: values[2:] for name, values in run.curves.items()}
    depth = depths[-1] * curves["load_factor"]
    stiffness = material["E"] / (1 - material["nu"] ** 2)
    # The octant has a quarter of the contact.
    force = -4 * curves["obstacle_0_force_y"] / (4 / 3 * stiffness * np.sqrt(radius * depth**3))
    width = np.sqrt(4 * curves["obstacle_0_area"] / np.pi / (radius * depth))
    return Contact(depth, force, width), run


def _worst(ratios: Array) -> str:
    return percent_signed(float(ratios[np.abs(ratios - 1).argmax()]) - 1)


def sphere_table(store: Store) -> Table:
    """What each method is off by, and its slope."""
    rows = []
    for method in METHODS:
        found, run = press_sphere(store, method)
        n_nodes = str(run.record["n_nodes"])
        rows.append(
            [
                label_of(method),
                n_nodes,
                _worst(found.force),
                _worst(found.radius),
                significant(found.slope, 4),
            ]
        )
    return ["method", "nodes", "force", "contact radius", "slope"], rows


def plates_table(store: Store, scenes: Sequence[Path]) -> Table:
    """How far each method comes, and how far it is then from quadratic elements."""
    rows = []
    for scene in scenes:
        runs = {
            method: load_run(store.run(RunRequest(program, scene, own)).folder, may_stop=True)
            for method, (program, own) in METHODS.items()
        }
        referee = runs[FEM_P2]
        for method, run in runs.items():
            row = [scene.stem, label_of(method), str(run.record["n_nodes"]), percent(run.times[-1])]
            if method != FEM_P2:
                found = compare_runs(run, referee, free_motions(referee.record))
                row += [percent(found.displacement_error_l2, 2), percent(found.volume_change_error, 2)]
                row += [
                    percent_signed(_at(run, name, found.reached) / _at(referee, name, found.reached) - 1)
                    for name in ("obstacle_0_force_y", "obstacle_0_area")
                ]
            rows.append(row + ["0"] * (8 - len(row)))
    return [
        "scene",
        "method",
        "nodes",
        "load reached",
        "displacement",
        "volume",
        "force",
        "area in touch",
    ], rows


def _at(run: Run, name: str, load_factor: float) -> float:
    return float(np.interp(load_factor, run.curves["load_factor"], run.curves[name]))


_SKIN = 1e4  # N/m
_BODY = 100.0  # Pa, of the soft body within it
_TENSION = 30.0  # Pa
NU = 0.25  #: of the body and its membrane
NU_OF_SPRINGS = 1 / 3  #: of the membrane that springs along even triangles are [Van Gelder 1998]
_RADIUS = 1.0  # m
_SIZES = (162, 642, 2562)  # vertices


def stretch_of_balloon(nu: float) -> float:
    """Of a ball whose skin has this Poisson's ratio, small, in closed form."""
    return _TENSION / (2 * _SKIN / (1 - nu) / _RADIUS + _BODY / (1 - 2 * NU))


def inflate(store: Store, method: str, n_vertices: int) -> float:
    """Stretch of a soft ball with a skin, by its volume. Raises RunError where it is not solved."""
    program, own = METHODS[method]
    words = (
        f"surface.n_vertices={n_vertices}", f"material.E={_BODY}", f"material.nu={NU}", f"skin={{stiffness={_SKIN}}}",
        f"loads=[{{pressure={-_TENSION},follower=true}}]", "time.load_steps=1", "time.residual=1e-8",
    )  # fmt: skip
    request = RunRequest(program, SCENES / "ball_pressure.toml", (*words, *own))
    volumes = load_run(solved(store, request).folder).curves["volume"]
    return float((volumes[-1] / volumes[0]) ** (1 / 3) - 1)


def skin_table(store: Store, sizes: Sequence[int]) -> Table:
    """A membrane's stretch and that of a skin of springs over their closed forms, on finer and finer surfaces."""
    rows = []
    for n in sizes:
        membrane, springs = (inflate(store, method, n) for method in (FEM_P1, "edge_coupled"))
        ratios = (
            membrane / stretch_of_balloon(NU),
            springs / stretch_of_balloon(NU),
            springs / stretch_of_balloon(NU_OF_SPRINGS),
        )
        rows.append([str(n), *(percent_signed(ratio - 1) for ratio in ratios)])
    return ["vertices", "membrane", "springs", "springs, beside nu = 1/3"], rows


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """All of it, in a minute of one core."""
    store = Store(folder / "runs")
    say("a sphere on a half-space", arguments.quiet)
    sphere = sphere_table(store)
    say("plates", arguments.quiet)
    plates = plates_table(store, [SCENES / f"{name}.toml" for name in _PLATES])
    say("skin", arguments.quiet)
    skin = skin_table(store, _SIZES)
    sections = [
        Section("A sphere on a half-space", [], {}, {"sphere": sphere}),
        Section("Between plates", [], {}, {"plates": plates}),
        Section("A skin under refinement", [], {}, {"skin": skin}),
    ]
    return Result("Contact", finding(plates), sections)


def finding(plates: Table) -> str:
    """The study in one sentence."""
    off = ", ".join(f"{row[4]} ({row[0]})" for row in plates[1] if row[1] == label_of("node_averaged"))
    return f"Between plates {label_of('node_averaged')}, are off quadratic elements by {off}."
