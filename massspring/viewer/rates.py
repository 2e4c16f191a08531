"""Steps and pictures a second of previews that go as fast as they can: the paper's models, and a thousand nodes.

    python -m massspring.viewer.rates [SECONDS]

Each is stepped for so long (default: 10) without a window, then with one. It needs a display, and an idle machine.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from analysis.drawing.window import check_display
from analysis.paths import SCENES
from analysis.report import text_table
from analysis.runs import RunError
from massspring.viewer.engine import Engine
from massspring.viewer.preview import Preview, tell

_HEAD = [
    "scene",
    "model",
    "nodes",
    "integrator",
    "step (ms)",
    "steps/s",
    "with drawing",
    "frames/s",
    "of real time",
    "window",
]
_PAPERS = ("torus_implodes", "handle_folds", "head_crushes", "ball_deflates")
_THOUSAND = ("torus_hang", [
    "network.calibration=node_averaged", "material.E=1e5", "material.rho=100", "material.law=neo_hookean",
    "time.mode=dynamic", "time.end=10", "time.step=0.01", "surface.n_vertices=720",
])  # fmt: skip
_SCHEMES = {"implicit_euler": [], "symplectic_euler": ["time.step=0"]}  # explicit: half of the stable step


@dataclass(frozen=True)
class Case:
    """A scene as a scheme steps it."""

    scene: Path
    overrides: list[str]
    scheme: str


def cases() -> list[Case]:
    scenes = [(name, list[str]()) for name in _PAPERS] + [_THOUSAND]
    return [
        Case(SCENES / f"{name}.toml", [*overrides, *step, f"time.integrator={scheme}"], scheme)
        for name, overrides in scenes
        for scheme, step in _SCHEMES.items()
    ]


class Watch:
    """Steps of an engine from now on. A scene that ends begins anew."""

    def __init__(self, engine: Engine, seconds: float) -> None:
        self.engine, self.seconds, self.start = engine, seconds, time.perf_counter()
        self._now, self._n_before, self._time_before = engine.latest.head, 0, 0.0
        engine.say("speed 1e9")
        engine.say("run")

    def is_over(self) -> bool:
        before, self._now = self._now, self.engine.latest.head
        if self._now["n_steps"] < before["n_steps"]:
            self._n_before += before["n_steps"]
            self._time_before += before["time"]
        elif self._now["has_ended"] and not before["has_ended"]:
            self.engine.say("reset")
        return time.perf_counter() - self.start > self.seconds

    def rates(self) -> tuple[float, float]:
        """Steps, and seconds of the scene, for each second."""
        passed = time.perf_counter() - self.start
        n_steps = self._n_before + self._now["n_steps"]
        return n_steps / passed, (self._time_before + self._now["time"]) / passed


def row_of(case: Case, seconds: float) -> list[str]:
    """Raises RunError where the scene is refused."""
    alone = Engine(case.scene, case.overrides)
    watch = Watch(alone, seconds)
    while not watch.is_over():
        time.sleep(1 / 30)  # as seldom as a picture is drawn
    steps, _ = watch.rates()
    alone.end()
    preview = Preview(case.scene, case.overrides)
    preview.window.open()
    preview.draw(0)
    preview.window.fit()
    width, height = preview.window.plotter.window_size
    preview.window.plotter.render()  # the first picture takes longer
    watch = Watch(preview.engine, seconds)
    n_frames = 0

    def draw(passed: float) -> None:
        nonlocal n_frames
        preview.draw(passed)
        n_frames += 1
        if watch.is_over():
            preview.window.close()

    preview.window.loop(draw)
    passed = time.perf_counter() - watch.start
    drawn, factor = watch.rates()
    step = preview.engine.latest.head["step"]
    preview.engine.end()
    return [
        case.scene.stem, preview.scene["network"]["calibration"], str(len(alone.latest.body.X)), case.scheme, f"{1e3 * step:.2g}",
        f"{steps:.3g}", f"{drawn:.3g}", f"{n_frames / passed:.3g}", f"{factor:.2g}", f"{width}x{height}",
    ]  # fmt: skip


def main(seconds: float) -> int:
    try:
        check_display("xvfb-run draws on a virtual one")
        print(text_table(_HEAD, [row_of(case, seconds) for case in cases()]))
    except RunError as error:
        return 1 if error.is_told else tell(error)
    return 0


if __name__ == "__main__":
    if len(sys.argv) > 2:
        sys.exit(__doc__)
    sys.exit(main(*map(float, sys.argv[1:] or ["10"])))
