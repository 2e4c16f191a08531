"""A finished run as a film, or as animated glTF for Blender."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from ..paths import OUT
from ..runs import SOLVED, Run, RunError, load_run, method_of
from ..time_warp import WARPS, warp_of
from .film import draw_film
from .gltf import write_gltf
from .warp import playback_times

_SUFFIXES = {"gltf": ".glb", "film": ".gif"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a run, e.g. out/NAME/fem_reference")
    parser.add_argument(
        "--format", choices=list(_SUFFIXES), default="gltf", help="of the file; default: %(default)s"
    )
    parser.add_argument("--reverse", action="store_true", help="play it backwards")
    parser.add_argument(
        "--warp", choices=list(WARPS), default="constant", help="of time; default: %(default)s"
    )
    parser.add_argument("--seconds", type=float, default=4, help="length of the film; default: %(default)g")
    parser.add_argument("--fps", type=float, default=25, help="frames a second; default: %(default)g")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="default: out/export/NAME-METHOD.glb or .gif"
    )


def opened(folder: Path) -> Run:
    """A finished run. Raises RunError, which names the runs that a pair's folder holds."""
    within = sorted(str(file.parent) for file in folder.glob("*/**/run.json"))
    if within and not (folder / "run.json").is_file():
        raise RunError(f"{folder}: holds several runs, expected one of {', '.join(within)}")
    return load_run(folder, may_stop=True)


def main(arguments: argparse.Namespace) -> int:
    for name in ("seconds", "fps"):
        if not 0 < (value := getattr(arguments, name)) < 1e6:
            raise RunError(f"--{name} {value:g}, expected more than 0 and less than a million")
    run = opened(arguments.run)
    suffix = _SUFFIXES[arguments.format]
    name = run.record.get("name", run.folder.name)
    file = arguments.out or OUT / "export" / f"{name}-{method_of(run)}{suffix}"
    if file.suffix != suffix:
        raise RunError(f"--out {file}: expected the extension {suffix} of --format {arguments.format}")
    file.parent.mkdir(parents=True, exist_ok=True)
    n_frames = max(2, round(arguments.seconds * arguments.fps) + 1)
    times = playback_times(run, warp_of(arguments.warp), n_frames, arguments.reverse)
    if arguments.format == "gltf":
        write_gltf(file, run, times, arguments.seconds)
    else:
        unfinished = file.with_suffix(f".{os.getpid()}.gif")
        draw_film(unfinished, {method_of(run): run}, seconds=arguments.seconds, times=times)
        unfinished.replace(file)
    print(file)
    return SOLVED
