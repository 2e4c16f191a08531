"""Numbers that say how far two runs of a scene differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .runs import Array, Run, RunError, scene_of

# Both solvers keep the surface bit for bit, but a frame stores X + u and u, so that X comes back rounded.
_SAME_POINT = 1e-12  # of the bounding box
_LOAD_CASE = ("gravity", "material", "supports", "loads")  # of a scene: must be the same in both runs
_SAME_TIME = 1e-9  # of the run's length


class DisplacementError(NamedTuple):
    """Difference of two displacement fields as fractions of the reference's own size."""

    l2: float  #: area-weighted L2 norm over area-weighted L2 norm
    max: float  #: largest length over largest length


class VolumeError(NamedTuple):
    """Difference of two volume curves."""

    relative: float  #: L2 over the curve of the difference in dV/V0, over that of the reference's dV/V0
    absolute: float  #: largest difference in dV/V0


def triangle_normals(X: Array, F: Array) -> Array:
    """Outward normals (m, 3) as long as the triangles' areas (m2)."""
    a, b, c = (X[F[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def volume(X: Array, F: Array) -> float:
    """Enclosed volume (m3) by the divergence theorem about the centroid [paper 3.3]."""
    Y = X - X.mean(axis=0)
    return float((Y[F].mean(axis=1) * triangle_normals(Y, F)).sum() / 3)


def vertex_areas(X: Array, F: Array) -> Array:
    """A third of the area of its triangles, for each vertex (m2)."""
    areas = np.linalg.norm(triangle_normals(X, F), axis=1)
    return np.bincount(F.ravel(), weights=np.repeat(areas / 3, 3), minlength=len(X))


def remove_rigid_motion(X: Array, u: Array, weights: Array) -> Array:
    """u less the small rigid motion a + w x (X - c) nearest to it in the weighted least-squares sense."""
    Y = X - np.average(X, axis=0, weights=weights)
    translation = np.tile(np.eye(3), (len(X), 1))
    rotation = np.cross(np.eye(3)[None, :, :], Y[:, None, :]).transpose(0, 2, 1).reshape(-1, 3)
    # Both parts scaled alike, so that the size of the body does not matter to lstsq's rank decision.
    rigid = np.hstack([translation, rotation / np.abs(Y).max()])
    root = np.repeat(np.sqrt(weights), 3)
    motion, *_ = np.linalg.lstsq(rigid * root[:, None], u.ravel() * root, rcond=None)
    return u - (rigid @ motion).reshape(-1, 3)


def displacement_error(X: Array, F: Array, u: Array, u_reference: Array, is_free: bool) -> DisplacementError:
    """Relative difference of two surface displacements (n, 3) over the rest surface X, F.

    is_free: the body has no supports, so a rigid motion means nothing and is removed from both.
    """
    weights = vertex_areas(X, F)
    if is_free:
        u = remove_rigid_motion(X, u, weights)
        u_reference = remove_rigid_motion(X, u_reference, weights)
    squares = ((u - u_reference) ** 2).sum(axis=1)
    squares_reference = (u_reference**2).sum(axis=1)
    if not squares_reference.max() > 0:
        raise RunError("the reference does not deform, so there is nothing to compare with")
    return DisplacementError(
        float(np.sqrt(weights @ squares / (weights @ squares_reference))),
        float(np.sqrt(squares.max() / squares_reference.max())),
    )


def volume_error(times: Array, change: Array, times_ref: Array, change_ref: Array) -> VolumeError:
    """Difference of two curves dV/V0 over the reference's times, the first linearly interpolated to them."""
    difference = np.interp(times_ref, times, change) - change_ref
    norm = _curve_norm(times_ref, change_ref)
    relative = _curve_norm(times_ref, difference) / norm if norm > 0 else float("nan")
    return VolumeError(relative, float(np.abs(difference).max()))


def _curve_norm(times: Array, values: Array) -> float:
    if len(times) == 1:
        return float(abs(values[0]))
    return float(np.sqrt(np.trapezoid(values**2, times)))


def volume_change(run: Run) -> tuple[Array, Array]:
    """Times and dV/V0 of a run's volume curve."""
    V0 = volume(run.last.X, run.last.F)
    return run.curves["time"], run.curves["volume"] / V0 - 1


def displacement_at(run: Run, time: float) -> Array:
    """Surface displacement (n, 3) at a time, linear between frames. Raises RunError for a time outside of them."""
    slack = _SAME_TIME * abs(run.times[-1] - run.times[0])
    if not run.times[0] - slack <= time <= run.times[-1] + slack:
        raise RunError(
            f"{run.folder}: no frame at time {time:g}, expected {run.times[0]:g} to {run.times[-1]:g}"
        )
    after = min(int(np.searchsorted(run.times, time - slack)), len(run.times) - 1)
    if abs(run.times[after] - time) <= slack:
        return run.frame(after).u
    share = (time - run.times[after - 1]) / (run.times[after] - run.times[after - 1])
    return (1 - share) * run.frame(after - 1).u + share * run.frame(after).u


def trajectory_error(run: Run, reference: Run, is_free: bool = False) -> DisplacementError:
    """Relative difference of two motions: as displacement_error, the L2 norm over surface and time.

    The run's frames are interpolated linearly to the reference's times, which is exact where both have the same.
    is_free: rigid motion is removed from both at every time. Raises RunError for different surfaces or lengths.
    """
    check_same_problem(run, reference)
    X = reference.last.X
    weights = vertex_areas(X, reference.last.F)
    squares, largest = [], []
    for index, time in enumerate(reference.times):
        u, u_reference = displacement_at(run, time), reference.frame(index).u
        if is_free:
            u, u_reference = (remove_rigid_motion(X, field, weights) for field in (u, u_reference))
        both = [(field**2).sum(axis=1) for field in (u - u_reference, u_reference)]
        squares.append([weights @ square for square in both])
        largest.append([square.max() for square in both])
    norms = np.trapezoid(np.array(squares), reference.times, axis=0)
    if not norms[1] > 0:
        raise RunError("the reference does not deform, so there is nothing to compare with")
    top = np.max(largest, axis=0)
    return DisplacementError(float(np.sqrt(norms[0] / norms[1])), float(np.sqrt(top[0] / top[1])))


def widest(run: Run) -> int:
    """Number of the frame with the largest displacement."""
    return int(np.argmax([np.linalg.norm(run.frame(k).u, axis=1).max() for k in range(len(run.times))]))


def is_dynamic(run: Run) -> bool:
    """Whether the run is a motion in time of which there is more than the end."""
    return scene_of(run).get("time", {}).get("mode") == "dynamic" and len(run.times) > 1


def check_same_problem(run: Run, reference: Run) -> None:
    """Raises RunError unless both runs are of the same load case and surface, vertex by vertex, and end at the same time."""
    here, there = scene_of(run), scene_of(reference)
    for key in _LOAD_CASE if here and there else ():
        if here.get(key) != there.get(key):
            raise RunError(
                f"{run.folder}: the scene's {key} is {here.get(key)}, expected {there.get(key)} as in {reference.folder}"
            )
    a, b = run.last, reference.last
    if len(a.X) != len(b.X) or a.F.shape != b.F.shape or (a.F != b.F).any():
        raise RunError(
            f"{run.folder} and {reference.folder} are of different surfaces: "
            f"{len(a.X)} nodes, {len(a.F)} triangles against {len(b.X)} nodes, {len(b.F)} triangles"
        )
    tolerance = _SAME_POINT * np.ptp(b.X, axis=0).max() + 4 * np.finfo(float).eps * np.abs(b.X).max()
    distances = np.abs(a.X - b.X).max(axis=1)
    if distances.max() > tolerance:
        worst = int(distances.argmax())
        raise RunError(
            f"{run.folder} and {reference.folder} are of different surfaces: "
            f"vertex {worst} lies {distances[worst]:.3g} m apart"
        )
    t, t_reference = run.times[-1], reference.times[-1]
    if abs(t - t_reference) > _SAME_TIME * max(abs(t_reference), 1e-300):
        raise RunError(
            f"{run.folder}: last frame is at time {t:g}, expected {t_reference:g} as in {reference.folder}"
        )


@dataclass(frozen=True)
class Figures:
    """One spring model against the reference, as it stands in comparison.json."""

    status: str
    displacement_error_l2: float
    displacement_error_max: float
    volume_change_error: float  #: NaN where the reference keeps its volume
    volume_change_difference: float
    n_nodes: int
    n_springs: int | None  #: independent ones that pull; None: the run does not say
    n_patches: int | None  #: of coupled springs
    diagnostics: (
        dict[str, float] | None
    )  #: errors and compliances against exact fields, where they were measured
    n_floppy_motions: int | None
    floppy_load_share: float | None
    seconds: dict[str, float]


@dataclass(frozen=True)
class FiguresAlone:
    """A spring model that has no reference to be compared with."""

    status: str
    n_nodes: int
    n_springs: int | None
    n_patches: int | None
    volume_change: float
    largest_displacement: float  #: m
    kinetic_energy_left: float  #: at the end, of its largest
    seconds: dict[str, float]


@dataclass(frozen=True)
class ReferenceFigures:
    """How much the reference moves, a dynamic one at its widest: what the relative errors are relative to."""

    n_nodes: int
    n_dofs: int
    largest_displacement: float  #: m
    largest_volume_change: float
    swept_volume: float  #: by the surface, of the volume at rest
    seconds: dict[str, float]
    estimated_error_l2: float | None = None  #: of the displacement; None: not estimated


def compare_runs(run: Run, reference: Run, is_free: bool) -> Figures:
    """The figures of a run against the reference; displacements at the end, of a dynamic scene over the whole time.

    is_free: as in displacement_error. Raises RunError where the two are not of the same problem.
    """
    check_same_problem(run, reference)
    a, b = run.last, reference.last
    displacement = (
        trajectory_error(run, reference, is_free)
        if is_dynamic(reference)
        else displacement_error(b.X, b.F, a.u, b.u, is_free)
    )
    change = volume_error(*volume_change(run), *volume_change(reference))
    record = run.record
    return Figures(
        status=record["status"],
        displacement_error_l2=displacement.l2,
        displacement_error_max=displacement.max,
        volume_change_error=change.relative,
        volume_change_difference=change.absolute,
        n_nodes=record["n_nodes"],
        n_springs=record.get("n_springs"),
        n_patches=record.get("n_patches"),
        diagnostics=record.get("diagnostics"),
        n_floppy_motions=record.get("n_floppy_motions"),
        floppy_load_share=record.get("floppy_load_share"),
        seconds=record["seconds"],
    )


def describe_alone(run: Run) -> FiguresAlone:
    """The figures of a spring model that has no reference to be compared with."""
    kinetic = run.curves["kinetic_energy"]
    return FiguresAlone(
        status=run.record["status"],
        n_nodes=run.record["n_nodes"],
        n_springs=run.record.get("n_springs"),
        n_patches=run.record.get("n_patches"),
        volume_change=float(volume_change(run)[1][-1]),
        largest_displacement=float(np.linalg.norm(run.last.u, axis=1).max()),
        kinetic_energy_left=float(kinetic[-1] / kinetic.max()) if kinetic.max() > 0 else 0.0,
        seconds=run.record["seconds"],
    )


def describe_reference(reference: Run, estimated_error: float | None = None) -> ReferenceFigures:
    """The figures of the reference; estimated_error: of its displacement, relative in the L2 norm, where it is known."""
    frame = reference.frame(widest(reference)) if is_dynamic(reference) else reference.last
    V0 = volume(frame.X, frame.F)
    swept = np.abs((triangle_normals(frame.X, frame.F) * frame.u[frame.F].mean(axis=1)).sum(axis=1)).sum()
    return ReferenceFigures(
        n_nodes=reference.record["n_nodes"],
        n_dofs=reference.record["n_dofs"],
        largest_displacement=float(np.linalg.norm(frame.u, axis=1).max()),
        largest_volume_change=float(np.abs(volume_change(reference)[1]).max()),
        swept_volume=float(swept / V0),
        seconds=reference.record["seconds"],
        estimated_error_l2=estimated_error,
    )
