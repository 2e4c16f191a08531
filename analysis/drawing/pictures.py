"""What every picture of a body shares, drawn without a screen: view, light, smooth shading, outline and floor."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pyvista as pv
import shapely
from shapely.ops import substring

from ..runs import Array
from ..silhouette import silhouette

_VISIBLE = 0.08  # of the bounding box's diagonal: smaller displacements are drawn larger
_VIEW = (0.7, 0.45, 1.0)  # from where the camera looks, y up
PANEL = (480, 520)  # pixels of a picture, at most
_LOWEST = 300  # pixels
_ROOM = (0.94, 0.94)  # of a panel's width and height, left to the body
_CREASE = 40.0  # degrees: sharper edges are not smoothed over
# Where lamps stand as the camera sees it, and how bright they are: key, fill and rim.
_LAMPS = (((2, 4, 4), 0.75), ((-4, -1, 3), 0.4), ((0, 3, -4), 0.3))
# Flat enough for colours to be read.
LOOK = {"ambient": 0.62, "diffuse": 0.45, "specular": 0.05, "specular_power": 12, "smooth_shading": True}
_SUN = np.array([-0.35, -1.0, -0.25])  # direction in which shadows fall
_DASH = 0.025  # of the bounding box's diagonal: a dash of an outline and the gap behind it
_STANDS = 0.25  # of the height: what is constrained below stands on a floor
_SINKS = 0.1  # of the height: what sinks deeper does not


def surface_of(X: Array, F: Array) -> pv.PolyData:
    """A pyvista mesh of the triangles F over the points X."""
    return pv.PolyData.from_regular_faces(X, F)


def magnification(X: Array, u: Array) -> float:
    """Round factor by which a displacement is enlarged in a picture: 1 where it can be seen as it is."""
    wanted = _VISIBLE * np.linalg.norm(np.ptp(X, axis=0)) / np.linalg.norm(u, axis=1).max()
    if wanted <= 1:
        return 1.0
    power = 10 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1, 2, 5) if step * power <= wanted))


def view_axes() -> Array:
    """Rows: to the right, up and towards the camera."""
    towards = np.array(_VIEW) / np.linalg.norm(_VIEW)
    right = np.cross((0, 1, 0), towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def seen_size(points: Array) -> tuple[float, float]:
    """Width and height (m) of the points as the camera sees them."""
    width, height, _ = np.ptp(points @ view_axes().T, axis=0)
    return float(width), float(height)


def panel_of(points: Array) -> tuple[int, int]:
    """Pixels of a picture that the points fill, of the full width."""
    width, height = seen_size(points)
    return PANEL[0], int(np.clip(PANEL[0] * height / width, _LOWEST, PANEL[1]))


def aim(
    camera: pv.Camera, points: Array, panel: tuple[int, int] = PANEL, room: tuple[float, float] = _ROOM
) -> None:
    """Parallel view along _VIEW in which all points fill that share of the panel's (pixels) width or height."""
    axes = view_axes()
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height, depth = high - low
    camera.parallel_projection = True
    camera.parallel_scale = max(height / room[1], width / room[0] * panel[1] / panel[0]) / 2
    camera.focal_point = (low + high) / 2 @ axes
    camera.position = camera.focal_point + 4 * (depth + camera.parallel_scale) * axes[2]
    camera.up = (0, 1, 0)
    camera.clipping_range = (1e-3 * camera.parallel_scale, 20 * (depth + camera.parallel_scale))


def light(plotter: pv.Plotter) -> None:
    """Puts up the lamps, the same for every picture."""
    for position, intensity in _LAMPS:
        plotter.add_light(pv.Light(position=position, intensity=intensity, light_type="camera light"))


def stage(panel: tuple[int, int], is_smooth: bool = True) -> pv.Plotter:
    """An empty lit picture on white. is_smooth: edges are, which takes several times as long."""
    plotter = pv.Plotter(off_screen=True, window_size=list(panel), lighting="none")
    plotter.set_background("white")
    light(plotter)
    if is_smooth:
        plotter.enable_anti_aliasing("ssaa")
    return plotter


@dataclass(frozen=True)
class Skin:
    """A surface whose points are split along creases, so that it is shaded smoothly between them."""

    mesh: pv.PolyData
    ids: Array  #: of the surface's vertex at each point of the mesh

    def move(self, points: Array) -> None:
        """points: of the surface's vertices (n, 3)."""
        self.mesh.points = points[self.ids]
        self.mesh.compute_normals(
            cell_normals=False, split_vertices=False, consistent_normals=False, inplace=True
        )


def skin_of(X: Array, F: Array) -> Skin:
    """Creases are those at rest, so that a body's folds stay smooth."""
    mesh = surface_of(X, F)
    mesh["id"] = np.arange(len(X))
    mesh = mesh.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=_CREASE, consistent_normals=False
    )
    return Skin(mesh, np.asarray(mesh["id"]))


def outline_of(X: Array, F: Array) -> pv.PolyData:
    """The border of what a body covers as the camera sees it, in dashes before all else.

    The view is parallel, so that lines moved towards the camera look the same, and nothing covers them. Dashes without
    creases and hidden edges are not taken for cracks of the body on which they lie.
    """
    axes = view_axes()
    size = float(np.linalg.norm(np.ptp(X, axis=0)))
    nearest = (X @ axes[2]).max() + 2 * size
    lines = []
    for ring in shapely.get_parts(shapely.boundary(silhouette(X, F, axes))):
        n = max(3, round(ring.length / (_DASH * size)))
        for start in np.arange(n) / n:
            flat = shapely.get_coordinates(substring(ring, start, start + 0.5 / n, normalized=True))
            lines.append(np.column_stack([flat, np.full(len(flat), nearest)]) @ axes)
    cells = np.cumsum([0, *map(len, lines)])
    joined = [np.r_[end - start, start:end] for start, end in itertools.pairwise(cells)]
    return pv.PolyData(np.vstack(lines), lines=np.concatenate(joined))


def add_outline(plotter: pv.Plotter, X: Array, F: Array) -> None:
    plotter.add_mesh(outline_of(X, F), color="#30343a", line_width=2, lighting=False)


def tiles(middle: Array, normal: Array, size: float) -> pv.PolyData:
    """A square floor of that size (m), in grey tiles of a round length, coloured by "tile"."""
    n = int(np.ceil(size / round_length(size / 9)))
    side = n * round_length(size / 9)
    plane = pv.Plane(
        center=middle, direction=normal, i_size=side, j_size=side, i_resolution=n, j_resolution=n
    )
    cells = np.arange(n * n)
    is_dark = (cells + (cells // n if n % 2 == 0 else 0)) % 2 == 1
    plane["tile"] = np.where(is_dark[:, None], (226, 228, 232), (240, 241, 243)).astype(np.uint8)
    return plane


@dataclass(frozen=True)
class Floor:
    """What a body stands on: the plane y = height, drawn below a box of the points that are shown."""

    height: float
    low: Array
    high: Array

    def add_to(self, plotter: pv.Plotter) -> None:
        middle = (self.low + self.high) / 2
        middle[1] = self.height
        size = 1.5 * float((self.high - self.low)[[0, 2]].max())
        plotter.add_mesh(
            tiles(middle, np.array([0.0, 1.0, 0.0]), size), scalars="tile", rgb=True, lighting=False
        )

    def shadow_of(self, points: Array) -> Array:
        """Where the points' shadows fall."""
        down = (self.height - points[:, 1]) / _SUN[1]
        shadow = points + down[:, None] * _SUN
        shadow[:, 1] = self.height + 1e-3 * float(np.ptp([self.low, self.high]))
        return shadow


def round_length(wanted: float) -> float:
    """1, 2 or 5 times a power of ten, at most what is wanted."""
    power = 10 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def floor_of(X: Array, u: Array, shown: Array) -> Floor | None:
    """The floor of a body constrained at its bottom, which is where it does not move at all; None for others.

    shown: points that the picture holds; none of them may lie below the floor by much.
    """
    lengths = np.linalg.norm(u, axis=1)
    constrained = X[lengths <= 1e-12 * lengths.max()]
    low, high = X[:, 1].min(), X[:, 1].max()
    is_constrained_low = len(constrained) > 2 and constrained[:, 1].max() <= low + _STANDS * (high - low)
    if not is_constrained_low or shown[:, 1].min() < low - _SINKS * (high - low):
        return None
    return Floor(float(low), shown.min(axis=0), shown.max(axis=0))
