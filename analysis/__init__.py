"""Runs both solvers on a scene, compares what they wrote, and draws it.

The functions a notebook needs: numpy arrays and pyvista meshes in, numbers out.
"""

from .compare import (
    compare_runs,
    displacement_error,
    remove_rigid_motion,
    trajectory_error,
    vertex_areas,
    volume,
    volume_change,
    volume_error,
)
from .front import pareto, seconds_for
from .pictures import surface_of
from .runs import Frame, Run, RunError, load_run

__all__ = [
    "Frame",
    "Run",
    "RunError",
    "compare_runs",
    "displacement_error",
    "load_run",
    "pareto",
    "remove_rigid_motion",
    "seconds_for",
    "surface_of",
    "trajectory_error",
    "vertex_areas",
    "volume",
    "volume_change",
    "volume_error",
]
