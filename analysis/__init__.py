"""Runs both solvers on a scene, compares what they wrote, and draws it: analysis/PYTHON.md."""

from importlib import import_module
from typing import Any

_HOMES = {
    "Experiment": "session",
    "Frame": "runs",
    "ModelComparison": "compare",
    "Run": "runs",
    "RunError": "runs",
    "Scene": "scene",
    "area_change": "compare",
    "change_error": "compare",
    "compare_runs": "compare",
    "displacement_error": "compare",
    "load_run": "runs",
    "pareto": "front",
    "remove_rigid_motion": "compare",
    "run": "session",
    "seconds_for": "front",
    "surface_of": "drawing.pictures",
    "sweep": "session",
    "trajectory_error": "compare",
    "vertex_areas": "compare",
    "volume": "compare",
    "volume_change": "compare",
}
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Imports a name where it is first asked for, so that a path is learnt without loading what draws."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
