"""The pictures, films and plots of a comparison."""

from __future__ import annotations

from pathlib import Path

from .compare import ModelComparison, area_change, is_dynamic, tip_of, vertex_areas, volume_change
from .comparison import Comparison
from .drawing.bodies import Body, bodies_of, draw_bodies, draw_thumbnail, has_cavity
from .drawing.error_scale import scale_svg
from .drawing.film import draw_film, draw_strip
from .drawing.pictures import magnification
from .drawing.plots import (
    SMALLEST,
    Panel,
    Plot,
    plot_curves,
    plot_errors,
    plot_errors_over_surface,
    plot_times,
)
from .drawing.view import Shown, write_view
from .drawing.warp import draw_playback
from .methods import REFERENCE, label_of
from .paths import THUMBNAIL, VIEW
from .report import Row
from .verdict import of_solution
from .wording import listed, percent, significant, unit_of_length


def draw_row(comparison: Comparison) -> Row | None:
    """Draws the bodies into the experiment's folder; None where there is no reference."""
    reference, experiment = comparison.reference, comparison.experiment
    if not reference:
        return None
    end = float(reference.times[reference.widest if is_dynamic(reference) else -1])
    X, F = reference.last.X, reference.last.F
    is_cut = has_cavity(X, F)
    bodies: dict[str, Body] = {}
    moments = {}
    for name, run in comparison.runs.items():
        time = min(end, float(run.times[-1]))
        body, bodies[name] = bodies_of(run, reference, time, experiment.is_free, is_cut)
        if time == end or REFERENCE not in bodies:
            bodies[REFERENCE] = body
        if time < end:
            moments[name] = f" at load factor {significant(time)}"
    if not bodies:
        return None
    bodies = {REFERENCE: bodies.pop(REFERENCE), **bodies}
    moment = f" at {significant(end)} s" if is_dynamic(reference) else ""
    if reference.stopped:
        moment = f" at load factor {significant(end)}"
    found = {
        name: f"error {percent(model.displacement_error_l2)}" + moments.get(name, "")
        for name, model in comparison.models.items()
        if isinstance(model, ModelComparison)
    } | {REFERENCE: "the reference"}
    shown = {name: Shown(label_of(name), found[name], body) for name, body in bodies.items()}
    return row_of(experiment.folder, f"{experiment.name}, {experiment.surface}", moment, shown)


def row_of(folder: Path, title: str, moment: str, shown: dict[str, Shown]) -> Row:
    """Draws bodies side by side into a folder.

    title: of the view; moment: where the bodies are, as " at 2 s"; shown: method, or another key that names a picture, -> body,
    the reference's first.
    """
    bodies = [panel.body for panel in shown.values()]
    X, F = bodies[0].X, bodies[0].F
    factor = magnification(X, bodies[0].u)
    files = [folder / f"body_{name}.png" for name in shown]
    draw_bodies(files, bodies, factor)
    draw_thumbnail(folder / THUMBNAIL, files)
    drawn = "as large as they are" if factor == 1 else f"{factor:g} times as large"
    words = f"The bodies{moment}, displacements drawn {drawn}, coloured by error."
    write_view(folder / VIEW, title, words, list(shown.values()), factor)
    caption = f"{words} Dashes: the outline of the body at rest, drawn over what hides it."
    if is_open := [panel.name for panel in shown.values() if panel.body.inside is not None]:
        caption += f" Cut open: {listed(is_open)}{'' if len(is_open) == len(shown) else '; others have no tetrahedra'}."
    errors = {name: panel.body.error for name, panel in shown.items() if panel.body.error is not None}
    labels = {name: panel.name for name, panel in shown.items()}
    spread = plot_errors_over_surface(errors, vertex_areas(X, F), labels)
    panels = [(panel.name, panel.found, file) for panel, file in zip(shown.values(), files, strict=True)]
    return Row(panels, scale_svg(), spread, caption, VIEW)


def draw_films(comparison: Comparison) -> dict[str, Path]:
    """Draws what moves into the experiment's folder; caption -> file."""
    experiment, folder = comparison.experiment, comparison.experiment.folder
    pictures = {}
    shown = comparison.methods
    if shown and not experiment.is_static and min(len(run.times) for run in shown.values()) > 1:
        draw_strip(folder / "strip.png", shown)
        draw_film(folder / "film.gif", shown)
        if not comparison.reference:
            draw_thumbnail(folder / THUMBNAIL, [folder / "strip.png"])
        pictures["Frames in time."] = folder / "strip.png"
        order = ", in the order and the colours of the bodies above" if comparison.reference else ""
        pictures[f"The motion{order}."] = folder / "film.gif"
    playback = experiment.scene.get("playback", {})
    if experiment.calibration in shown and playback.get("warp"):
        draw_playback(folder / "playback", shown[experiment.calibration], playback)
        direction = "backwards" if playback["reversed"] else "again"
        caption = f"Played {direction}, time warp {playback['warp']}."
        pictures[caption] = folder / "playback" / "film.gif"
    return pictures


def plot(comparison: Comparison) -> dict[str, Plot]:
    """Caption -> plot; none where no method gave a result."""
    methods, described = comparison.methods, comparison.of_reference
    if not methods:
        return {}
    plots: dict[str, Plot] = {}
    panels = []
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
            if isinstance(model, ModelComparison)
        }
        caption = "Displacement error of every model, filled, and its largest at a vertex, hollow."
        own = described.estimated_error_l2
        if 100 * (own or 0) > SMALLEST:
            caption += " Grey: the reference's own, estimated."
        plots[caption] = plot_errors(errors, own)
    plots["Wall-clock time by stage."] = plot_times(
        {name: of_solution(run.record["seconds"]) for name, run in methods.items()}
    )
    return plots


def _plot_tip(comparison: Comparison, label: str) -> Plot:
    assert comparison.reference and comparison.of_reference
    tip = tip_of(comparison.reference, comparison.experiment.is_free)
    unit, size = unit_of_length(comparison.of_reference.largest_displacement)
    curves = {name: tip.curve(run, comparison.experiment.is_free) for name, run in comparison.methods.items()}
    return plot_curves([Panel(f"displacement of the tip ({unit})", 1 / size, curves)], label)
