"""Command line: python -m analysis run [SCENE.toml] ... (started by ./testbed)."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .experiment import compare, default_folder, fingerprint, run_solvers
from .report import finding, text_tables
from .runs import RunError

_SCENES = Path(__file__).parent / "scenes"

_EXAMPLES = """examples:
  ./testbed run                                                 the default scene: a ball under pressure
  ./testbed run analysis/scenes/bar_sag.toml                    another one
  ./testbed run analysis/scenes/sag.toml --surface my_body.stl  a body of yours, clamped and bent
  ./testbed run --set material.nu=0.45 --set network.k=2000     with other values
"""


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="./testbed", description="Run and compare both solvers.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser(
        "run",
        description="Runs both solvers on a scene and reports how far they differ. "
        "What has not changed is not run again.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.add_argument(
        "scene", nargs="?", type=Path, default=_SCENES / "ball_pressure.toml", metavar="SCENE.toml",
        help="default: ball_pressure.toml",
    )  # fmt: skip
    run.add_argument(
        "--surface", type=Path, metavar="FILE", help="use this closed surface (.obj .off .ply .stl .vtp .vtu)"
    )
    run.add_argument(
        "--out", type=Path, metavar="DIR", help="where results go; default: out/NAME of the scene"
    )
    run.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
        help="replace a value of the scene, e.g. material.nu=0.3; may be repeated",
    )  # fmt: skip
    run.add_argument("--quiet", action="store_true", help="no progress")
    return parser.parse_args(arguments)


def run(arguments: argparse.Namespace) -> int:
    folder = arguments.out or default_folder(arguments.scene, arguments.surface)
    experiment = run_solvers(arguments.scene, folder, arguments.surface, arguments.overrides, arguments.quiet)
    file = folder / "comparison.json"
    comparison = json.loads(file.read_text()) if file.exists() else {}
    if comparison.get("fingerprint") != fingerprint(experiment):
        if not arguments.quiet:
            print("comparing and drawing", file=sys.stderr)
        comparison = compare(experiment)

    print(f"{finding(comparison)}\n\n{text_tables(comparison)}\n\nreport: {folder / 'report.html'}")
    return 0 if comparison["status"] == "ok" else 1


def main() -> int:
    try:
        return run(parse_arguments(sys.argv[1:]))
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
