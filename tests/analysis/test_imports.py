"""Who may import whom in the analysis: figures never need what draws them, and drawing knows no study."""

import ast
import subprocess
import sys

import pytest

from analysis.paths import PACKAGE, ROOT

# Module or room -> modules and rooms that it may import. A new module of the top is a new line; those of a room are not.
ALLOWED = {
    "paths": set(),
    "methods": set(),
    "front": set(),
    "machine": set(),
    "wording": set(),
    "progress": {"wording"},
    "folder_lock": set(),
    "outputs": set(),
    "runs": {"machine", "methods", "outputs"},
    "time_warp": {"runs"},
    "small_strain": {"runs"},
    "surface_points": {"runs"},
    "silhouette": {"runs"},
    "shape_measures": {"compare", "runs", "silhouette", "surface_points"},
    "spread": {"runs", "wording"},
    "compare": {"runs", "small_strain", "surface_points"},
    "load_scale": {"runs", "small_strain"},
    "execute": set(),
    "run_store": {
        "execute",
        "folder_lock",
        "load_scale",
        "machine",
        "outputs",
        "paths",
        "progress",
        "runs",
        "turns",
    },
    "turns": set(),
    "cluster": {
        "machine",
        "paths",
        "progress",
        "run_store",
        "runs",
        "turns",
    },
    "experiment_folder": {"compare", "runs"},
    "experiment": {
        "execute",
        "experiment_folder",
        "load_scale",
        "methods",
        "paths",
        "progress",
        "references",
        "run_store",
        "runs",
        "time_warp",
        "wording",
    },
    "references": {
        "comparison",
        "experiment_folder",
        "methods",
        "progress",
        "runs",
        "verdict",
        "wording",
    },
    "remesh": {"paths", "runs", "wording"},
    "comparison": {"compare", "experiment_folder", "methods", "runs", "shape_measures", "verdict"},
    "verdict": {"wording"},
    "report": {"methods", "verdict", "wording"},
    "index": {"paths", "report"},
    "drawing": {
        "compare",
        "methods",
        "paths",
        "runs",
        "silhouette",
        "surface_points",
        "time_warp",
        "verdict",
        "wording",
    },
    "comparison_figures": {
        "compare",
        "comparison",
        "drawing",
        "methods",
        "paths",
        "report",
        "verdict",
        "wording",
    },
    "results": {
        "comparison",
        "comparison_figures",
        "experiment_folder",
        "machine",
        "methods",
        "outputs",
        "paths",
        "progress",
        "remesh",
        "report",
        "verdict",
    },
    "scene": {"paths", "runs"},
    "tables": {
        "compare",
        "comparison",
        "comparison_figures",
        "drawing",
        "methods",
        "report",
        "runs",
        "verdict",
    },
    "foreign": {"foreign_vtk", "paths", "runs"},
    "foreign_vtk": set(),
    "pair": {
        "compare",
        "comparison_figures",
        "drawing",
        "folder_lock",
        "foreign",
        "methods",
        "paths",
        "report",
        "runs",
        "wording",
    },
    "session": {
        "comparison",
        "experiment",
        "experiment_folder",
        "folder_lock",
        "grid",
        "paths",
        "results",
        "runs",
        "scene",
        "tables",
        "verdict",
    },
    "grid": {
        "cluster",
        "compare",
        "drawing",
        "experiment",
        "folder_lock",
        "outputs",
        "paths",
        "progress",
        "report",
        "run_store",
        "runs",
        "verdict",
        "wording",
    },
    "reproduction": {"paths", "report", "wording"},
    "reproduce": {
        "cluster",
        "comparison",
        "experiment",
        "folder_lock",
        "machine",
        "outputs",
        "paths",
        "progress",
        "report",
        "reproduction",
        "run_store",
        "runs",
        "wording",
    },
    "studies": {
        "cluster",
        "compare",
        "comparison",
        "drawing",
        "experiment",
        "folder_lock",
        "front",
        "grid",
        "machine",
        "methods",
        "outputs",
        "paths",
        "progress",
        "remesh",
        "report",
        "reproduce",
        "results",
        "run_store",
        "runs",
        "shape_measures",
        "spread",
        "surface_points",
        "time_warp",
        "verdict",
        "wording",
    },
    "__main__": {
        "cluster",
        "drawing",
        "experiment",
        "folder_lock",
        "grid",
        "index",
        "outputs",
        "pair",
        "paths",
        "remesh",
        "report",
        "reproduce",
        "results",
        "runs",
        "studies",
    },
    "__init__": set(),
}


def place_of(path):
    """Module or room of a file within the package."""
    return path.parts[0] if len(path.parts) > 1 else path.stem


def imported(text, room):
    """Modules and rooms of the package that a text imports; room: the folder that it stands in, or ""."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.level:
            is_own = node.level == 1 and room
            names = [node.module] if node.module else [alias.name for alias in node.names]
            found |= {room} if is_own else {name.split(".")[0] for name in names}
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "analysis":
            found |= set(node.module.split(".")[1:2]) or {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("analysis.")}
    return found


def refused():
    lines = []
    for file in sorted(PACKAGE.rglob("*.py")):
        path = file.relative_to(PACKAGE)
        place = place_of(path)
        room = place if len(path.parts) > 1 else ""
        lines += [f"{path}: {name}" for name in imported(file.read_text(), room) - ALLOWED[place] - {place}]
    return lines


def test_nothing_imports_what_it_may_not():
    assert refused() == []


def modules_imported(file):
    """Modules of the package that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = file.parents[node.level - 1] / (node.module or "").replace(".", "/")
            found |= {base / alias.name for alias in node.names} | {base}
    return {path for path in (folder.with_suffix(".py") for folder in found) if path.exists()}


def circles(graph):
    """What is left of a graph (module -> modules) once those that import nothing left are taken away."""
    left = dict(graph)
    while ends := [name for name, imported in left.items() if not imported & left.keys()]:
        for name in ends:
            del left[name]
    return left


def test_no_modules_import_each_other():
    assert circles({file: modules_imported(file) for file in PACKAGE.rglob("*.py")}) == {}
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}}).keys() == {"a", "b", "c"}


@pytest.mark.parametrize(
    "text, room, found",
    [
        ("from .drawing.style import style_of", "", {"drawing"}),
        ("from . import sweep", "", {"sweep"}),
        ("from .style import style_of", "drawing", {"drawing"}),
        ("from ..studies.cost import plot", "drawing", {"studies"}),
        ("from .. import machine", "studies", {"machine"}),
        ("def f():\n    from analysis import sweep", "", {"sweep"}),
        ("import analysis.report as r, numpy", "", {"report"}),
        ("from analysis.report import page", "", {"report"}),
        ("import numpy\nfrom pathlib import Path", "", set()),
    ],
)
def test_imports_are_found_however_they_are_written(text, room, found):
    assert imported(text, room) == found


@pytest.mark.parametrize(
    "modules, refused",
    [
        ("paths, machine, methods, report", {"matplotlib", "pyvista", "numpy"}),
        ("runs, compare, run_store, experiment, comparison", {"matplotlib"}),
    ],
)
def test_paths_and_figures_load_nothing_that_draws(modules, refused):
    code = f"import sys; from analysis import {modules}; print(*sys.modules)"
    words = [sys.executable, "-c", code]
    loaded = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert "analysis.paths" in loaded or "analysis.runs" in loaded
    assert not refused & set(loaded)
