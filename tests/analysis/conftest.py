import numpy as np
import pytest
import pyvista as pv


@pytest.fixture(scope="session")
def ball() -> tuple[np.ndarray, np.ndarray]:
    """Unit ball of 642 vertices: X (n, 3), F (m, 3)."""
    mesh = pv.Icosphere(radius=1, nsub=3)
    return np.array(mesh.points, dtype=float), np.array(mesh.regular_faces)


@pytest.fixture
def drawn(monkeypatch):
    """Of a module, whose plots then give the figure itself instead of its SVG text: what is drawn can be read back."""

    def drawn_by(module):
        monkeypatch.setattr(module, "svg_of", lambda figure: figure)
        return module

    return drawn_by
