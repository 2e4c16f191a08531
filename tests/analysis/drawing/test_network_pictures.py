"""Pictures of networks, from files whose springs lie on a known side."""

import numpy as np
import pyvista as pv
from PIL import Image

from analysis.drawing.network_pictures import draw_cut


def write_network(file, X, F, springs):
    """As `meshing network` writes it."""
    cells = {pv.CellType.TRIANGLE: F, pv.CellType.LINE: springs}
    pv.UnstructuredGrid(cells, X).save(file)


def dark(file):
    """Share of the pixels in the colour of springs: darker than that of the shell."""
    return float((np.asarray(Image.open(file).convert("RGB"), dtype=int).sum(axis=2) < 350).mean())


def test_network_cut_open_shows_the_springs_behind_the_cut(ball, tmp_path):
    X, F = ball[0] * [1, 1, 0.5], ball[1]  # cut across z
    edges = np.unique(np.sort(np.vstack([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1), axis=0)
    heights = X[edges][:, :, 2]
    sides = {"behind": (heights < -0.1).all(axis=1), "before": (heights > 0.1).all(axis=1)}
    share = {}
    for name, chosen in sides.items():
        write_network(tmp_path / f"{name}.vtu", X, F, edges[chosen])
        draw_cut(tmp_path / f"{name}.vtu", tmp_path / f"{name}.png")
        share[name] = dark(tmp_path / f"{name}.png")
    assert share["behind"] > 0.01
    assert share["before"] == 0
