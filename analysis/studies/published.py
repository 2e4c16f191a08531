"""Figure 11 by the method as published, beside ours: the preset `paper` on the same scenes.

The scenes give depletion and relaxation in a second. As the paper has them in a step, R and R' are set so that a step of
the scene's length takes as much of a spring at the pivot. Half a step with the same R shows what hangs on the step.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..drawing.film import draw_film, draw_strip
from ..report import Table
from ..run_store import Outcome, RunRequest, Store
from ..runs import Array, Run, RunError, load_frames, read_toml
from ..time_warp import WARPS

#: Form: the integrator, and the step over the scene's.
FORMS = {
    "implicit Euler": ("implicit_euler", 1),
    "implicit Euler, half the step": ("implicit_euler", 0.5),
    "explicit Euler": ("explicit_euler", 1),
    "explicit Euler, a 20th of the step": ("explicit_euler", 0.05),
}
_OURS = "ours"
_SHOWN = tuple(FORMS)[::2]  # in strips
_FRAMES = 20  # of a film, in each direction
_FAR = 2.0  # diagonals of the body: a frame that moves farther shows nothing


def overrides_of(scene: Path, integrator: str, part: float) -> tuple[str, ...]:
    """What makes the scene the paper's, in steps of a part of its own."""
    values = read_toml(scene)
    step = values["time"]["step"]
    words = ["paper=true", f"time.integrator={integrator}", f"time.step={step * part}"]
    for key, name in (("collapse", "coefficient"), ("skin", "relaxation")):
        if name in values.get(key, {}):
            words.append(f"{key}.{name}={1 - (1 - values[key][name]) ** step:.10g}")
    return tuple(words)


def sound_part(run: Run) -> Run:
    """Its frames until one is not finite or far away."""
    size = np.linalg.norm(np.ptp(run.frame(0).X, axis=0))
    n = 0
    for number in range(len(run.times)):
        try:
            if np.linalg.norm(run.frame(number).u, axis=1).max() > _FAR * size:
                break
        except RunError:
            break
        n = number + 1
    end = run.times[n - 1] + 1e-9
    rows = run.curves["time"] <= end
    curves = {name: values[rows] for name, values in run.curves.items()}
    return Run(run.folder, run.record, curves, run.times[:n], run.files[:n])


def there_and_back(*runs: Run) -> Array:
    """Times of a film of runs that may end early: forwards, then backwards by every warp of figure 10."""
    first, last = max(run.times[0] for run in runs), min(run.times[-1] for run in runs)
    shares = np.linspace(0, 1, _FRAMES)
    parts = [shares, *(1 - warp(shares) for warp in WARPS.values())]
    return np.asarray(first + (last - first) * np.concatenate(parts))


def _row(scene: str, form: str, outcome: Outcome, run: Run | None) -> list[str]:
    record = outcome.record
    done = f"{record['n_steps_done']} of {record['n_steps']}" if "n_steps" in record else "-"
    volume = f"{run.curves['volume'][-1] / run.curves['volume'][0]:.2f}" if run else "-"
    return [scene, form, outcome.status, done, volume, str(record.get("linear_iterations", "-"))]


def _stacked(pictures: list[Path], file: Path) -> Path:
    """One picture above the other."""
    images = [Image.open(picture) for picture in pictures]
    page = Image.new("RGB", (max(i.width for i in images), sum(i.height for i in images)), "white")
    top = 0
    for image in images:
        page.paste(image, (0, top))
        top += image.height
    page.save(file, optimize=True)
    return file


def figure_11(scenes: list[Path], store: Store, folder: Path) -> tuple[dict[str, Path], Table]:
    """Strips of our method above those as published, a film of both there and back, and how each run ended."""
    strips: dict[str, Path] = {}
    rows = []
    for scene in scenes:
        shown: dict[str, Run] = {}
        for form, overrides in {
            _OURS: (),
            **{form: overrides_of(scene, *how) for form, how in FORMS.items()},
        }.items():
            outcome = store.run(RunRequest("massspring", scene, overrides, ("--no-diagnostics",)))
            run = None
            if outcome.status in ("ok", "diverged", "not_converged", "energy_gained"):
                run = sound_part(load_frames(outcome.folder))
                if len(run.times) > 1 and form in (_OURS, *_SHOWN):
                    shown[form] = run
            rows.append(_row(scene.stem, form, outcome, run))
        pictures = [folder / f"{scene.stem}_{number}.png" for number in range(len(shown))]
        for picture, (form, run) in zip(pictures, shown.items(), strict=True):
            draw_strip(picture, {form: run})
        if {_OURS, _SHOWN[0]} <= shown.keys():
            both = {form: shown[form] for form in (_OURS, _SHOWN[0])}
            times = there_and_back(*both.values())
            draw_film(folder / f"{scene.stem}_published.gif", both, seconds=8, times=times)
        if pictures:
            strips[scene.stem] = _stacked(pictures, folder / f"{scene.stem}_published.png")
    head = ["scene", "form", "status", "steps", "volume at the end", "linear iterations"]
    return strips, (head, rows)
