"""Which pictures and plots a comparison shows."""

from __future__ import annotations

from pathlib import Path

from .compare import Figures, area_change, displacement_at, is_dynamic, tip_of, volume_change
from .comparison import Comparison
from .drawing.film import draw_film, draw_strip
from .drawing.pictures import draw_comparison
from .drawing.plots import SMALLEST, Panel, plot_curves, plot_errors, plot_times
from .drawing.warp import draw_playback
from .methods import REFERENCE, label_of
from .runs import Frame
from .wording import listed, significant, unit_of_length


def draw_pictures(comparison: Comparison) -> dict[str, Path]:
    """Draws into the experiment's folder; caption -> picture's or film's file."""
    experiment, reference, folder = comparison.experiment, comparison.reference, comparison.experiment.folder
    pictures = {}
    if reference:
        for name, run in comparison.runs.items():
            file = folder / f"error_{name}.png"
            time = min(reference.times[reference.widest if is_dynamic(reference) else -1], run.times[-1])
            here, there = (Frame(r.last.X, displacement_at(r, time), r.last.F) for r in (run, reference))
            draw_comparison(file, here, there, experiment.is_free, label_of(name))
            moment = f" at {significant(time)} s" if is_dynamic(reference) else ""
            if run.stopped or reference.stopped:
                moment = f" at load factor {significant(time)}"
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
    methods, described = comparison.methods, comparison.of_reference
    plots, panels = {}, []
    label = "load factor (1)" if comparison.experiment.is_static else "time (s)"
    changes = {"volume": volume_change, "area": area_change}
    for part, change in changes.items():
        if not (described and (described.keeps_volume if part == "volume" else described.keeps_area)):
            panels.append(
                Panel(f"{part} change (%)", 100, {name: change(run) for name, run in methods.items()})
            )
    shown = listed([panel.label.split()[0] for panel in panels])
    if described and described.keeps_volume:
        plots["Displacement of the tip, the vertex that moves farthest, in its direction."] = _plot_tip(
            comparison, label
        )
    if panels:
        below = ", and below the difference from the finite elements" if described else ""
        plots[f"Change of {shown}{below}."] = plot_curves(panels, label)
    if described:
        errors = {
            name: (model.displacement_error_l2, model.displacement_error_max)
            for name, model in comparison.models.items()
            if isinstance(model, Figures)
        }
        caption = "Displacement error of every model, filled, and its largest at a vertex, hollow."
        own = described.estimated_error_l2
        if 100 * (own or 0) > SMALLEST:
            caption += " Grey: the reference's own, estimated."
        plots[caption] = plot_errors(errors, own)
    plots["Wall-clock time by stage."] = plot_times(
        {name: run.record["seconds"] for name, run in methods.items()}
    )
    return plots


def _plot_tip(comparison: Comparison, label: str) -> str:
    assert comparison.reference and comparison.of_reference
    tip = tip_of(comparison.reference, comparison.experiment.is_free)
    unit, size = unit_of_length(comparison.of_reference.largest_displacement)
    curves = {name: tip.curve(run, comparison.experiment.is_free) for name, run in comparison.methods.items()}
    return plot_curves([Panel(f"displacement of the tip ({unit})", 1 / size, curves)], label)
