"""Long runs hold memory flat and take time in proportion: a large surface, many steps with output at each, many runs in a row."""

import json
import os
import resource
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.paired.programs import words_of

_TICKS = os.sysconf("SC_CLK_TCK")
_LISTED, _ALLOCATED = 2e-3, 8  # MB, for a frame and in all; a frame itself has some 0.05


@dataclass
class Watched:
    """A run: resident memory of its own (MB) and its seconds of computing whenever another frame lay in its folder."""

    memory: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)

    def of_share(self, share: float) -> tuple[float, float]:
        """Memory and seconds when so many of the frames were there."""
        at = next(i for i, n in enumerate(self.frames) if n >= share * self.frames[-1])
        return self.memory[at], self.seconds[at]


def watch(words, folder: Path) -> Watched:
    """Raises AssertionError where the program does not end well."""
    watched = Watched()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        n = sum(file.name.endswith(".vtu") for file in os.scandir(folder)) if folder.exists() else 0
        stat = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        # Pages of libraries come in as their code is first reached, the last of them when the run is written.
        status = Path(f"/proc/{process.pid}/status").read_text()
        own = int(status.partition("RssAnon:")[2].split()[0]) if "RssAnon:" in status else 0  # kB
        has_memory = own > 0  # which one that has just ended has not
        if has_memory and n > (watched.frames or [0])[-1]:
            watched.memory.append(own * 1024 / 1e6)
            watched.seconds.append((int(stat[11]) + int(stat[12])) / _TICKS)
            watched.frames.append(n)
        time.sleep(0.05)
    assert process.returncode == 0
    return watched


def tell(name: str, watched: Watched) -> None:
    """Memory and seconds a frame of both halves."""
    middle, seconds = watched.of_share(0.5)
    print(
        f"{name}: {watched.frames[-1]} frames; at half of them {middle:.0f} MB and {seconds:.1f} s, "
        f"at the end {watched.memory[-1]:.0f} MB and {watched.seconds[-1]:.1f} s of computing"
    )


FALLING = """
surface.shape = "bar"
surface.size = [0.4, 0.1, 0.1]
surface.n_vertices = {n}
surface.across = 0
material.E = 1e6
gravity = [0, -9.81, 0]
[[supports]]
region = {{ box = {{ low = [0, 0, 0], high = [0, 1, 1] }}, relative = true }}
[time]
mode = "dynamic"
integrator = "{integrator}"
step = {step}
end = {end}
[output]
frames_every = 1
"""


@pytest.mark.parametrize("n_steps", [pytest.param(300, id="quick"), pytest.param(10_000, id="whole")])
@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_many_steps_with_output_at_each(program, n_steps, tmp_path):
    step = 1e-4
    scene = FALLING.format(n=60, integrator="implicit_euler", step=step, end=n_steps * step)
    watched = watch(words_of(tmp_path, program, scene), tmp_path / "out" / "frames")
    tell(program, watched)
    assert len(list((tmp_path / "out" / "frames").iterdir())) == n_steps + 1
    # Of each frame its name, size and hash are kept, which run.json lists, and a row of curves.
    start = watched.of_share(0.25)[0]
    assert watched.memory[-1] - start < _LISTED * watched.frames[-1] + _ALLOCATED, "it grows"


def test_whole_run_of_a_large_surface(tmp_path):
    """240,000 triangles."""
    scene = FALLING.format(n=120_002, integrator="symplectic_euler", step=1e-6, end=1e-4)
    words = words_of(tmp_path, "massspring", scene, ["network.calibration=uniform", "network.k=60000"])
    watched = watch(words, tmp_path / "out" / "frames")
    tell("240,000 triangles", watched)
    assert json.loads((tmp_path / "out" / "run.json").read_text())["n_surface"] > 115_000
    assert watched.memory[-1] < 1.1 * watched.of_share(0.25)[0], "it grows"


def test_whole_two_hundred_runs_in_a_row(tmp_path):
    """Of one process of the analysis."""
    from analysis.run_store import RunRequest, Store

    scene = tmp_path / "scene.toml"
    scene.write_text(FALLING.format(n=40, integrator="implicit_euler", step=1e-3, end=1e-2))
    store, memory = Store(tmp_path / "runs", 60), []
    for n in range(200):
        outcome = store.run(RunRequest("massspring", scene, (f"network.seed={n}",)))
        assert outcome.status == "ok", outcome
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        memory.append(pages * resource.getpagesize() / 1e6)
    print(f"200 runs: after 50 of them {memory[49]:.0f} MB, after all {memory[-1]:.0f} MB")
    assert memory[-1] < 1.1 * memory[49], "it grows"
