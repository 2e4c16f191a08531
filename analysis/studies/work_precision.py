"""Work and precision: the error that every method reaches, and the seconds that it takes, in five regimes.

Statics or motion, at small or large strain, and contact: each has scenes of its own, solved on a ladder of surfaces, motions
with a ladder of time steps on each. The ladder refines triangles, so that none are cut. Adaptive springs cut them for a ladder
of target errors instead. A method's front is what no other of its rungs beats.

The error is that of the displacement at the surface's vertices against quadratic finite elements on the same surface, its
tetrahedra refined: the same polyhedron with the same vertices, so that nothing is interpolated and the error is the solver's
alone, none of it the surface's distance from a smooth shape. How far that reference itself can be trusted is estimated from
its own refinements. The error of the change of volume stands beside it.

A network of springs on random nodes is one of many: a figure is the median of ten seeds with its range, of coupled springs of
three. Elements are run as often as these, with nothing random. Networks take no more vertices than the scene, as their error
does not fall, and scenes of large strain twice as many at most. Surfaces are left out whose reference at large strain
would have over a hundred thousand tetrahedra, or does not converge. Balls are squashed by a tenth, not a fifth of their height,
and let go from half of the squeeze: refined elements turn inside out beyond. Between plates bodies are pressed by half as much as
in their scenes, in six load steps, as what friction holds depends on the steps. Other static solves of both programs take one,
which both shorten where it fails. Both stop at one residual: 1e-4 of load plus internal forces, and inertia, but 1e-6 of statics
at large strain. A table tells how much a hundredth of these would change each error.

A method that takes longer than the time limit is not tried on finer surfaces. Adaptive springs are tried on each.

Runs are timed one at a time, interleaved: every method once, then every method again. Seconds are meshing, set-up and
solution. Each program makes its own tetrahedra, so nothing is shared. The start of a program, the writing of files and what
the springs' program spends on diagnosing itself are left out. A run that waited for a core is repeated up to three times, then
marked and left out of the seconds. The last panel has two threads, where the study may use two cores.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..paths import SCENES
from ..progress import say
from ..run_store import Store, each
from . import fronts
from .frame_budget import frame_budget
from .race import FULL, QUICK, REFERENCE_LIMIT, REGIMES, SceneStudy, is_dynamic
from .result import Result, Section, alone


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Error against seconds for every method."""
    names = [name for scenes in REGIMES.values() for name in scenes]
    files = arguments.scenes or [SCENES / f"{name}.toml" for name in names]
    effort = QUICK if arguments.quick else FULL
    effort = replace(effort, repetitions=arguments.repetitions or effort.repetitions)
    timed, store = Store(folder / "runs", arguments.time_limit), Store(folder / "runs", REFERENCE_LIMIT)
    studies = [SceneStudy(file.resolve(), effort, timed, store) for file in files]
    n_runs = sum(m.method.n_draws(effort) for scene in studies for m in scene.measurements)
    say(f"{n_runs} runs of up to {arguments.time_limit:g} s, most of a second: hours", arguments.quiet)
    with alone(arguments.quiet):
        list(each(lambda scene: scene.run(arguments.quiet), studies))
    sections = [
        Section(
            "Cheapest springs and cheapest elements",
            [fronts.LEVELS],
            {},
            {"levels": fronts.levels(studies), "regimes": fronts.regimes(studies)},
        ),
        *([frame_budget(moving)] if (moving := [s for s in studies if is_dynamic(s.scene)]) else []),
        *(fronts.section(scene) for scene in studies),
    ]
    protocol = {f"{s.name}: the scene, before the ladder's values": s.file.read_text() for s in studies}
    return Result("Work and precision", fronts.finding(studies), sections, protocol)
