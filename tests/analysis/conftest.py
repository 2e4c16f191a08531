import numpy as np
import pytest
import pyvista as pv


@pytest.fixture(scope="session")
def ball() -> tuple[np.ndarray, np.ndarray]:
    """Unit ball of 642 vertices: X (n, 3), F (m, 3)."""
    mesh = pv.Icosphere(radius=1, nsub=3)
    return np.array(mesh.points, dtype=float), np.array(mesh.regular_faces)
