"""Command line: python -m analysis run [SCENE.toml] ... (started by ./testbed)."""

from __future__ import annotations

import argparse
import io
import math
import os
import shlex
import signal
import sys
import traceback
from pathlib import Path

from . import cluster, grid, pair, remesh, reproduce
from .drawing import export, replay
from .experiment import TIME_LIMIT, default_folder, run_solvers, surface_file, surface_overrides
from .folder_lock import locked
from .index import write_index
from .outputs import forget
from .paths import OUT, SCENES
from .report import text_of
from .results import results_of
from .runs import NOT_OK, SOLVED, RunError, StoppedEarlyError
from .studies import command as study

DEFAULT = "torus_inflates.toml"  #: the scene of a run that names none

_RUN_EXAMPLES = """examples:
  ./testbed run                                                 the default scene: a torus is blown up
  ./testbed run analysis/scenes/bar_sag.toml                    another one
  ./testbed run analysis/scenes/own_body.toml --surface my_body.stl --units mm   a body of yours, clamped and pushed
  ./testbed run analysis/scenes/own_body.toml --surface plate.stl --remesh       the same of CAD or of a broken scan
  ./testbed run --set material.nu=0.45 --set network.k=2000     with other values

exit status:
  0  the scene's own spring model has been compared
  1  an error, or nothing to compare
  2  a report is written, but that model or the reference did not reach the end; also for a wrong option, and without a report
     where --budget was spent before the reference had an end
"""

_REMESH_EXAMPLES = """examples:
  ./testbed remesh plate.stl plate.off
  ./testbed remesh scan.obj scan.off --edge 0.02 --tolerance 0.001
  ./testbed run analysis/scenes/own_body.toml --surface plate.stl --remesh    the same on the way
"""

_SWEEP_EXAMPLES = """examples:
  ./testbed sweep --set material.nu=0.25,0.3,0.45 --set network.multiplicity=3,5,8 --set network.calibration=uniform
  ./testbed sweep analysis/scenes/bar_sag.toml --set network.calibration=uniform,affine,node_averaged

On several machines: analysis/CLUSTER.md. Or without an engine: start "--part 1/N" ... "--part N/N" with one --out on a
shared file system, or copy the machines' DIR/runs into one folder; then the same command without --part writes the table.
"""


_WORKER_EXAMPLES = """example, on two machines:
  PYTHONPATH=. .venv/bin/dask scheduler --host 192.168.0.1
  ./testbed worker tcp://192.168.0.1:8786                              on each machine
  ./testbed study accuracy --cluster tcp://192.168.0.1:8786
"""


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="./testbed", description="Run and compare both solvers.")
    commands = parser.add_subparsers(dest="command", required=True)
    common = argparse.ArgumentParser(add_help=False)
    forced = argparse.ArgumentParser(add_help=False)
    forced.add_argument(
        "--force",
        action="store_true",
        help="forget all results in the output folder, and run everything anew",
    )
    common.add_argument("--quiet", action="store_true", help="no progress")
    scene = argparse.ArgumentParser(add_help=False)
    scene.add_argument(
        "scene", nargs="?", type=Path, default=SCENES / DEFAULT, metavar="SCENE.toml",
        help=f"default: {DEFAULT}",
    )  # fmt: skip
    scene.add_argument(
        "--surface", type=Path, metavar="FILE", help="use this closed surface (.obj .off .ply .stl .vtp .vtu)"
    )
    scene.add_argument(
        "--up", choices=["y", "z"], help="axis of the surface that points up: z is turned to y"
    )
    scene.add_argument("--units", choices=["m", "cm", "mm", "in"], help="of the surface's coordinates")

    def add(
        name: str, parents: list[argparse.ArgumentParser], description: str, examples: str
    ) -> argparse.ArgumentParser:
        return commands.add_parser(
            name, parents=[*parents, common], description=description, epilog=examples,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip

    run = add(
        "run", [scene, forced],
        "Runs both solvers on a scene and reports how far they differ. What has not changed is not run again.",
        _RUN_EXAMPLES,
    )  # fmt: skip
    run.add_argument(
        "--out", type=Path, metavar="DIR", help="where results go; default: out/NAME of the scene"
    )
    run.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
        help="replace a value of the scene, e.g. material.nu=0.3; may be repeated",
    )  # fmt: skip
    run.add_argument(
        "--paper", action="append_const", const="paper=true", dest="overrides",
        help="the PCP paper's method as published, whatever the scene's keys say",
    )  # fmt: skip
    run.add_argument(
        "--remesh", action="store_true",
        help="first make an even, closed surface of the file's triangles, within a 500th of the body's size",
    )  # fmt: skip

    run.add_argument(
        "--time-limit", type=float, default=TIME_LIMIT, metavar="SECONDS",
        help="what a further solve of the finite elements may take, which tells their own error; default: %(default)g",
    )  # fmt: skip

    run.add_argument(
        "--budget", type=_seconds, metavar="SECONDS",
        help="wall-clock time that all solves may take together; the same command goes on with what was stopped",
    )  # fmt: skip

    new = add(
        "remesh", [],
        "Makes an even, closed surface of any triangles (CAD, scans, soups), whose parts it unites, and tells how far it "
        "lies from them.",
        _REMESH_EXAMPLES,
    )  # fmt: skip
    new.add_argument("surface", type=Path, metavar="IN", help="triangles (.obj .off .ply .stl .vtp .vtu)")
    new.add_argument("out", type=Path, metavar="OUT", help="file to write (.obj or .off)")
    new.add_argument(
        "--edge", type=float, metavar="M",
        help=f"length of its edges, in the file's unit; default: for some {remesh.N_VERTICES} vertices",
    )  # fmt: skip
    new.add_argument(
        "--tolerance", type=float, metavar="M",
        help="how far it may lie from the triangles; default: a 500th of the diagonal of their box",
    )  # fmt: skip

    sweep = add(
        "sweep", [scene, forced],
        "Runs both solvers over a grid of values: a table and a plot of how far they differ. A sweep that was killed "
        "continues; a run that fails is a row that says why.",
        _SWEEP_EXAMPLES,
    )  # fmt: skip
    sweep.add_argument("--out", type=Path, metavar="DIR", help="default: out/sweep/NAME of the scene")
    sweep.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE,VALUE...", dest="overrides",
        help="values of a key of the scene; several keys make a grid",
    )  # fmt: skip
    sweep.add_argument(
        "--part",
        type=_part,
        default=(1, 1),
        metavar="I/N",
        help="run only the I-th of every N runs, on one of N machines",
    )
    cluster.add_arguments(sweep)
    compare = add(
        "compare", [],
        "Compares two results on the same surface, whoever computed them: the folder of a run (as fem_reference in out/NAME), "
        "CalculiX's .frd in ASCII, a VTK file (.vtk .vtu .vtp) with 'displacement' at its points, or FEBio's "
        '<node_data data="x;y;z;ux;uy;uz" file="...">. Vertices are matched by their positions at rest, the ends are compared.',
        "example:\n  ./testbed compare job.frd out/bar_sag/fem_reference\n",
    )  # fmt: skip
    compare.add_argument("model", type=Path, metavar="A", help="the model")
    compare.add_argument("reference", type=Path, metavar="B", help="the reference")
    compare.add_argument("--out", type=Path, metavar="DIR", help="default: out/compare/A-B")
    export.add_arguments(
        add(
            "export",
            [],
            "Makes a film or animated glTF (.glb) of a run, which Blender opens. Points and triangles of glTF are those of the "
            "surface's file, in its order and its coordinates.",
            "example:\n  ./testbed export out/torus_inflates/fem_reference --reverse\n",
        )
    )
    replay.add_arguments(
        add(
            "view",
            [],
            "Replays finished runs side by side in a window: with one camera, colours, curves and a slider of time.",
            "example:\n  ./testbed view out/torus_inflates/fem_reference out/torus_inflates/massspring/uniform\n",
        )
    )
    again = add(
        "reproduce", [forced],
        "Makes published tables and figures again and shows what differs from the stored ones, by analysis/manifest.toml. "
        "What is finished is not run again; the exit status is 1 where anything differs. Rows of bodies that are not shipped "
        "are left out, and it is said where these are found.",
        "example:\n  ./testbed reproduce readme statics\n",
    )  # fmt: skip
    again.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of: {', '.join(reproduce.entries())}; default: all"
    )
    cluster.add_arguments(again)
    again.add_argument("--write", action="store_true", help="write tables and figures anew, of a commit")
    measure = add(
        "study", [forced],
        "Measures something over many runs and reports it. A study that was killed continues. Timed runs are made one "
        "at a time: leave the machine alone meanwhile.",
        study.examples(),
    )  # fmt: skip
    study.add_arguments(measure)
    cluster.add_arguments(measure)
    cluster.add_worker_arguments(
        add(
            "worker",
            [],
            "Makes runs for those who ask the scheduler at an address, until it is stopped. One on each machine: the first "
            "takes timed runs, and makes no others meanwhile.",
            _WORKER_EXAMPLES,
        )
    )
    return parser.parse_args(arguments)


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}', expected more than 0 s")
    return seconds


def _part(text: str) -> tuple[int, int]:
    share, _, of = text.partition("/")
    if not (share.isdigit() and of.isdigit() and 1 <= int(share) <= int(of)):
        raise argparse.ArgumentTypeError(f"'{text}', expected I/N with 1 <= I <= N")
    return int(share), int(of)


def run(arguments: argparse.Namespace) -> int:
    folder = arguments.out or default_folder(arguments.scene, arguments.surface)
    with locked(folder):
        return _run_in(folder, arguments)


def _run_in(folder: Path, arguments: argparse.Namespace) -> int:
    if arguments.force:
        forget(folder)
    surface, overrides = arguments.surface, [*arguments.overrides, *surface_overrides(arguments)]
    if arguments.remesh:
        surface = remesh.remeshed_of(surface or surface_file(arguments.scene), folder)
    experiment = run_solvers(
        arguments.scene, folder, surface, overrides, arguments.quiet, arguments.time_limit,
        budget=arguments.budget,
    )  # fmt: skip
    comparison = results_of(experiment, arguments.quiet)
    print(f"{text_of(comparison)}\n\nreport: {folder / 'report.html'}")
    if folder.resolve().is_relative_to(OUT):
        print(f"all runs: {write_index(OUT)}")
    return SOLVED if comparison["status"] == "ok" else NOT_OK


_COMMANDS = {
    "run": run, "remesh": remesh.main, "sweep": grid.main, "compare": pair.main, "study": study.main,
    "reproduce": reproduce.main, "worker": cluster.serve, "export": export.main, "view": replay.main,
}  # fmt: skip


def main() -> int:
    for stream in (sys.stdout, sys.stderr):
        assert isinstance(stream, io.TextIOWrapper)
        stream.reconfigure(errors="backslashreplace")  # names of files need not be text
    try:
        arguments = parse_arguments(sys.argv[1:])
        status = _COMMANDS[arguments.command](arguments)
        sys.stdout.flush()
        return status
    except RunError as error:
        if not error.is_told:
            print(f"error: {error}", file=sys.stderr)
        return NOT_OK if isinstance(error, StoppedEarlyError) else 1
    except MemoryError:
        print("error: takes more memory than there is, expected a coarser body", file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python fails again when it ends
        return 128 + signal.SIGPIPE
    except KeyboardInterrupt:
        # What is finished is kept; a solver at work has got the signal, too, or dies with this process.
        print(f"\nstopped; to continue: ./testbed {shlex.join(sys.argv[1:])}", file=sys.stderr)
        return 130
    except Exception as error:  # a file that cannot be written, or our mistake
        print(f"error: {told(error)}", file=sys.stderr)
        return 1


def told(error: Exception) -> str:
    """An unforeseen error in one line, with the place in the code that met it."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = "" if isinstance(error, OSError) else f" ({Path(last.filename).name}:{last.lineno})"
    return " ".join(f"{type(error).__name__}: {error}{where}".split())


if __name__ == "__main__":
    sys.exit(main())
