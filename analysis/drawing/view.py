"""A view of the bodies that can be turned: one HTML file that works offline."""

from __future__ import annotations

import base64
import html
import io
import json
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista as pv
from trame_vtk.modules.vtk.protocols.local_rendering import vtkWebLocalRendering
from trame_vtk.tools.vtksz2html import HTML_VIEWER_PATH
from vtkmodules.vtkWebCore import vtkWebApplication

from ..paths import write_text
from ..runs import Array
from .bodies import Body, add_painted, shown
from .error_scale import powers_of, scale_svg
from .pictures import aim, light, seen_size, skin_of, surface_of

_TITLE = "<title>VTK.js | Example - OfflineLocalView</title>"
_ICON = "https://kitware.github.io/vtk-js/icon/favicon-"  # which the viewer would fetch
_ROOM = 0.9  # of a body's part of the window, filled by it
_NARROWEST = 200  # pixels of such a part: its name fits

_STYLE = """<style>
body { font: 16px/1.4 system-ui, sans-serif; color: #222; display: flex; flex-direction: column; }
header, footer { padding: .5rem 1rem; } h1 { font-size: 1.1rem; margin: 0; } p { margin: 0; color: #555; font-size: .9rem; }
main { flex: 1; min-height: 0; display: grid; grid-auto-rows: minmax(0, 1fr); }
section { min-width: 0; display: flex; flex-direction: column; }
.body { position: relative; flex: 1; min-height: 0; overflow: hidden; }
.name { height: 2.6rem; text-align: center; font-size: .85rem; line-height: 1.3; overflow: hidden; white-space: nowrap; }
footer svg { display: block; max-width: 100%; height: auto; max-height: 20vh; margin: auto; }
</style>"""

# A window for each body: they share a camera, and stand in the number of columns that leaves them largest.
_SCRIPT = """<script>
let windows = [];
function loadDataSet() {
  SCENES.forEach((base64Str, k) => {
    OfflineLocalView.load(document.querySelectorAll(".body")[k], { base64Str });
    windows.push(global.renderWindow);
  });
  setUp();
}
const rendererOf = view => view.getRenderers().find(renderer => renderer.getActors().length);
function setUp() {
  if (!windows.every(rendererOf)) return requestAnimationFrame(setUp);
  const camera = rendererOf(windows[0]).getActiveCamera();
  camera.setParallelProjection(true);
  for (const view of windows) rendererOf(view).setActiveCamera(camera);
  const render = () => windows.forEach(view => { rendererOf(view).resetCameraClippingRange(); view.render(); });
  for (const view of windows) view.getInteractor().onAnimation(render);
  new ResizeObserver(() => {
    arrange(camera);
    dispatchEvent(new Event("resize")); // to which every window fits itself
    render();
  }).observe(document.querySelector("main"));
}
function arrange(camera) {
  const main = document.querySelector("main"), n = windows.length, name = document.querySelector(".name").offsetHeight;
  const pixels = columns => Math.min(
    main.clientWidth / columns / WIDTH, (main.clientHeight / Math.ceil(n / columns) - name) / HEIGHT);
  const most = Math.max(1, Math.min(n, Math.floor(main.clientWidth / NARROWEST)));
  const columns = [...Array(most).keys()].map(k => k + 1).reduce((a, b) => pixels(b) > pixels(a) ? b : a);
  main.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
  camera.setParallelScale(document.querySelector(".body").clientHeight / pixels(columns) / 2 / ROOM);
}
</script>"""


class Shown(NamedTuple):
    """A body of a view, its name, and what was found of it."""

    name: str
    found: str
    body: Body


def write_view(file: Path, title: str, words: str, panels: Sequence[Shown], factor: float) -> None:
    """Puts the deformed bodies side by side above their names, in the colours of their errors, each within a pale shell, which
    is the body at rest.

    words: what is drawn, as a sentence; panels: the first body sets the size; displacements are drawn factor times as large.
    """
    points = shown([panel.body for panel in panels], factor)
    # All at once: the viewer tells objects by their addresses.
    plotters = [_plotter_of(panel.body, factor, points) for panel in panels]
    scenes = [_scene_of(plotter) for plotter in plotters]
    for plotter in plotters:
        plotter.close()
    sections = [
        f'<section><div class="body"></div><div class="name"><b>{html.escape(name)}</b><br>{html.escape(found)}</div></section>'
        for name, found, _ in panels
    ]
    hint = (
        "The pale shell is the body at rest, hidden where the moved one lies outside it. Drag to turn, use the wheel or two "
        "fingers to come nearer."
    )
    body = (
        f"{_STYLE}<header><h1>{html.escape(title)}</h1><p>{html.escape(words)} {hint}</p></header>"
        f"<main>{''.join(sections)}</main><footer>{_inline(scale_svg())}</footer>"
    )
    width, height = seen_size(points)
    values = {"SCENES": scenes, "WIDTH": width, "HEIGHT": height, "ROOM": _ROOM, "NARROWEST": _NARROWEST}
    script = re.sub("|".join(values), lambda found: json.dumps(values[found[0]]), _SCRIPT)
    text = HTML_VIEWER_PATH.read_text(encoding="utf-8")
    text = text.replace(_TITLE, f"<title>{html.escape(title)}</title>").replace(_ICON, "data:,")
    write_text(file, text.replace("<body>", f"<body>{body}{script}", 1))


def _inline(svg: str) -> str:
    """An SVG file's text as a part of a page."""
    return svg[svg.index("<svg") :]


class _Protocol(vtkWebLocalRendering):  # type: ignore[misc]
    """The part of trame that tells what a window shows, without the server that trame would start and the files that this
    would fetch."""

    app = vtkWebApplication()


def _plotter_of(body: Body, factor: float, points: Array) -> pv.Plotter:
    """A window of a body and its shell, seen so that it holds the points."""
    plotter = pv.Plotter(off_screen=True, lighting="none")
    plotter.set_background("white")
    light(plotter)
    skin = skin_of(body.X, body.F)
    skin.move(body.X + factor * body.u)
    mesh = skin.mesh.copy()
    mesh.clear_point_data()
    mesh.points = mesh.points.astype(np.float32)
    if body.error is not None:
        mesh["error"] = powers_of(body.error[skin.ids]).astype(np.float32)
    add_painted(plotter, mesh)
    shell = surface_of(body.X.astype(np.float32), body.F)
    plotter.add_mesh(shell, color="#8a93a0", opacity=0.25, lighting=False, culling="front")
    aim(plotter.camera, points)
    return plotter


def _scene_of(plotter: pv.Plotter) -> str:
    """What the viewer loads, in base 64."""
    window = plotter.render_window
    window.Render()
    number = _Protocol.app.GetObjectIdMap().GetGlobalId(window)
    state = _Protocol().get_standalone_state(str(number))
    _Protocol.app.GetObjectIdMap().FreeObject(window)
    scene = io.BytesIO()
    with zipfile.ZipFile(scene, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps(state))
    return base64.b64encode(scene.getvalue()).decode()
