"""A simulated deflation played backwards at a warped speed is an inflation [paper 4, fig. 10].

    python -m analysis.drawing.warp RUN_FOLDER elastic [--fps 25] [--seconds 4] [--forwards]

writes RUN_FOLDER/playback: frames.pvd with the surface at each moment of the film (ParaView), and film.gif.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..compare import displacement_at
from ..runs import Array, Run, RunError, load_run, method_of
from ..time_warp import WARPS, Warp, warp_of
from .film import draw_film
from .pictures import surface_of


def playback_times(run: Run, warp: Warp, n_frames: int, is_reversed: bool) -> Array:
    """Times of the simulation (n_frames) that the film shows one after the other.

    Reversed: warp w shows the simulation at its end less w of its length, so that the constant warp is its mirror.
    """
    first, last = run.times[0], run.times[-1]
    share = np.clip(warp(np.linspace(0, 1, n_frames)), 0, 1)
    return last - share * (last - first) if is_reversed else first + share * (last - first)


def draw_playback(folder: Path, run: Run, settings: dict[str, Any]) -> Array:
    """Writes frames.pvd with frames/*.vtp (times of the film, s) and film.gif; returns the times of the simulation.

    settings: warp, reversed, seconds, fps and, of a custom warp, points or expression.
    """
    warp = warp_of(settings["warp"], settings.get("points"), settings.get("expression", ""))
    n_frames = max(2, round(settings["seconds"] * settings["fps"]) + 1)
    times = playback_times(run, warp, n_frames, settings["reversed"])
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    for old in folder.glob("frames/*.vtp"):
        old.unlink()
    sets = []
    for number, time in enumerate(times):
        u = displacement_at(run, time)
        surface = surface_of(run.last.X + u, run.last.F)
        surface["displacement"] = u
        name = f"frames/frame_{number:06d}.vtp"
        surface.save(folder / name)
        sets.append(f'<DataSet timestep="{number / settings["fps"]!r}" file="{name}"/>')
    draw_film(folder / "film.gif", {method_of(run): run}, seconds=settings["seconds"], times=times)
    pvd = f'<VTKFile type="Collection" version="0.1"><Collection>{"".join(sets)}</Collection></VTKFile>\n'
    (folder / "frames.pvd").write_text(pvd)
    return times


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m analysis.drawing.warp", description=__doc__.splitlines()[0]
    )
    parser.add_argument("run", type=Path, metavar="RUN_FOLDER")
    parser.add_argument("warp", help=f"{', '.join(WARPS)}, or an expression in t such as 't**3'")
    parser.add_argument("--fps", type=float, default=25)
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--forwards", action="store_true", help="the simulation's own direction")
    arguments = parser.parse_args(words)
    is_named = arguments.warp in WARPS
    settings = {
        "warp": arguments.warp if is_named else "custom",
        "expression": "" if is_named else arguments.warp,
        "reversed": not arguments.forwards,
        "seconds": arguments.seconds,
        "fps": arguments.fps,
    }
    try:
        draw_playback(arguments.run / "playback", load_run(arguments.run), settings)
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(arguments.run / "playback")
    return 0


if __name__ == "__main__":
    sys.exit(main())
