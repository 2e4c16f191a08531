"""Command line: python -m analysis run [SCENE.toml] ... (started by ./testbed)."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from . import sweep
from .experiment import default_folder, run_solvers, surface_overrides
from .paths import SCENES
from .remesh import TIME_LIMIT, remesh, remeshed, surface_file
from .report import text_of
from .results import fingerprint, write_results
from .runs import RunError
from .studies import command as study

_RUN_EXAMPLES = """examples:
  ./testbed run                                                 the default scene: a ball under pressure
  ./testbed run analysis/scenes/bar_sag.toml                    another one
  ./testbed run analysis/scenes/sag.toml --surface my_body.stl  a body of yours, clamped and bent
  ./testbed run --set material.nu=0.45 --set network.k=2000     with other values
"""

_REMESH_EXAMPLES = """examples:
  ./testbed remesh plate.stl plate.off
  ./testbed remesh scan.obj scan.off --edge 0.02 --tolerance 0.001
  ./testbed run analysis/scenes/sag.toml --surface plate.stl --remesh    the same on the way
"""

_SWEEP_EXAMPLES = """examples:
  ./testbed sweep --set material.nu=0.25,0.3,0.45 --set network.multiplicity=3,5,8 --set network.calibration=uniform
  ./testbed sweep analysis/scenes/bar_sag.toml --set network.calibration=uniform,affine,node_averaged

On N machines: start "--part 1/N" ... "--part N/N" with one --out on a shared file system, or copy the machines'
DIR/points into one folder; then the same command without --part writes the table.
"""


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="./testbed", description="Run and compare both solvers.")
    commands = parser.add_subparsers(dest="command", required=True)
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--quiet", action="store_true", help="no progress")
    scene = argparse.ArgumentParser(add_help=False)
    scene.add_argument(
        "scene", nargs="?", type=Path, default=SCENES / "ball_pressure.toml", metavar="SCENE.toml",
        help="default: ball_pressure.toml",
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
        "run", [scene],
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
        "--remesh", action="store_true",
        help="first make an even surface of the given one, as ./testbed remesh does; both solvers take it",
    )  # fmt: skip

    remesh = add(
        "remesh", [],
        "Makes an even, closed surface of any triangles: of CAD in needles, of scans with holes and crossings. It stays within a "
        "tolerance of them. The result is checked as ./testbed meshing check does.",
        _REMESH_EXAMPLES,
    )  # fmt: skip
    remesh.add_argument("source", type=Path, metavar="IN", help="surface: .obj .off .ply .stl .vtp .vtu")
    remesh.add_argument("target", type=Path, metavar="OUT", help="file to write: .off or .obj")
    remesh.add_argument(
        "--edge", type=float, metavar="M", help="wanted, in the file's unit; default: for some 2500 vertices"
    )
    remesh.add_argument(
        "--tolerance", type=float, metavar="M",
        help="between new and old surface, in the file's unit; default: a thousandth of the box's diagonal",
    )  # fmt: skip
    remesh.add_argument(
        "--time-limit", type=float, default=TIME_LIMIT, metavar="S", help="s; default: %(default)s"
    )

    sweep = add(
        "sweep", [scene],
        "Runs both solvers over a grid of values: a table and a plot of how far they differ. A sweep that was killed "
        "continues; a point that fails is a row that says why.",
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
        help="run only the I-th of every N points, on one of N machines",
    )
    study.add_arguments(
        add(
            "study",
            [],
            "Measures something over many runs and reports it. A study that was killed continues. Timed runs are made one "
            "at a time: leave the machine alone meanwhile.",
            study.examples(),
        )
    )
    return parser.parse_args(arguments)


def _part(text: str) -> tuple[int, int]:
    share, _, of = text.partition("/")
    if not (share.isdigit() and of.isdigit() and 1 <= int(share) <= int(of)):
        raise argparse.ArgumentTypeError(f"'{text}', expected I/N with 1 <= I <= N")
    return int(share), int(of)


def run(arguments: argparse.Namespace) -> int:
    folder = arguments.out or default_folder(arguments.scene, arguments.surface)
    overrides = [*arguments.overrides, *surface_overrides(arguments)]
    surface, notes = arguments.surface, []
    if arguments.remesh:
        source = surface or surface_file(arguments.scene, overrides)
        surface, note = remeshed(source, folder, arguments.quiet)
        notes.append(note)
    experiment = run_solvers(arguments.scene, folder, surface, overrides, arguments.quiet, notes)
    file = folder / "comparison.json"
    comparison = json.loads(file.read_text()) if file.exists() else {}
    if comparison.get("fingerprint") != fingerprint(experiment):
        if not arguments.quiet:
            print("comparing and drawing", file=sys.stderr)
        comparison = write_results(experiment)

    print(f"{text_of(comparison)}\n\nreport: {folder / 'report.html'}")
    return 0 if comparison["status"] == "ok" else 1


def remesh_command(arguments: argparse.Namespace) -> int:
    if not arguments.quiet:
        print(f"remeshing, {arguments.time_limit:g} s at most", file=sys.stderr)
    done = remesh(
        arguments.source, arguments.target, arguments.edge, arguments.tolerance, arguments.time_limit
    )
    print(f"{done.text()}\n\n{arguments.target}")
    return 0


_COMMANDS = {"run": run, "sweep": sweep.main, "study": study.main, "remesh": remesh_command}


def main() -> int:
    try:
        arguments = parse_arguments(sys.argv[1:])
        return _COMMANDS[arguments.command](arguments)
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
