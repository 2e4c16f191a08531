"""A paired experiment: both solvers on one scene, then comparison.json and report.html."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import subprocess
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .compare import (
    compare_runs,
    describe_alone,
    describe_reference,
    displacement_at,
    is_dynamic,
    volume_change,
    widest,
)
from .film import draw_film, draw_strip
from .machine import describe
from .pictures import draw_comparison
from .plots import plot_errors, plot_times, plot_volume
from .report import render
from .runs import Frame, Run, RunError, load_run
from .style import REFERENCE, label_of
from .warp import draw_playback

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ROOT / "build" / "bin"
SOLVED, NOT_OK, _NOT_MODELLED = 0, 2, 3  # exit statuses of both programs: meshing/exit_status.h
_GROWTH = 8  # of the unknowns by a refinement
# Unknowns of a refined reference, by what is solved: half a minute at most. And steps of a motion in time.
_MAX_DOFS = {"linear": 500_000, "newton": 250_000, "dynamic": 100_000, "newton in time": 20_000}
_MAX_STEPS = 500


@dataclass(frozen=True)
class Experiment:
    """A finished pair of solver runs, side by side in one folder."""

    folder: Path
    scene: dict[str, Any]  #: filled in, as the solvers read it
    failed: dict[str, str]  #: spring models that gave no result, and why
    unsolved: str = ""  #: the part of the scene that the reference does not model; "": it solved the scene

    @property
    def name(self) -> str:
        return self.scene["name"]

    @property
    def surface(self) -> str:
        """Name of the surface's file or shape."""
        return Path(self.scene["surface"].get("file", "")).name or self.scene["surface"]["shape"]

    @property
    def calibration(self) -> str:
        return self.scene["network"]["calibration"]

    @property
    def calibrations(self) -> list[str]:
        """Every spring model of the comparison, the scene's own first."""
        return list(dict.fromkeys([self.calibration, *self.scene["comparison"]["calibrations"]]))

    @property
    def is_free(self) -> bool:
        return not self.scene.get("supports")

    def massspring_folder(self, calibration: str) -> Path:
        return self.folder / "massspring" / calibration

    @property
    def reference_folder(self) -> Path:
        return self.folder / "fem_reference"


def outcome_of(record: dict[str, Any]) -> str:
    """How a run ended, by its record: the status and, where there is one, the reason."""
    return ", ".join(part for part in (record["status"], record.get("reason")) if part)


def default_folder(scene: Path, surface: Path | None) -> Path:
    """out/NAME, or out/NAME-SURFACE where a surface is given, NAME being the scene's."""
    name = scene.stem
    try:
        name = tomllib.loads(scene.read_text()).get("name", name)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        pass  # the solver says what is wrong with it
    return ROOT / "out" / (f"{name}-{surface.stem}" if surface else name)


def refinement(scene: dict[str, Any], record: dict[str, Any]) -> list[str] | None:
    """Words of the command that solves a reference again for its error; None where that takes more than half a minute.

    Linear statics are refined and extrapolated by the program; others are refined, motions in half their step, too.
    """
    refined = ["--set", f"reference.refine={scene['reference']['refine'] + 1}"]
    if scene["time"]["mode"] == "dynamic":
        kind = "dynamic" if scene["reference"]["law"] == "small_strain" else "newton in time"
        steps = [
            f"time.step={record['step'] / 2!r}",
            f"output.frames_every={2 * scene['output']['frames_every']}",
        ]
        words = [*refined, *(word for step in steps for word in ("--set", step))]
    elif scene["reference"]["law"] == "small_strain":
        kind, words = "linear", ["--set", "output.frames_every=0", "--converge", "2"]
    else:
        kind, words = "newton", [*refined, "--set", "output.frames_every=0"]
    fits = _GROWTH * record["n_dofs"] <= _MAX_DOFS[kind] and record.get("n_steps", 0) <= _MAX_STEPS
    return words if fits else None


def run_solvers(
    scene_file: Path, folder: Path, surface: Path | None, overrides: list[str], is_quiet: bool
) -> Experiment:
    """Checks the scene, then runs the reference and every spring model; each skips itself where its last result still holds.

    Where the scene has a part that the reference does not model, the springs run alone. Raises RunError when a spring
    model refuses the scene, and when the reference fails or does not converge.
    """
    if surface:
        overrides = [*overrides, 'surface.shape=""', f"surface.file={surface.resolve()}"]

    def run(program: str, out: Path, *more: str, options: Sequence[str] = ()) -> int:
        command = [str(PROGRAMS / program), str(scene_file), "--out", str(out), *options]
        for override in [*overrides, *more]:
            command += ["--set", override]
        return subprocess.run(command + ["--quiet"] * is_quiet, check=False).returncode

    if run("massspring", folder, options=["--check"]) != SOLVED:
        raise RunError("massspring refuses the scene: nothing has been solved")
    status = run("fem_reference", folder / "fem_reference")
    if status not in (SOLVED, NOT_OK, _NOT_MODELLED):
        raise RunError(f"fem_reference gave no result (exit status {status})")
    shutil.copyfile(folder / "fem_reference" / "scene.toml", folder / "scene.toml")
    scene = tomllib.loads((folder / "scene.toml").read_text())
    refined = folder / "reference_refined"
    record = json.loads((folder / "fem_reference" / "run.json").read_text())
    if status == NOT_OK:
        raise RunError(
            f"fem_reference did not converge: {outcome_of(record)}, see {folder / 'fem_reference'}"
        )
    unsolved = record["reason"] if status == _NOT_MODELLED else ""
    words = None if unsolved else refinement(scene, record)
    if not words or run("fem_reference", refined, options=words) not in (SOLVED, NOT_OK):
        shutil.rmtree(refined, ignore_errors=True)  # it may be of other values

    experiment = Experiment(folder, scene, {}, unsolved)
    for calibration in experiment.calibrations:
        out = experiment.massspring_folder(calibration)
        status = run("massspring", out, f"network.calibration={calibration}", options=["--checked"])
        outcome = f"exit status {status}"
        if status in (SOLVED, NOT_OK):
            outcome = outcome_of(json.loads((out / "run.json").read_text()))
        if outcome != "ok":
            experiment.failed[calibration] = outcome
    return experiment


def fingerprint(experiment: Experiment) -> str:
    """Hash of all that the comparison depends on: the solvers' records and this package."""
    digest = hashlib.sha256()
    records = sorted(experiment.folder.glob("**/run.json"))
    for file in [*records, experiment.folder / "scene.toml", *sorted(Path(__file__).parent.glob("*.py"))]:
        digest.update(file.read_bytes())
    digest.update(json.dumps(experiment.failed, sort_keys=True).encode())
    return digest.hexdigest()[:16]


def write_text(file: Path, text: str) -> None:
    """Writes to a temporary name, then renames."""
    temporary = file.with_name(file.name + ".tmp")
    temporary.write_text(text)
    temporary.replace(file)


def compare(experiment: Experiment) -> dict[str, Any]:
    """Compares all runs of the experiment, writes report.html and, last of all, comparison.json."""
    reference = None if experiment.unsolved else load_run(experiment.reference_folder)
    models: dict[str, dict[str, Any]] = {}
    runs = {}
    for name in experiment.calibrations:
        if name in experiment.failed:
            models[name] = {"status": experiment.failed[name]}
            continue
        run = runs[name] = load_run(experiment.massspring_folder(name))
        models[name] = compare_runs(run, reference, experiment.is_free) if reference else describe_alone(run)

    main = models[experiment.calibration]
    comparison = {
        "scene": experiment.name,
        "surface": experiment.surface,
        "status": main["status"],
        "calibration": experiment.calibration,
    }
    if reference:
        described = describe_reference(reference)
        described["estimated_error_l2"] = _estimated_error(experiment, reference)
        figures = ["displacement_error_l2", "displacement_error_max", "volume_change_error"]
        comparison |= {
            "rigid_motion_removed": experiment.is_free,
            **{key: main.get(key) for key in [*figures, "n_nodes", "n_springs"]},
            "n_dofs_reference": described["n_dofs"],
            "seconds": {"massspring": main.get("seconds"), "fem_reference": described["seconds"]},
            "reference": described,
        }
    else:
        comparison["no_reference"] = experiment.unsolved
    comparison |= {"models": models, "fingerprint": fingerprint(experiment)}

    pictures = {}
    if reference:
        for name, run in runs.items():
            file = experiment.folder / f"error_{name}.png"
            time = reference.times[widest(reference) if is_dynamic(reference) else -1]
            here, there = (Frame(r.last.X, displacement_at(r, time), r.last.F) for r in (run, reference))
            draw_comparison(file, here, there, experiment.is_free, label_of(name))
            moment = f" at {time:.3g} s" if is_dynamic(reference) else ""
            pictures[f"Deformed surfaces and the error of the {name} springs{moment}."] = file
    is_static = experiment.scene["time"]["mode"] == "static"
    methods = ({REFERENCE: reference} if reference else {}) | runs
    shown = {name: methods[name] for name in (experiment.calibration, REFERENCE) if name in methods}
    if shown and not is_static and min(len(run.times) for run in shown.values()) > 1:
        draw_strip(experiment.folder / "strip.png", shown)
        draw_film(experiment.folder / "film.gif", shown)
        pictures["Frames in time."] = experiment.folder / "strip.png"
        pictures["The motion, and the volume."] = experiment.folder / "film.gif"
    playback = experiment.scene.get("playback", {})
    if shown and playback.get("warp"):
        draw_playback(experiment.folder / "playback", shown[experiment.calibration], playback)
        pictures[
            f"Played {'backwards' if playback['reversed'] else 'again'}, time warp {playback['warp']}."
        ] = experiment.folder / "playback" / "film.gif"
    volumes = plot_volume(
        {name: volume_change(run) for name, run in methods.items()},
        "load factor (1)" if is_static else "time (s)",
    )
    plots = {}
    if reference:
        plots["Volume over the load, and the difference from the finite elements."] = volumes
        plots["Displacement error of every model; grey: the reference's own, estimated."] = plot_errors(
            {
                name: model["displacement_error_l2"]
                for name, model in models.items()
                if model["status"] == "ok"
            },
            described["estimated_error_l2"],
        )
    else:
        plots["Volume."] = volumes
    seconds = {name: run.record["seconds"] for name, run in methods.items()}
    plots["Wall-clock time by stage."] = plot_times(seconds)
    files = {f"{label_of(name)}: run.json": run.folder / "run.json" for name, run in methods.items()}
    files["finite elements, refined for their error: run.json"] = (
        experiment.folder / "reference_refined" / "run.json"
    )
    protocol = {
        "scene.toml, with every default filled in: running it reproduces this": (
            experiment.folder / "scene.toml"
        ).read_text(),
        **{name: file.read_text() for name, file in files.items() if file.exists()},
        "programs, libraries and machine": json.dumps(describe(PROGRAMS), indent=2),
    }
    write_text(experiment.folder / "report.html", render(comparison, plots, pictures, protocol))
    write_text(experiment.folder / "comparison.json", json.dumps(_without_nan(comparison), indent=2) + "\n")
    return comparison


def _estimated_error(experiment: Experiment, reference: Run) -> float | None:
    """Of the reference, relative as the displacement error; None where no refinement gave one."""
    folder = experiment.folder / "reference_refined"
    if not (folder / "run.json").exists():
        return None
    try:
        refined = load_run(folder)
        if "convergence" in refined.record:
            return refined.record["convergence"].get("estimated_error_l2")
        # As if of first order: the refined run errs by half as much.
        return 2 * compare_runs(reference, refined, experiment.is_free)["displacement_error_l2"]
    except RunError:  # what the coarse mesh carries the fine one may not
        return None


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: null stands for a figure that does not exist."""
    if isinstance(value, dict):
        return {key: _without_nan(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
