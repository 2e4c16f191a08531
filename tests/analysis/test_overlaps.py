"""No text of a plot covers another, and no legend a curve: in plots of quick studies, which have little to show, too."""

import csv
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from overlaps import overlaps
from races import timed

from analysis import grid
from analysis.drawing import error_scale, plots
from analysis.methods import REFERENCE
from analysis.paths import SCENES
from analysis.run_store import Outcome, read_toml
from analysis.studies import accuracy, cost, fronts, network_curves, paper, scaling, stability
from analysis.studies.race import SMALL, Measurement, Rung, methods_of

MODELS = ("node_averaged", "edge_coupled", "affine", "uniform", "van_gelder", "lloyd", "moment")


def race(name, sizes):
    """As the study races the methods of a scene; seconds and errors by chance."""
    random, found = np.random.default_rng(1), []
    for method in methods_of(read_toml(SCENES / f"{name}.toml"), SMALL):
        for size in sizes:
            seconds = {stage: 10 ** random.uniform(-2, 1) for stage in ("mesh", "setup", "solve")}
            runs = [timed(**seconds), timed(**{stage: 1.3 * s for stage, s in seconds.items()})]
            errors = [10 ** random.uniform(-3, -0.2) for _ in runs]
            of = Measurement(method, Rung(size), runs, runs, errors=errors, reference_error=0.004)
            found.append(of)
    return SimpleNamespace(measurements=found, name=name)


def grown(nodes):
    """Every line of the study of growth."""
    found = []
    for line in scaling.LINES:
        for n in nodes:
            seconds = {
                stage: 1e-6 * n**1.2 * (1 + k)
                for k, stage in enumerate(("mesh", "setup", "assemble", "solve"))
            }
            record = {
                "n_nodes": n,
                "n_springs": 6 * n,
                "peak_memory": 100 * n + 2e8,
                "seconds": seconds,
                "n_steps": 50,
            }
            found.append(scaling.Size(line, [Outcome("ok", "", 1, 1, 0, record=record)]))
    return found


def starts(methods):
    """Cells of a map, an outcome each."""
    outcome = itertools.cycle(stability.OUTCOMES)
    columns = ("rest", "squashed", "crushed", "mirrored", "flattened", "random")
    return [
        {"method": m, "start": s, "E": f"{E:g}", "h": f"{h:g}", "outcome": next(outcome)}
        for m in methods
        for s in columns
        for E in 10.0 ** np.arange(3, 10)
        for h in (1e-4, 1e-3, 1e-2, 0.1, 1)
    ]


def curves(n):
    times = np.linspace(0, 1, n)
    return {name: (times, 0.1 * k * times**2 - 0.02) for k, name in enumerate((REFERENCE, *MODELS))}


def costs():
    random = np.random.default_rng(2)
    return [
        cost.Cost(part, 1e6 if part == cost.ALONE else 10 ** random.uniform(6, 7.2)) for part in cost.PARTS
    ]


def published(n):
    with accuracy.DATA.open(newline="") as lines:
        return list(csv.DictReader(lines))[:n]


def on_networks(spread):
    return [
        network_curves.Measured(ladder, network, value, 500, [5 * k + 2, (5 * k + 2) * spread])
        for ladder in network_curves.LADDERS
        for k, network in enumerate(("pcp", "completed_pcp"))
        for value in ladder.values
    ]


def swept(nu):
    row = {"status": "ok"}
    return [
        row
        | {
            "material.nu": value,
            "network.calibration": model,
            "displacement_error_l2": 0.01 * (k + 1) * float(value),
        }
        for k, model in enumerate(MODELS)
        for value in nu
    ]


ERRORS = {name: (0.3 / 4**k, 0.9 / 4**k) for k, name in enumerate(MODELS)}
SECONDS = {
    name: {"start-up": 0.1, "mesh": 0.3, "setup": 0.01, "assemble": 0.1, "solve": 0.2, "output": 0.4}
    for name in (REFERENCE, *MODELS)
}
SPREAD = {name: np.geomspace(0.05, 20 * (k + 1), 200) for k, name in enumerate(MODELS)}
LABELS = {name: f"springs, {name}" for name in MODELS}
PANELS = [plots.Panel("volume change (%)", 100, curves(9)), plots.Panel("area change (%)", 100, curves(200))]

PLOTS = {
    "scale of errors": lambda: error_scale.scale_svg(),
    "one curve": lambda: plots.plot_curves(PANELS[:1], "time (s)").svg(),
    "two curves": lambda: plots.plot_curves(PANELS, "load factor (1)").svg(),
    "errors": lambda: plots.plot_errors(ERRORS, 0.004).svg(),
    "one error": lambda: plots.plot_errors({"affine": (0.2, 0.21)}, None).svg(),
    "equal errors": lambda: plots.plot_errors(dict.fromkeys(MODELS, (1e-05, 1.0001e-05)), 1e-5).svg(),
    "errors over the surface": lambda: plots.plot_errors_over_surface(SPREAD, np.ones(200), LABELS),
    "seconds": lambda: plots.plot_times(SECONDS).svg(),
    "all in one figure": lambda: plots.figure_of(
        {
            "Change of volume and area, and below the difference.": plots.plot_curves(PANELS, "time (s)"),
            "Displacement error of every model, filled, and its largest at a vertex, hollow.": plots.plot_errors(ERRORS, 0.004),
            "Wall-clock time by stage.": plots.plot_times(SECONDS),
        }
    ),
    "race of statics": lambda: fronts.plot(race("bar_sag", (1,))),
    "race of motion": lambda: fronts.plot(race("bar_swing", (0.5, 1, 2))),
    "race of one rung": lambda: fronts.plot(SimpleNamespace(measurements=race("bar_sag", (1,)).measurements[:1], name="a")),
    "growth": lambda: scaling.plot_seconds(grown((1e3, 1e4, 1e5))),
    "growth, quick": lambda: scaling.plot_seconds(grown((300, 1000))),
    "memory": lambda: scaling.plot_memory(grown((1e3, 1e4, 1e5))),
    "memory, quick": lambda: scaling.plot_memory(grown((300, 1000))),
    "lemma 1": lambda: scaling.plot_lemma(grown((1e3, 1e4, 1e5))),
    "lemma 1, quick": lambda: scaling.plot_lemma(grown((300, 1000))),
    "cost": lambda: cost.plot(costs()),
    "stability": lambda: stability.plot(starts(("explicit_euler", "implicit_euler", "minimising_euler", "minimising_newmark"))),
    "stability, quick": lambda: stability.plot(starts(("explicit_euler",))),
    "accuracy": lambda: accuracy.plot_ratios(published(2000)),
    "accuracy, quick": lambda: accuracy.plot_ratios(published(30)),
    "accuracy, nothing": lambda: accuracy.plot_ratios([]),
    "networks": lambda: network_curves.section(on_networks(3)).figures["network_curves"][0],
    "networks, quick": lambda: network_curves.section(on_networks(1.001)).figures["network_curves"][0],
    "figure 9": lambda: paper.figure_9(),
    "figure 10": lambda: paper.figure_10(),
    "sweep": lambda: grid.plot(["material.nu", "network.calibration"], swept(("0.25", "0.3", "0.45"))),
    "sweep of one value": lambda: grid.plot(["material.nu", "network.calibration"], swept(("0.25",))),
}  # fmt: skip


@pytest.mark.parametrize("name", PLOTS)
def test_texts_and_legends_cover_nothing(name, drawn):
    for module in (
        accuracy,
        cost,
        error_scale,
        fronts,
        grid,
        network_curves,
        paper,
        plots,
        scaling,
        stability,
    ):
        drawn(module)
    assert overlaps(PLOTS[name]()) == []


def test_what_covers_something_is_found():
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], label="diagonal")
    axes.legend(loc="center")
    axes.text(0.1, 0.8, "below")
    axes.text(0.12, 0.8, "above")
    assert overlaps(figure) == ["'below' and 'above'", "legend and 'diagonal'"]
