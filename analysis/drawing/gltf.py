"""Animated glTF of a run, for Blender and other programs of animators: glTF 2.0 of Khronos."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from ..paths import write_bytes
from ..runs import Array, Run, RunError, scene_of

_FLOAT, _UNSIGNED = 5126, 5125  # types of components
_VERTICES, _INDICES = 34962, 34963  # what a view of the buffer is for
_FORMAT = {_FLOAT: "<f4", _UNSIGNED: "<u4"}


@dataclass(frozen=True)
class FileSurface:
    """The surface as it stands in its file, with the file's coordinates, unit and axes.

    points: (n, 3); triangles: (m, 3); vertices: (n,) of the run's surface at each point; to_body: (4, 4) matrix that takes
    columns (point, 1) to the body's coordinates at rest (m).
    """

    points: Array
    triangles: Array
    vertices: Array
    to_body: Array

    def displacement(self, u: Array) -> Array:
        """(n, 3), in the file's coordinates, for u (n_surface, 3) in m."""
        return np.linalg.solve(self.to_body[:3, :3], u[self.vertices].T).T


def file_surface(run: Run) -> FileSurface:
    """Of the file that the run's scene names, as the solver kept it; a shape is its own file.

    Raises RunError where a file's surface was not kept.
    """
    X = run.last.X
    if not scene_of(run).get("surface", {}).get("file"):
        return FileSurface(X, run.last.F, np.arange(len(X)), np.eye(4))
    kept = run.folder / "surface_file.vtu"
    if not kept.is_file():
        raise RunError(f"{kept}: missing, run the solver again")
    grid = pv.read(kept)
    points = np.asarray(grid.points, dtype=float)
    vertices = np.asarray(grid["vertex"], dtype=int)
    middle = points.mean(axis=0)  # a file's origin may lie far from its body
    linear, *_ = np.linalg.lstsq(np.column_stack([points - middle, np.ones(len(points))]), X[vertices])
    to_body = np.eye(4)
    to_body[:3, :3] = linear[:3].T
    to_body[:3, 3] = linear[3] - linear[:3].T @ middle
    return FileSurface(points, grid.cells_dict[pv.CellType.TRIANGLE], vertices, to_body)


class _Buffer:
    """The bytes of a glTF file, and its description of them."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: Array, component: int, target: int | None = None) -> int:
        """Number of the accessor of values (n,) or (n, 3)."""
        data = np.ascontiguousarray(values, dtype=_FORMAT[component])
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": data.nbytes}
        self.views.append(view | ({"target": target} if target else {}))
        self.bytes += data.tobytes()
        columns = data.reshape(len(data), -1)
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": component,
                "count": len(data),
                "type": "SCALAR" if data.ndim == 1 else "VEC3",
                "min": columns.min(axis=0).tolist(),
                "max": columns.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1


def frame_weights(run: Run, times: Array) -> Array:
    """(n_times, n_frames): shares of the run's frames in its motion at the times, linear between them."""
    number = np.interp(times, run.times, np.arange(len(run.times)))
    return np.maximum(0, 1 - np.abs(number[:, None] - np.arange(len(run.times))))


def write_gltf(file: Path, run: Run, times: Array, seconds: float) -> None:
    """Writes binary glTF (.glb): the surface at rest, a morph target for each frame and their weights over time.

    Points and triangles are the file's own, in its order and its coordinates; a node's matrix makes them the body in m.
    times: of the run, which a film of that length (s) shows evenly, one after the other. Raises RunError as file_surface.
    """
    surface = file_surface(run)
    if len(run.times) < 2:
        raise RunError(f"{run.folder}: one frame, expected two at least; was output.frames_every = 0?")
    buffer = _Buffer()
    primitive = {
        "attributes": {"POSITION": buffer.add(surface.points, _FLOAT, _VERTICES)},
        "indices": buffer.add(surface.triangles.ravel(), _UNSIGNED, _INDICES),
        "targets": [
            {"POSITION": buffer.add(surface.displacement(run.frame(k).u), _FLOAT, _VERTICES)}
            for k in range(len(run.times))
        ],
    }
    weights = frame_weights(run, times)
    sampler = {
        "input": buffer.add(np.linspace(0, seconds, len(times)), _FLOAT),
        "interpolation": "LINEAR",
        "output": buffer.add(weights.ravel(), _FLOAT),
    }
    name = run.record.get("name", run.folder.name)
    document = {
        "asset": {"version": "2.0", "generator": "springs against finite elements"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0, "matrix": surface.to_body.T.ravel().tolist()}],
        "meshes": [{"name": name, "primitives": [primitive], "weights": weights[0].tolist()}],
        "animations": [
            {
                "name": name,
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                "samplers": [sampler],
            }
        ],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.bytes)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        struct.pack("<I4s", len(data), kind) + data
        for kind, data in ((b"JSON", text), (b"BIN\0", bytes(buffer.bytes)))
    )
    write_bytes(file, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
