"""A view of the bodies that can be turned: one HTML file that works offline."""

from __future__ import annotations

import html
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pyvista as pv
from trame_vtk.modules.vtk.protocols.local_rendering import vtkWebLocalRendering
from trame_vtk.tools.vtksz2html import write_html
from vtkmodules.vtkWebCore import vtkWebApplication

from ..paths import write_text
from ..runs import Array
from .bodies import CLAY, ERRORS, Body, Scale
from .pictures import seen_size, skin_of, view_axes

_GAP = 1.25  # from body to body, over the width of the first as it is seen
_TITLE = "<title>VTK.js | Example - OfflineLocalView</title>"
_ICON = "https://kitware.github.io/vtk-js/icon/favicon-"  # which the viewer would fetch


def write_view(file: Path, title: str, bodies: dict[str, Body], scale: Scale, factor: float) -> None:
    """Puts the deformed bodies side by side above their names, coloured by error on the scale.

    bodies: name -> body, of which the first sets the size; displacements are drawn factor times as large.
    """
    first = next(iter(bodies.values()))
    points = np.vstack([first.X, first.X + factor * first.u])
    low, high = points.min(axis=0), points.max(axis=0)
    axes = view_axes()
    right, step = axes[0], _GAP * max(seen_size(points))
    plotter = pv.Plotter(off_screen=True, window_size=[1200, 500])
    plotter.set_background("white")
    for number, (name, body) in enumerate(bodies.items()):
        skin = skin_of(body.X, body.F)
        skin.move(body.X + factor * body.u + number * step * right)
        mesh = skin.mesh.copy()
        mesh.clear_point_data()
        mesh.points = mesh.points.astype(np.float32)
        if body.error is None:
            plotter.add_mesh(mesh, color=CLAY, smooth_shading=True)
        else:
            mesh["error (%), power of ten"] = np.log10(np.maximum(body.error[skin.ids], scale.low)).astype(
                np.float32
            )
            plotter.add_mesh(
                mesh, scalars="error (%), power of ten", cmap=ERRORS, clim=np.log10((scale.low, scale.high)),
                smooth_shading=True, show_scalar_bar=number == len(bodies) - 1,
                scalar_bar_args={"color": "black", "n_labels": 2, "fmt": "{:.0f}"},
            )  # fmt: skip
        plotter.add_mesh(
            _label(name, (low + high) / 2 + number * step * right, step), color="black", lighting=False
        )
    middle = (low + high) / 2 + (len(bodies) - 1) / 2 * step * right
    plotter.camera_position = [middle + 3 * len(bodies) * step * axes[2], middle, (0, 1, 0)]
    plotter.reset_camera()
    plotter.camera.zoom(2.0)
    text = _html_of(plotter)
    plotter.close()
    write_text(file, text.replace(_TITLE, f"<title>{html.escape(title)}</title>").replace(_ICON, "data:,"))


class _Protocol(vtkWebLocalRendering):  # type: ignore[misc]
    """The part of trame that tells what a window shows, without the server that trame would start and the files that this
    would fetch."""

    app = vtkWebApplication()


def _html_of(plotter: pv.Plotter) -> str:
    window = plotter.render_window
    window.Render()
    number = _Protocol.app.GetObjectIdMap().GetGlobalId(window)
    state = _Protocol().get_standalone_state(str(number))
    scene = io.BytesIO()
    with zipfile.ZipFile(scene, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps(state))
    page = io.StringIO()
    write_html(scene.getvalue(), page)
    _Protocol.app.GetObjectIdMap().FreeObject(window)
    return page.getvalue()


def _label(name: str, at: Array, width: float) -> pv.PolyData:
    """The name as flat letters that face the first view, below a body of that place and width (m)."""
    text = pv.Text3D(name, depth=0.0)
    letters = np.asarray(text.points)[:, :2]
    letters = letters - (letters.min(axis=0) + letters.max(axis=0)) / 2
    letters *= min(0.9 * width / np.ptp(letters[:, 0]), 0.1 * width / np.ptp(letters[:, 1]))
    right, up, _ = view_axes()
    text.points = (at + letters @ np.array([right, up]) - 0.6 * width * up).astype(np.float32)
    return text
