"""A ladder of hard values, one factor at a time, for both programs: each outcome has a class, and what is right is known.

python -m tests.stability.stress prints every outcome; with a word, those of rungs whose names hold it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.compare import volume
from analysis.paths import PROGRAMS
from analysis.runs import NOT_MODELLED, NOT_OK, REFUSED, SOLVED, Run, load_frames, record_of

BUDGET = 20  #: s of each run
_PATIENCE = 15  # times the budget, after which a run hangs, however busy the machine is
BOTH = ("massspring", "fem_reference")
_GRAVITY = 9.81  # m/s2
_ROUNDING = 1e-15  # m, of positions of half a metre, over ten steps
_STEPS = 1e-5  # of the way fallen: each of ten steps may err by a billionth of the body

_BALL = """
[surface]
shape = "ball"
n_vertices = 60
size = [1, 1, 1] # m
"""

_PRESSED = (
    _BALL
    + """
[[loads]]
pressure = 1e-3

[material]
law = "small_strain"
E = 1
nu = 0.25

[time]
load_steps = 1
"""
)

_FALLS = (
    f"gravity = [0, -{_GRAVITY}, 0] # m/s2\n"
    + _BALL
    + """
[material]
E = 1e5
rho = 1000

[time]
mode = "dynamic"
step = 0.01
end = 0.1
integrator = "minimising_euler"

[reference]
degree = 1
integrator = "minimising_euler"

[output]
frames_every = 0
"""
)


@dataclass(frozen=True)
class Rung:
    """A scene with values of one factor, and how far a run that is ok is from what is right, over that; 0: unknown."""

    name: str
    scene: str
    overrides: tuple[str, ...]
    error: Callable[[Run], float]
    tolerance: float
    is_quick: bool = False


@dataclass(frozen=True)
class Outcome:
    """kind: ok, a status of run.json, refused, not_modelled; or what must not be: silent, crash, hang."""

    kind: str
    said: str


def _volume_change(expected: float) -> Callable[[Run], float]:
    def error(run: Run) -> float:
        X, F, u = run.last.X, run.last.F, run.last.u
        # Of displacements, whose digits positions far away do not hold.
        change = np.linalg.norm(u, axis=1).sum() / np.linalg.norm(X - X.mean(axis=0), axis=1).sum()
        sign = np.sign(volume(X + 1e3 * u, F) - volume(X, F))
        return float(abs(3 * sign * change / expected - 1))

    return error


def _fallen(step: float, n: int) -> Callable[[Run], float]:
    """By implicit Euler, whatever the body is made of."""

    def error(run: Run) -> float:
        expected = -_GRAVITY * step**2 * n * (n + 1) / 2
        apart = np.abs(run.last.u - [0, expected, 0]).max()
        return float(max(0, apart - _ROUNDING) / abs(expected))

    return error


def _gained(run: Run) -> float:
    """Largest growth of energy beyond what was put in, over the largest energy, by the columns of curves.csv."""
    curves = run.curves
    stored = sum(value for name, value in curves.items() if name.endswith("_energy"))
    put_in = sum(value for name, value in curves.items() if name.startswith("work_"))
    balance = (stored - put_in)[1:]  # what touches at first has an energy after the first step
    grown = (balance - np.minimum.accumulate(balance)).max()
    return float(grown / max(np.abs(stored).max(), np.abs(put_in).max(), 1e-300))


def rungs() -> Iterator[Rung]:
    """Every rung of the ladder."""
    for exponent in range(0, 16, 3):
        E = 10.0**exponent
        words = (f"material.E={E}", f"loads.0.pressure={1e-3 * E}")
        # Of the ball p/E (1 - 2 nu), three times that of its volume.
        yield Rung(f"E {E:g}", _PRESSED, words, _volume_change(-3e-3 * 0.5), 1e-3, exponent == 15)
    for nu in (0.0, 0.3, 0.45, 0.49, 0.499):
        words = (f"material.nu={nu}",)
        yield Rung(f"nu {nu}", _PRESSED, words, _volume_change(-3e-3 * (1 - 2 * nu)), 1e-3, nu == 0.499)
    for scale in (1e-6, 1e-3, 1e3, 1e6):
        words = (f"surface.scale={scale}",)
        yield Rung(f"scale {scale:g}", _PRESSED, words, _volume_change(-1.5e-3), 1e-3, scale == 1e-6)
    for offset in (1e2, 1e4, 1e6):
        yield Rung(f"offset {offset:g}", _PRESSED, (f"OFFSET={offset}",), _volume_change(-1.5e-3), 1e-3)
    for parts in (2, 3):
        yield Rung(f"parts {parts}", _PRESSED, (f"PARTS={parts}",), _volume_change(-1.5e-3), 1e-3)
    for exponent in range(-7, 2):
        step = 10.0**exponent
        words = (f"time.step={step}", f"time.end={10 * step}")
        yield Rung(f"h {step:g}", _FALLS, words, _fallen(step, 10), _STEPS, exponent == 1)
    for rho in (1e-3, 1.0, 1e6):
        yield Rung(f"rho {rho:g}", _FALLS, (f"material.rho={rho}",), _fallen(0.01, 10), _STEPS)
    for E in (1.0, 1e10, 1e15):
        yield Rung(f"falling E {E:g}", _FALLS, (f"material.E={E}",), _fallen(0.01, 10), _STEPS, E == 1e15)
    plane = (
        "{ plane = { point = [0, HEIGHT, 0], normal = [0, 1, 0] }, friction = 0.5, initially = 'resolve' }"
    )
    for step in (1e-4, 1e-3, 1e-2, 1e-1, 1.0):
        floor = plane.replace("HEIGHT", "-0.6")
        words = (f"obstacles=[{floor}]", f"time.step={step}", f"time.end={max(20 * step, 0.3)}")
        yield Rung(f"blow h {step:g}", _FALLS, words, _gained, 0.1)
    for height in (-0.45, -0.3, 0.0):
        words = (f"obstacles=[{plane.replace('HEIGHT', str(height))}]",)
        yield Rung(f"overlap {height + 0.5:g}", _FALLS, words, _gained, 0.1, height == -0.45)
    for scheme in (
        "explicit_euler",
        "symplectic_euler",
        "rk4",
        "midpoint",
        "bdf2",
        "tr_bdf2",
        "implicit_euler",
    ):
        for step in (1e-6, 1e-3, 1e-1):
            words = (f"time.integrator={scheme}", f"time.step={step}", f"time.end={50 * step}")
            yield Rung(f"{scheme} h {step:g}", _FALLS, words, _gained, 0.1)


def _write(rung: Rung, folder: Path) -> list[str]:
    """The scene, and words that run it."""
    (folder / "scene.toml").write_text(rung.scene)
    words = [str(folder / "scene.toml"), "--quiet", "--budget", str(BUDGET)]
    for override in rung.overrides:
        key, _, value = override.partition("=")
        if key in ("OFFSET", "PARTS"):
            shifts = [float(value)] if key == "OFFSET" else [3.0 * part for part in range(int(value))]
            _write_balls(folder / "balls.off", shifts)
            words += ["--set", 'surface.shape=""', "--set", f"surface.file={folder / 'balls.off'}"]
        else:
            words += ["--set", override]
    return words


def _write_balls(file: Path, shifts: list[float]) -> None:
    """Balls of one metre, moved along x."""
    shape = [str(PROGRAMS / "meshing"), "shape", "ball", str(file), "--vertices", "60"]
    subprocess.run(shape, check=True, capture_output=True)
    words = file.read_text().split()
    n, m = int(words[1]), int(words[2])
    X = np.array(words[4 : 4 + 3 * n], dtype=float).reshape(n, 3)
    F = np.array(words[4 + 3 * n :], dtype=int).reshape(m, -1)[:, 1:4]
    X /= np.ptp(X, axis=0)
    lines = ["OFF", f"{n * len(shifts)} {m * len(shifts)} 0"]
    lines += [" ".join(repr(float(c)) for c in np.add(x, [shift, 0, 0])) for shift in shifts for x in X]
    lines += [f"3 {a} {b} {c}" for part in range(len(shifts)) for a, b, c in F + n * part]
    file.write_text("\n".join(lines) + "\n")


def outcome_of(program: str, rung: Rung, folder: Path) -> Outcome:
    """Runs a rung in an empty folder."""
    words = [str(PROGRAMS / program), *_write(rung, folder), "--out", str(folder / "out")]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=_PATIENCE * BUDGET)
    except subprocess.TimeoutExpired:
        return Outcome("hang", f"no end after {_PATIENCE * BUDGET} s")
    said = done.stderr.strip()
    if done.returncode == REFUSED and said.splitlines()[-1:] and said.splitlines()[-1].startswith("error: "):
        return Outcome("refused", said.splitlines()[-1])
    if done.returncode not in (SOLVED, NOT_OK, NOT_MODELLED):
        return Outcome("crash", f"exit status {done.returncode}: {said}")
    status = record_of(folder / "out")["status"]
    if done.returncode != SOLVED:
        return Outcome("not_modelled" if done.returncode == NOT_MODELLED else status, said)
    error = rung.error(load_frames(folder / "out"))
    is_right = error <= rung.tolerance
    return Outcome("ok" if is_right else "silent", f"error {error:.3g}, tolerated {rung.tolerance:g}")


def main() -> int:
    wanted = sys.argv[1] if len(sys.argv) > 1 else ""
    kinds: Counter[str] = Counter()
    for rung in rungs():
        if wanted not in rung.name:
            continue
        for program in BOTH:
            with tempfile.TemporaryDirectory() as folder:
                outcome = outcome_of(program, rung, Path(folder))
            kinds[outcome.kind] += 1
            print(f"{rung.name:24} {program:14} {outcome.kind:14} {outcome.said[:90]}", flush=True)
    print(", ".join(f"{n} {kind}" for kind, n in kinds.most_common()))
    return int(any(kinds[kind] for kind in ("silent", "crash", "hang")))


if __name__ == "__main__":
    sys.exit(main())
