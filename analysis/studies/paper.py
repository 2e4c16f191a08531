"""The paper's table 1 and figures 7, 9, 10 and 11 rebuilt beside its values.

Table 1: frames a second of one core, measured by bench_step on bodies of the paper's counts of nodes (its own meshes are not
known), median of interleaved repetitions. The paper's are those of the machine of its day. Figure 11: the scenes FIGURE_11,
the method as published beside ours, and finite elements [strips]. Every claim of the paper with a verdict: analysis/CLAIMS.md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure

from ..drawing.film import draw_strip
from ..drawing.network_pictures import draw_before_and_after
from ..drawing.style import style_of, svg_of
from ..methods import FEM_P2
from ..paths import PROGRAMS, SCENES, write_text
from ..report import Table
from ..run_store import RunRequest, Store
from ..runs import RunError, load_run
from ..time_warp import WARPS, warp_of
from . import network_curves, strips
from .claims import EXPLICIT, IMPLICIT, N_SEEDS, Seeds
from .claims import measure as measure_claims
from .published import figure_11 as published_figure_11
from .result import Figures, Result, Section, alone

# Object: vertices, springs, Euler FPS, IDE FPS, as printed in table 1.
PUBLISHED = {
    "ball": (662, 3535, 33.25, 1.42),
    "torus": (1424, 9542, 12.51, 0.50),
    "handle": (1432, 6837, 16.62, 0.66),
    "head": (4397, 24808, 5.14, 0.23),
}
#: Of strips.METHODS; quadratic elements take hours.
_NOT_IN_PAIRS = (FEM_P2, "edge_coupled", "uniform")
FIGURE_11 = ("torus_implodes", "handle_folds", "head_crushes", "ball_deflates")  # a to d
_CUSTOM = [
    [0.0, 0.0],
    [0.3, 0.1],
    [0.6, 0.8],
    [1.0, 1.0],
]  # figure 10d: in, fast, out; the paper's own is drawn by hand
_OF_PAPER = ", the paper"  # beside what is measured
#: Integrator -> its name in the table, and the column of PUBLISHED that it stands beside.
_SCHEMES: dict[str, tuple[str, int | None]] = {
    "explicit_euler": (EXPLICIT, 2),
    "symplectic_euler": ("symplectic Euler", None),
    "implicit_euler": (IMPLICIT, 3),
    "minimising_euler": ("minimising Euler", None),
}


def benchmark(program: Path, folder: Path, repetitions: int) -> list[dict[str, float | str]]:
    """Rows of a Google benchmark's repetitions; those that were measured with this program are kept.

    Raises RunError when the program fails.
    """
    digest = hashlib.sha256(program.read_bytes()).hexdigest()[:16]
    file = folder / f"{program.name}-{digest}-{repetitions}.json"
    if not file.exists():
        command = [str(program), "--benchmark_format=json", f"--benchmark_repetitions={repetitions}"]
        command += [
            f"--benchmark_filter=^({'|'.join(PUBLISHED)})/({'|'.join(_SCHEMES)})/soft",
            "--benchmark_enable_random_interleaving=true",
        ]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise RunError(f"{program}: {result.stderr.strip()}")
        folder.mkdir(parents=True, exist_ok=True)
        write_text(file, result.stdout)
    rows = json.loads(file.read_text())["benchmarks"]
    return [row for row in rows if row["run_type"] == "iteration"]


def _rounded(value: float) -> str:
    """Four digits, without a power of ten."""
    return f"{float(f'{value:.4g}'):g}"


def table_1(rows: list[dict[str, float | str]]) -> Table:
    """Frames a second, and their spread, beside those that are published."""
    head = ["", "nodes", "springs", f"springs{_OF_PAPER}"]
    for name, column in _SCHEMES.values():
        head += [name, f"{name}, spread", *([f"{name}{_OF_PAPER}"] if column else [])]
    return head, [_row(shape, rows) for shape in PUBLISHED]


def _row(shape: str, rows: list[dict[str, float | str]]) -> list[str]:
    published = PUBLISHED[shape]
    sizes, cells = ["-", "-"], []
    for scheme, (_, column) in _SCHEMES.items():
        found = [row for row in rows if str(row["run_name"]).split("/repeats")[0] == f"{shape}/{scheme}/soft"]
        rates = [float(row["FPS"]) for row in found if "FPS" in row and not row.get("error_occurred")]
        if rates:
            sizes = [f"{found[0]['nodes']:.0f}", f"{found[0]['springs']:.0f}"]
            cells += [_rounded(median(rates)), f"{_rounded(min(rates))} to {_rounded(max(rates))}"]
        else:
            cells += ["-", "-"]
        if column:
            cells.append(f"{published[column]:.2f}")
    return [shape, *sizes, str(published[1]), *cells]


def finding(table: Table) -> str:
    """How many times the paper's frames a second."""
    head, body = table
    euler, implicit = head.index(EXPLICIT), head.index(IMPLICIT)
    known = [row for row in body if "-" not in (row[euler], row[implicit])]
    if not known:
        return "No frame rate could be measured."
    ratios = [sorted(float(row[k]) / float(row[k + 2]) for row in known) for k in (euler, implicit)]
    furthest = max(abs(int(row[2]) / int(row[3]) - 1) for row in known)
    return (
        f"One core of today steps the paper's models {ratios[0][0]:.0f} to {ratios[0][-1]:.0f} times as often in a second as its "
        f"table 1 by Euler's method, {ratios[1][0]:.0f} to {ratios[1][-1]:.0f} times implicitly. Spring counts differ by "
        f"{furthest:.1%} at the most. Machine and program cannot be told apart, as the paper names no machine."
    )


def figure_9() -> str:
    """Factor on a rest length in a step over the distance from the pivot, for coefficients R [paper eq. 8, per step]."""
    figure = Figure(figsize=(5, 3.2))
    axes = figure.subplots()
    distance = np.linspace(0, 5, 200)
    for number, R in enumerate((0.1, 0.3, 0.5, 0.9)):
        axes.plot(distance, 1 - R / (1 + distance), color=style_of("", number).colour, label=f"R = {R}")
    axes.set_xlabel("distance of pivot and spring (smallest side of the body)")
    axes.set_ylabel("rest length after over before (1)")
    axes.legend(fontsize=8)
    return svg_of(figure)


def figure_10() -> str:
    """Time warps, and how much of the simulation each shows in a moment of the film [paper fig. 10: dt(t)]."""
    figure = Figure(figsize=(8, 3.2))
    time, speed = figure.subplots(1, 2)
    t = np.linspace(0, 1, 200)
    warps = WARPS | {"custom": warp_of("custom", points=_CUSTOM)}
    for number, (name, warp) in enumerate(warps.items()):
        look = {"color": style_of("", number).colour, "label": name}
        time.plot(t, warp(t), **look)
        speed.plot((t[1:] + t[:-1]) / 2, np.diff(warp(t)) / np.diff(t), **look)
    time.set_ylabel("share of the simulation shown (1)")
    speed.set_ylabel("dt: simulation per film (1)")
    for axis in (time, speed):
        axis.set_xlabel("t: share of the film (1)")
    time.legend(fontsize=8)
    return svg_of(figure)


def figure_7(folder: Path) -> Path:
    """The ball before and after PCP."""
    surface, network, picture = folder / "ball.obj", folder / "ball.vtu", folder / "figure_7.png"
    folder.mkdir(parents=True, exist_ok=True)
    for words in (
        ["shape", "ball", surface, "--vertices", "162"],
        ["network", surface, network, "--nodes", "500", "--phi", "0.05", "--psi", "0.05"],
    ):
        subprocess.run([str(PROGRAMS / "meshing"), *map(str, words)], check=True, stdout=subprocess.DEVNULL)
    draw_before_and_after(network, picture)
    return picture


def figure_11(scenes: list[Path], store: Store, folder: Path) -> tuple[dict[str, Path], Table]:
    """Strips of the scenes' frames, and how each run ended."""
    strips: dict[str, Path] = {}
    rows = []
    for scene in scenes:
        outcome = store.run(RunRequest("massspring", scene))
        message = outcome.message
        if outcome.status == "ok":
            try:
                run = load_run(outcome.folder)
                strips[scene.stem] = folder / f"{scene.stem}.png"
                draw_strip(strips[scene.stem], {run.record["calibration"]: run})
                kinetic = run.curves["kinetic_energy"]
                message = (
                    f"kinetic energy at the end {kinetic[-1] / max(kinetic.max(), 1e-300):.2g} of its largest"
                )
            except RunError as error:
                del strips[scene.stem]
                message = str(error)
        seconds = outcome.record.get("seconds", {}).get("solve")
        rows.append([scene.stem, outcome.status, f"{seconds:.2f}" if seconds is not None else "-", message])
    return strips, (["scene", "status", "solve (s)", ""], rows)


def study(arguments: argparse.Namespace, folder: Path) -> Result:
    """Table 1 and the figures."""
    repetitions = arguments.repetitions or (2 if arguments.quick else 5)
    with alone(arguments.quiet):
        table = table_1(benchmark(PROGRAMS / "bench_step", folder, repetitions))
    figures: Figures = {
        "figure_7": (figure_7(folder), "Figure 7: the ball before and after PCP."),
        "figure_9": (
            figure_9(),
            "Figure 9: how far a spring collapses in a step, over its distance from the pivot.",
        ),
        "figure_10": (
            figure_10(),
            "Figure 10: time warps: the simulation's time, and its speed, over the film's.",
        ),
    }
    scenes = arguments.scenes or [SCENES / f"{name}.toml" for name in FIGURE_11]
    pictures, ended = figure_11(scenes, Store(folder / "runs"), folder)
    sections = [Section("Table 1", [], {}, {"table_1": table}), Section("Figures", [], figures)]
    shown: Figures = {name: (file, f"Figure 11: {name}.") for name, file in pictures.items()}
    sections.append(Section("Figure 11", [], shown, {"figure_11": ended}))
    pictures, ended = published_figure_11(scenes, Store(folder / "runs"), folder)
    shown = {
        f"{name}_published": (file, f"Figure 11: {name}, ours above the method as published.")
        for name, file in pictures.items()
    }
    sections.append(Section("Figure 11 as published", [], shown, {"published": ended}))
    tables, pairs = strips.compare(
        scenes, Store(folder / "runs"), folder, without=_NOT_IN_PAIRS, is_quiet=arguments.quiet
    )
    sections.append(Section("Figure 11 in pairs", [strips.HOW], {}, {"pairs": tables["strips"]}))
    sections += pairs
    seeds = Seeds(Store(folder / "runs"), 2 if arguments.quick else N_SEEDS)
    sections.append(network_curves.section(network_curves.measure(seeds)))
    sections.append(Section("Claims", [], {}, {"claims": measure_claims(seeds)}))
    return Result("The paper's results, rebuilt", finding(table), sections)
