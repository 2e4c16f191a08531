"""./testbed study NAME: the table of studies, and the command that runs them.

Each leaves a report, its tables as CSV and its figures as SVG in one folder.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..cluster import engine_of, whole_number
from ..folder_lock import locked
from ..outputs import forget
from ..paths import ROOT
from ..progress import reminders
from ..runs import RunError
from . import (
    accuracy,
    cluster,
    contact,
    cost,
    estimate,
    gallery,
    kernels,
    paper,
    peers,
    processes,
    reference,
    scaling,
    stability,
    strips,
    supports,
    survey,
    verdicts,
    work_precision,
)
from .result import Result, protocol_of, text_of, write


class Study(NamedTuple):
    """An entry of the table."""

    help: str  #: one line
    measure: Callable[
        [argparse.Namespace, Path], Result
    ]  #: of the command's options and the folder of the results
    takes: frozenset[str] = frozenset({"quick"})  #: of the options that not every study has


# A new study is a new line.
STUDIES = {
    "work-precision": Study(
        "error against seconds: every spring model and finite elements, over resolutions or time steps",
        work_precision.study,
        frozenset({"scenes", "quick", "repetitions", "time_limit"}),
    ),
    "stability": Study(
        "what becomes of a body let go from bad starts, over step and stiffness, as maps",
        stability.study,
        frozenset({"quick", "seeds", "candidates"}),
    ),
    "scaling": Study(
        "seconds, memory and non-zeros from a thousand nodes to a million",
        scaling.study,
        frozenset({"quick", "repetitions"}),
    ),
    "cost": Study(
        "instructions of a time step, the scene's parts switched on one at a time", cost.study, frozenset()
    ),
    "kernels": Study(
        "seconds of solvers and kernels beside the machine's limits and an earlier commit",
        kernels.study,
        frozenset({"quick", "repetitions", "time_limit", "against"}),
    ),
    "paper": Study(
        "table 1 and figures 7, 9, 10 and 11 beside the paper's, as published too, and a verdict for each of its claims",
        paper.study,
        frozenset({"scenes", "quick", "repetitions"}),
    ),
    "strips": Study(
        "figure 11 by springs and by elements: shapes, volume and seconds, and what chance alone makes",
        strips.study,
        frozenset({"scenes", "quick"}),
    ),
    "contact": Study(
        "contact beside closed forms and quadratic elements: a sphere on a half-space, plates, a skin under refinement",
        contact.study,
        frozenset(),
    ),
    "reference": Study(
        "what elements lose by degree and refinement, what explicit ones cost, and frequencies beside the springs'",
        reference.study,
    ),
    "peers": Study(
        "seconds of DOLFINx and CalculiX beside the reference's, and of Bullet beside the springs'",
        peers.study,
    ),
    "processes": Study(
        "statics by one process, two and four under mpirun: seconds, messages, memory", processes.study
    ),
    "gallery": Study("every shipped scene run, and its picture for the gallery page", gallery.study),
    "accuracy": Study(
        "springs on bodies and loads drawn at random, beside finite elements, against refined ones: an hour",
        accuracy.study,
        frozenset({"quick", "held_out"}),
    ),
    "supports": Study(
        "where on bodies whose supports move the springs' error sits: at supports, sharp edges or elsewhere",
        supports.study,
    ),
    "estimate": Study(
        "the springs' own estimates beside their errors, and nodes added for a target, on the same bodies: an hour",
        estimate.study,
        frozenset({"quick", "held_out", "count"}),
    ),
    "cluster": Study(
        "a sweep of small runs by one worker and by two, one of which is killed: half an hour", cluster.study
    ),
    "survey": Study(
        "whether closed surfaces in a folder end in both programs, as they are and remeshed: hours",
        survey.study,
        frozenset({"quick", "held_out", "bodies", "count"}),
    ),
    "verdicts": Study(
        "whether verdicts on the same bodies hold against a finer reference: two hours", verdicts.study
    ),
}


def examples() -> str:
    """The end of the help: what there is to study, and how it is asked for."""
    width = max(map(len, STUDIES))
    lines = [f"  {name:{width}}  {study.help}" for name, study in STUDIES.items()]
    first, *_ = STUDIES
    calls = [first, f"{first} analysis/scenes/bar_sag.toml --quick"]
    return "\n".join(
        ["studies:", *lines, "", "examples:", *(f"  ./testbed study {words}" for words in calls), ""]
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", choices=STUDIES)
    parser.add_argument(
        "scenes", nargs="*", type=Path, metavar="SCENE.toml", help="instead of the study's own"
    )
    parser.add_argument("--quick", action="store_true", help="few and small: to try it out")
    parser.add_argument(
        "--repetitions",
        type=whole_number,
        metavar="N",
        help="of every timed run (5; of scaling 3); their median counts",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: out/study/NAME")
    parser.add_argument(
        "--time-limit",
        type=float,
        metavar="SECONDS",
        help=f"for one timed run ({_TIME_LIMIT}); what takes longer is a row that says so",
    )
    parser.add_argument(
        "--held-out",
        action="store_true",
        help="accuracy, estimate: the half of the bodies that nothing was developed on; survey: these too",
    )
    parser.add_argument(
        "--seeds",
        type=_seeds,
        metavar="N,N...",
        help="stability: coupled springs alone, from starts that these seeds draw",
    )
    parser.add_argument(
        "--candidates",
        action="store_true",
        help="stability: other laws of coupled springs, from crushed and random starts",
    )
    parser.add_argument("--bodies", type=Path, metavar="DIR", help="survey: a folder of closed surfaces")
    parser.add_argument(
        "--count",
        type=whole_number,
        metavar="N",
        help="survey: so many of them, drawn by the hashes of their files; estimate: so many cases, drawn at random",
    )
    parser.add_argument(
        "--against", metavar="COMMIT", help="kernels: build this commit apart, and measure it in the same run"
    )


_TIME_LIMIT = 120  # s


def _seeds(text: str) -> list[int]:
    return [int(seed) for seed in text.split(",")]


def check_options(arguments: argparse.Namespace) -> None:
    """Raises RunError for an option that means nothing to the study."""
    takes = STUDIES[arguments.name].takes
    for name in (
        "scenes",
        "quick",
        "repetitions",
        "time_limit",
        "against",
        "held_out",
        "bodies",
        "count",
        "seeds",
        "candidates",
    ):
        if getattr(arguments, name) and name not in takes:
            what = "scene" if name == "scenes" else f"--{name.replace('_', '-')}"
            known = ", ".join(sorted(study for study, entry in STUDIES.items() if name in entry.takes))
            raise RunError(f"study {arguments.name} takes no {what}, which is for {known}")


def main(arguments: argparse.Namespace) -> int:
    """./testbed study"""
    check_options(arguments)
    arguments.time_limit = arguments.time_limit or _TIME_LIMIT
    # Scenes in it name files in it.
    folder = (arguments.out or ROOT / "out" / "study" / arguments.name).resolve()
    measure = STUDIES[arguments.name].measure
    with locked(folder), engine_of(arguments), reminders(arguments.name, arguments.quiet):
        if arguments.force:
            forget(folder)
        result = measure(arguments, folder)
        write(folder, result, protocol_of(sys.argv[1:], sys.modules[measure.__module__].__doc__))
    print(f"{text_of(result)}\n\nreport: {folder / 'report.html'}")
    return 0
