"""Pictures of spring networks: the ball before and after PCP (figure 7), and bodies cut open.

    python -m analysis.drawing.network_pictures build/bin/meshing out/networks [SURFACE ...]

Each SURFACE is drawn cut open beside the ball and the torus.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyvista as pv

_LINE = 3  # VTK_LINE
_TRIANGLE = 5  # VTK_TRIANGLE
_SIZE = (900, 750)  # pixels


def _parts(file: Path) -> tuple[pv.PolyData, pv.PolyData]:
    """Surface and springs of a network written by `meshing network`."""
    grid = pv.read(file)
    cells = grid.cells_dict
    surface = pv.PolyData.from_regular_faces(grid.points, cells[_TRIANGLE])
    lines = np.insert(cells[_LINE], 0, 2, axis=1).ravel()
    return surface, pv.PolyData(grid.points, lines=lines)


def draw_cut(file: Path, out: Path) -> None:
    """Half of the surface as a shell, and the springs behind the cut through the box's middle."""
    surface, springs = _parts(file)
    size = np.ptp(surface.points, axis=0)
    axis = int(np.argmin(size))
    middle = surface.center[axis]
    ends = springs.points[springs.lines.reshape(-1, 3)[:, 1:]]
    behind = (ends[:, :, axis] <= middle).all(axis=1)
    lines = springs.lines.reshape(-1, 3)[behind]
    normal = np.zeros(3)
    normal[axis] = 1
    shell = surface.clip(normal=normal, origin=surface.center)
    plot = pv.Plotter(off_screen=True, window_size=_SIZE)
    plot.set_background("white")
    plot.add_mesh(shell, color="lightsteelblue", opacity=0.35)
    plot.add_mesh(pv.PolyData(springs.points, lines=lines.ravel()), color="midnightblue", line_width=1)
    up = np.roll(normal, -1)
    plot.camera_position = [
        surface.center + 3 * np.linalg.norm(size) * (normal + 0.25 * up),
        surface.center,
        up,
    ]
    plot.reset_camera()
    plot.camera.zoom(1.3)
    plot.screenshot(out)
    plot.close()


def draw_before_and_after(file: Path, out: Path) -> None:
    """Figure 7: the surface's wire frame beside all springs."""
    surface, springs = _parts(file)
    plot = pv.Plotter(off_screen=True, window_size=(1500, 750), shape=(1, 2), border=False)
    plot.set_background("white")
    plot.subplot(0, 0)
    plot.add_mesh(surface, style="wireframe", color="midnightblue", line_width=1)
    plot.subplot(0, 1)
    plot.add_mesh(springs, color="midnightblue", line_width=0.7, opacity=0.5)
    plot.link_views()
    plot.reset_camera()
    plot.camera.zoom(1.6)
    plot.screenshot(out)
    plot.close()


def main(meshing: str, folder: Path, surfaces: list[Path]) -> None:
    folder.mkdir(parents=True, exist_ok=True)

    def run(*words: object) -> None:
        subprocess.run([meshing, *map(str, words)], check=True, stdout=subprocess.DEVNULL)

    for shape, vertices in (("ball", 162), ("torus", 924)):
        surface, network = folder / f"{shape}.obj", folder / f"{shape}.vtu"
        run("shape", shape, surface, "--vertices", vertices)
        run("network", surface, network, "--nodes", 500, "--phi", 0.05, "--psi", 0.05)
        draw_cut(network, folder / f"{shape}_cut.png")
    draw_before_and_after(folder / "ball.vtu", folder / "figure_7.png")
    for surface in surfaces:
        network = folder / f"{surface.stem}.vtu"
        run("network", surface, network)
        draw_cut(network, folder / f"{surface.stem}_cut.png")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1], Path(sys.argv[2]), [Path(name) for name in sys.argv[3:]])
