"""The film of the first page: a session of a preview, stepped so that its pictures are the same on every machine.

python -m massspring.viewer.film FILE.webp
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pyvista as pv
from PIL import Image

from analysis.paths import SCENES
from massspring.viewer.preview import Preview, write_film

_SCENE = SCENES / "torus_hang.toml"
_SOFT = [
    "surface.n_vertices=400", "material.E=2e4", "material.rho=100", "material.damping=3", "material.law=neo_hookean",
    "time.mode=dynamic", "time.step=0.02", "time.end=20",
]  # fmt: skip
_STEPS = 2  # of a picture
_SIZE = (900, 600)  # pixels
_PICTURE = 0.07  # s
_NEARER = 1.2  # than a preview begins


class Session:
    """Steps a preview whose window is not on the screen, and keeps a picture of each moment."""

    def __init__(self) -> None:
        self.preview = Preview(_SCENE, _SOFT)
        self.window = self.preview.window
        self.window.plotter.window_size = _SIZE
        self.window.open()
        self.window.plotter.renderers[0].camera.parallel_scale /= _NEARER
        self.window.plotter.render_window.SetMultiSamples(8)
        self.pictures: list[Image.Image] = []

    def go_on(self, caption: str, n: int = 1) -> None:
        """n pictures."""
        engine = self.preview.engine
        for _ in range(n):
            for _ in range(_STEPS):
                done = engine.latest.head["n_steps"]
                engine.say("step")
                while engine.latest.head["n_steps"] == done:
                    time.sleep(0.01)
            self.preview.draw(0)
            self.preview.text.input = f"{engine.latest.head['time']:.2f} s: {caption}"
            self.window.plotter.render()
            self.pictures.append(Image.fromarray(self.window.plotter.screenshot(None, return_img=True)))

    def pull(self, direction: tuple[float, float], way: tuple[float, float], n: int, caption: str) -> None:
        """What lies farthest in a direction of the picture, by so many pixels, over n pictures."""
        engine = self.preview.engine
        body = engine.latest.body
        x = (body.X + engine.latest.u)[: body.n_uncut]
        seen = np.array([self.window.pixels_of(point) for point in x])
        start = seen[int(np.argmax(seen[:, :2] @ direction))]
        inwards = 0.06 * (seen[:, :2].mean(axis=0) - start[:2])
        assert self.preview.hand.take(*(int(c) for c in start[:2] + inwards)) is not None
        for share in np.linspace(0, 1, n):
            to = start[:2] + share * np.array(way)
            self.preview.hand.drag(self.window.point_at(to[0], to[1], start[2]))
            self.go_on(caption)
        self.preview.hand.drop()


def main(file: Path) -> None:
    pv.OFF_SCREEN = True
    session = Session()
    preview = session.preview
    session.go_on("springs step as you watch", 8)
    session.pull((1, -0.3), (110, -50), 16, "drag the body, and a spring pulls it")
    session.go_on("let go", 16)
    preview.next_colour()
    preview.next_colour()
    preview.toggle_part("patches")
    session.pull((-0.6, -1), (-60, -80), 16, "cut it open: patches of tetrahedra, coloured by strain")
    session.go_on("let go", 12)
    preview.toggle_part("patches")
    preview.toggle_part("springs")
    preview.toggle_part("nodes")
    preview.sliders["material.E"].GetRepresentation().SetValue(float(np.log10(1e4)))
    preview.set("material.E", "1e4")
    session.go_on("make it softer: springs and inner nodes", 22)
    write_film(file, session.pictures, _PICTURE)
    preview.engine.end()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
