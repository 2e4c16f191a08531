"""Which pictures and plots a comparison shows."""

from __future__ import annotations

from pathlib import Path

from .compare import Figures, displacement_at, is_dynamic, volume_change, widest
from .comparison import Comparison
from .drawing.film import draw_film, draw_strip
from .drawing.pictures import draw_comparison
from .drawing.plots import plot_errors, plot_times, plot_volume
from .drawing.warp import draw_playback
from .methods import REFERENCE, label_of
from .runs import Frame


def draw_pictures(comparison: Comparison) -> dict[str, Path]:
    """Draws into the experiment's folder; caption -> picture's or film's file."""
    experiment, reference, folder = comparison.experiment, comparison.reference, comparison.experiment.folder
    pictures = {}
    if reference:
        for name, run in comparison.runs.items():
            file = folder / f"error_{name}.png"
            time = reference.times[widest(reference) if is_dynamic(reference) else -1]
            here, there = (Frame(r.last.X, displacement_at(r, time), r.last.F) for r in (run, reference))
            draw_comparison(file, here, there, experiment.is_free, label_of(name))
            moment = f" at {time:.3g} s" if is_dynamic(reference) else ""
            pictures[f"Deformed surfaces and the error of the {name} springs{moment}."] = file
    methods = comparison.methods
    shown = {name: methods[name] for name in (experiment.calibration, REFERENCE) if name in methods}
    if shown and not experiment.is_static and min(len(run.times) for run in shown.values()) > 1:
        draw_strip(folder / "strip.png", shown)
        draw_film(folder / "film.gif", shown)
        pictures["Frames in time."] = folder / "strip.png"
        pictures["The motion, and the volume."] = folder / "film.gif"
    playback = experiment.scene.get("playback", {})
    if shown and playback.get("warp"):
        draw_playback(folder / "playback", shown[experiment.calibration], playback)
        direction = "backwards" if playback["reversed"] else "again"
        caption = f"Played {direction}, time warp {playback['warp']}."
        pictures[caption] = folder / "playback" / "film.gif"
    return pictures


def plot(comparison: Comparison) -> dict[str, str]:
    """Caption -> SVG."""
    methods = comparison.methods
    volumes = plot_volume(
        {name: volume_change(run) for name, run in methods.items()},
        "load factor (1)" if comparison.experiment.is_static else "time (s)",
    )
    plots = {}
    if comparison.of_reference:
        errors = {
            name: model.displacement_error_l2
            for name, model in comparison.models.items()
            if isinstance(model, Figures)
        }
        plots["Volume over the load, and the difference from the finite elements."] = volumes
        plots["Displacement error of every model; grey: the reference's own, estimated."] = plot_errors(
            errors, comparison.of_reference.estimated_error_l2
        )
    else:
        plots["Volume."] = volumes
    plots["Wall-clock time by stage."] = plot_times(
        {name: run.record["seconds"] for name, run in methods.items()}
    )
    return plots
