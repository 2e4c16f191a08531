"""Loads without an exact field: gravity on a clamped body, end shear, pressure on a patch and a localised collapse,
against quadratic finite elements on refined tetrahedra of the same surface.

Bodies are scaled to a smallest side of 1 m. Gravity pulls across the longest side, whose first quarter is clamped. At the edge
of a clamp stress has no bound and every element converges slowly, so the other loads leave the body free: tractions,
constant in each eighth of its bounding box and as small as can be, balance them. References are refined once, clamped
small ones twice; their own error is the difference that the last refinement made, as if it were of first order. A model's
error is undecided where it is not three times that.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..compare import compare_runs, triangle_normals
from ..grid import csv_of
from ..paths import write_text
from ..points import Outcome, Point, Store, say
from ..runs import Array, Run, RunError, load_run

SHAPES = ("ball:642", "bar:900", "torus.obj", "liver2.obj", "handle.off", "spot.ply")
_OF_EVERY_NU = "torus.obj"
MODELS = ("uniform", "affine", "van_gelder", "lloyd", "edge_coupled", "node_averaged")
LOADS = ("clamp", "gravity", "end_shear", "patch", "collapse")
DECIDED = 3  #: times the reference's own error
_MOST_TETRAHEDRA = 250_000  # of a reference refined twice
_TOLERANCE = "time.residual=1e-9"
_FREE = """
[material]
E = 1e9 # Pa: strains near 1e-4, where all is linear and nothing lost in rounding

[time]
load_steps = 1

[network]
connectivity = "completed_pcp" # the paper's own has motions without energy

[output]
frames_every = 0
"""
_SPLIT = 0.47  # of the bounding box: no vertex of a symmetric body lies there
Row = dict[str, str]


def surface_of(shape: str, meshes: Path) -> str:
    """The scene's surface: a file of the meshes, or SHAPE:VERTICES of a generated one."""
    name, colon, n = shape.partition(":")
    source = f'shape = "{name}"\nn_vertices = {n}' if colon else f'file = "{meshes / shape}"'
    return f"[surface]\n{source}\nnormalise = true\n"


def resultant(X: Array, F: Array, tractions: Array) -> Array:
    """Force and torque about the origin (6) of a traction (m, 3) on each triangle."""
    forces = np.linalg.norm(triangle_normals(X, F), axis=1)[:, None] * tractions
    return np.concatenate([forces.sum(axis=0), np.cross(X[F].mean(axis=1), forces).sum(axis=0)])


def weight(X: Array, F: Array, acceleration: Array, density: float) -> Array:
    """Force and torque about the origin (6) of gravity on the body within a surface."""
    corners = X[F]  # of tetrahedra from the origin
    volumes = np.linalg.det(corners) / 6
    force = density * volumes.sum() * acceleration
    return np.concatenate([force, np.cross(density * volumes @ corners.sum(axis=1) / 4, acceleration)])


def eighths(X: Array, F: Array) -> list[tuple[Array, Array, Array]]:
    """Relative low and high corner, and triangles, of each eighth of the bounding box that has any."""
    relative = (X - X.min(axis=0)) / np.ptp(X, axis=0)
    parts = []
    for corner in np.ndindex(2, 2, 2):
        low, high = np.where(corner, _SPLIT, -0.1), np.where(corner, 1.1, _SPLIT)
        inside = ((relative >= low) & (relative <= high)).all(axis=1)
        if (triangles := inside[F].all(axis=1)).any():
            parts.append((low, high, F[triangles]))
    return parts


def balancing(X: Array, F: Array, load: Array) -> Array:
    """Tractions (n, 3) on the eighths that balance a force and torque, of the least mean square over their area."""
    columns = []
    for _, _, part in eighths(X, F):
        root = np.sqrt(np.linalg.norm(triangle_normals(X, part), axis=1).sum())
        columns += [resultant(X, part, np.tile(axis, (len(part), 1))) / root for axis in np.eye(3)]
    found = np.linalg.lstsq(np.array(columns).T, -load, rcond=None)[0].reshape(-1, 3)
    roots = [np.sqrt(np.linalg.norm(triangle_normals(X, part), axis=1).sum()) for _, _, part in eighths(X, F)]
    return found / np.array(roots)[:, None]


def _list(values: Array) -> str:
    return str([float(value) for value in values])


def _balance(X: Array, F: Array, load: Array) -> str:
    """The loads that balance one."""
    text = ""
    for (low, high, _), traction in zip(eighths(X, F), balancing(X, F, load), strict=True):
        text += f"\n[[loads]]\nregion = {{ box = {{ low = {_list(low)}, high = {_list(high)} }}, relative = true }}\n"
        text += f"traction = {_list(traction)}\n"
    return text


def scene_of(load: str, surface: str, X: Array, F: Array) -> str:
    """The scene of one load on a surface whose vertices, scaled, are X."""
    along = int(np.ptp(X, axis=0).argmax())
    across = np.eye(3)[(along + 1) % 3]
    share = (X[:, along] - X[:, along].min()) / np.ptp(X[:, along])
    top = X[np.where(share > 0.5, X @ across, -np.inf).argmax()]  # of the far half
    if load == "gravity":
        g = 100 * across  # strains as of the other loads
        return f"gravity = {_list(g)}\n{surface}{_FREE}{_balance(X, F, weight(X, F, g, 1000))}"
    if load == "clamp":
        high = _list(np.where(np.arange(3) == along, 0.25, 1.1))
        clamp = f"box = {{ low = [-0.1, -0.1, -0.1], high = {high} }}, relative = true"
        gravity = f"gravity = {_list(9.81 * across)}\n"
        return f'{gravity}{surface}{_FREE}\n[[supports]]\nregion = {{ {clamp} }}\ncomponents = "xyz"\n'
    if load == "end_shear":
        low = _list(np.where(np.arange(3) == along, 0.75, -0.1))
        end = F[(share >= 0.75)[F].all(axis=1)]
        region = f"{{ box = {{ low = {low}, high = [1.1, 1.1, 1.1] }}, relative = true }}"
        force = resultant(X, end, np.tile(1e5 * across, (len(end), 1)))
        shear = f"\n[[loads]]\nregion = {region}\ntraction = {_list(1e5 * across)}\n"
        return surface + _FREE + shear + _balance(X, F, force)
    if load == "patch":
        patch = F[(np.linalg.norm(X - top, axis=1) <= 0.5)[F].all(axis=1)]
        normals = triangle_normals(X, patch)
        pressure = -1e5 * normals / np.linalg.norm(normals, axis=1)[:, None]
        region = f"{{ sphere = {{ center = {_list(top)}, radius = 0.5 }} }}"
        pressed = f"\n[[loads]]\nregion = {region}\npressure = 1e5\n"
        return surface + _FREE + pressed + _balance(X, F, resultant(X, patch, pressure))
    return f"{surface}{_FREE}\n[collapse]\ncoefficient = 1e-4\n\n[[collapse.pivots]]\npoint = {_list(top)}\n"


def cases(quick: bool) -> list[tuple[str, str, str]]:
    """Poisson's ratio, shape and load, in the order in which they are measured."""
    if quick:
        return [("0.25", "ball:162", load) for load in LOADS]
    every = [(nu, shape, load) for nu in ("0.25", "0.49", "0.45") for shape in SHAPES for load in LOADS]
    return every + [(nu, _OF_EVERY_NU, load) for nu in ("0", "0.3") for load in LOADS]


class Loads:
    """Scenes and runs in a folder."""

    def __init__(self, folder: Path, meshes: Path, is_quiet: bool, store: Store | None = None) -> None:
        self.folder, self.meshes, self.is_quiet = folder, meshes, is_quiet
        self.store = store or Store(folder / "points")
        (folder / "scenes").mkdir(parents=True, exist_ok=True)

    def _scene(self, name: str, text: str) -> Path:
        file = self.folder / "scenes" / f"{name.replace(':', '_')}.toml"
        write_text(file, text)
        return file

    def _run(self, point: Point) -> Outcome:
        outcome = self.store.run(point)
        if outcome.status != "ok":
            raise RunError(
                ": ".join(part for part in (point.program, outcome.status, outcome.message) if part)
            )
        return outcome

    def scene(self, shape: str, load: str) -> Path:
        """Writes the scene. The scaled surface is that of a run under uniform pressure."""
        surface = surface_of(shape, self.meshes)
        plain = self._scene(f"{shape}-pressure", f"{surface}{_FREE}\n[[loads]]\npressure = 1e5\n")
        rest = load_run(self._run(Point("fem_reference", plain, ("reference.degree=1",))).folder).last
        return self._scene(f"{shape}-{load}", scene_of(load, surface, rest.X, rest.F))

    def _references(self, scene: Path, nu: str, is_singular: bool) -> tuple[Run, Run]:
        """The finest reference, and the one before."""
        runs: list[Run] = []
        for refine in range(3 if is_singular else 2):
            if refine == 2 and 8 * runs[-1].record["n_tetrahedra"] > _MOST_TETRAHEDRA:
                break
            overrides = (f"material.nu={nu}", f"reference.refine={refine}", _TOLERANCE)
            runs.append(load_run(self._run(Point("fem_reference", scene, overrides)).folder))
        return runs[-2], runs[-1]

    def measure(self, nu: str, shape: str, load: str) -> list[Row]:
        """A row for each model. What fails is a row that says why."""
        row = {"surface": shape, "nu": nu, "load": load, "spacing": "", "seed": "1"}
        try:
            scene = self.scene(shape, load)
            coarse, fine = self._references(scene, nu, load == "clamp")
            own = compare_runs(coarse, fine, fine.record["is_free"]).displacement_error_l2
        except RunError as error:
            return [{**row, "model": model, "status": str(error)} for model in MODELS]
        rows = []
        for model in MODELS:
            overrides = (f"material.nu={nu}", f"network.calibration={model}")
            try:
                run = load_run(self._run(Point("massspring", scene, overrides, ("--no-diagnostics",))).folder)
                figures = compare_runs(run, fine, fine.record["is_free"])
            except RunError as error:
                rows.append({**row, "model": model, "status": str(error)})
                continue
            l2 = figures.displacement_error_l2
            rows.append(
                {
                    **row,
                    "model": model,
                    "status": "ok" if l2 >= DECIDED * own else "undecided",
                    "n_nodes": str(figures.n_nodes),
                    "error_l2": f"{l2:.6g}",
                    "error_max": f"{figures.displacement_error_max:.6g}",
                    "volume_error": f"{figures.volume_change_error:.6g}",
                    "reference_error": f"{own:.6g}",
                }
            )
        return rows

    def run(self, quick: bool) -> list[Row]:
        """All cases; the table is written after each."""
        rows: list[Row] = []
        wanted = [case for case in cases(quick) if ":" in case[1] or (self.meshes / case[1]).exists()]
        for number, case in enumerate(wanted, 1):
            rows += self.measure(*case)
            say(f"[{number}/{len(wanted)}] nu = {case[0]}, {case[1]}, {case[2]}", self.is_quiet)
            write_text(self.folder / "loads.csv", csv_of(rows))
        return rows
