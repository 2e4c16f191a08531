"""Runs both solvers on a scene, compares what they wrote, and draws it.

The functions a notebook needs: numpy arrays and pyvista meshes in, numbers out.
"""

from .compare import (
    compare_runs,
    displacement_error,
    remove_rigid_motion,
    vertex_areas,
    volume,
    volume_change_error,
)
from .runs import Run, RunError, load_run

__all__ = [
    "Run",
    "RunError",
    "compare_runs",
    "displacement_error",
    "load_run",
    "remove_rigid_motion",
    "vertex_areas",
    "volume",
    "volume_change_error",
]
