"""What a comparison leaves in its experiment's folder: pictures, report.html and, last of all, comparison.json."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from .comparison import Comparison, compare, without_nan
from .comparison_figures import draw_films, draw_row, plot
from .experiment_folder import Experiment
from .machine import describe
from .methods import label_of
from .outputs import are_as_written, list_of
from .paths import PACKAGE, PROGRAMS, write_text
from .progress import reminders, say
from .remesh import sentence_of
from .report import render
from .verdict import conclusion, finding

_SHOWN = {".html", ".gif", ".jpg", ".png"}  # a run's own folder holds none of these


def fingerprint(experiment: Experiment) -> str:
    """Hash of all that the comparison depends on: the solvers' records and this package."""
    digest = hashlib.sha256()
    records = sorted(experiment.folder.glob("**/run.json"))
    for file in [*records, experiment.folder / "scene.toml", *sorted(PACKAGE.rglob("*.py"))]:
        digest.update(file.read_bytes())
    of_runs = [experiment.n_refinements, experiment.unrefined, experiment.has_half_step, experiment.command]
    digest.update(json.dumps([experiment.failed, experiment.notes, *of_runs], sort_keys=True).encode())
    return digest.hexdigest()[:16]


def results_of(experiment: Experiment, is_quiet: bool = True) -> dict[str, Any]:
    """What comparison.json holds. All is written anew where a run has changed, or a file that it lists is not as written.

    Raises RunError as write_results.
    """
    try:
        comparison = json.loads((experiment.folder / "comparison.json").read_text())
        is_whole = are_as_written(experiment.folder, comparison["outputs"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # none, or a damaged one
        is_whole = False
    if is_whole and comparison["fingerprint"] == fingerprint(experiment):
        return comparison
    say("comparing and drawing", is_quiet)
    with reminders("comparing and drawing", is_quiet):
        return write_results(experiment)


def write_results(experiment: Experiment) -> dict[str, Any]:
    """Compares all runs of the experiment and writes what was found; returns what comparison.json holds.

    Raises RunError as comparison.compare does.
    """
    comparison = compare(experiment)
    values = comparison.as_json()
    values |= {
        "finding": finding(values),
        "conclusion": conclusion(values),
        "fingerprint": fingerprint(experiment),
    }
    if note := sentence_of(experiment.scene, experiment.folder):
        values["notes"].append(note)
    row = draw_row(comparison)
    plots = {caption: of.svg() for caption, of in plot(comparison).items()}
    report = render(values, row, plots, draw_films(comparison), _protocol(comparison))
    write_text(experiment.folder / "report.html", report)
    files = [file for file in experiment.folder.rglob("*") if file.suffix in _SHOWN]
    values["outputs"] = list_of(
        experiment.folder, sorted(file.relative_to(experiment.folder).as_posix() for file in files)
    )
    write_text(experiment.folder / "comparison.json", json.dumps(without_nan(values), indent=2) + "\n")
    return values


def _protocol(comparison: Comparison) -> dict[str, str]:
    """Name -> text of all that is needed to repeat the comparison."""
    experiment = comparison.experiment
    files = {
        f"{label_of(name)}: run.json": run.folder / "run.json" for name, run in comparison.methods.items()
    }
    for n, folder in enumerate(experiment.reference_folders[1:], 1):
        files[f"finite elements, refined {n} times for their error: run.json"] = folder / "run.json"
    return {
        "scene.toml, with every default filled in: running it reproduces this": (
            experiment.folder / "scene.toml"
        ).read_text(),
        **{name: file.read_text() for name, file in files.items() if file.exists()},
        "programs, libraries and machine": json.dumps(describe(PROGRAMS), indent=2),
    }
