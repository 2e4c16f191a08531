"""Numbers that say how far two runs of a scene differ."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .runs import Array, Frame, Run, RunError, scene_of
from .small_strain import deformation_of
from .surface_points import on_points_of

# Parts of a scene that must be the same in both runs.
_LOAD_CASE = ("gravity", "material", "supports", "loads", "initial")
_SAME_TIME = 1e-9  # of the run's length
# Of what parts of the surface do: a volume or an area that changes less in all is kept. Bending far stretches the surface
# in all by a thirtieth of what it stretches and shrinks, which is of second order.
_KEPT_VOLUME, _KEPT_AREA = 0.01, 0.05


class DisplacementError(NamedTuple):
    """Difference of two displacement fields over the root mean square of the reference's: l2 is never above max.

    Means are over the area and, of motions, over the time.
    """

    l2: float  #: root mean square: the L2 norm over the reference's L2 norm
    max: float  #: largest length


class ChangeError(NamedTuple):
    """Difference of two curves of a volume or an area, each as its change over the value at rest."""

    relative: float  #: L2 over the curve of the difference, over that of the reference's change
    absolute: float  #: largest difference


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


#: Whether a body moves freely as a whole, so that its rigid motion means nothing; or those motions that supports leave free,
#: (m, 6): translation (m) and turn (rad) about the origin.
Free = bool | Array


def free_motions(record: dict[str, Any]) -> Free:
    """By what run.json holds: of a static body those that supports leave free, where nothing else holds it."""
    motions = record.get("free_motions") if record.get("is_free") else None
    return np.array(motions) if motions else False


def free_motions_of(scene: dict[str, Any], records: Iterable[dict[str, Any]]) -> Free:
    """Of a body that programs have run, by the first of their records that knows. Obstacles may let go of it: they hold none."""
    if not (scene.get("supports") or scene.get("handles")):
        return True
    return next((free for record in records if (free := free_motions(record)) is not False), False)


def remove_rigid_motion(X: Array, u: Array, weights: Array, motions: Free = True) -> Array:
    """u less the small rigid motion nearest to it in the weighted least-squares sense, of all or of some motions."""
    centre = np.average(X, axis=0, weights=weights)
    Y = X - centre
    if isinstance(motions, bool):
        # Both parts scaled alike, so that the size of the body does not matter to lstsq's rank decision.
        shifts, turns = np.eye(6, 3), np.eye(6, 3, -3) / np.abs(Y).max()
    else:
        shifts, turns = motions[:, :3] + np.cross(motions[:, 3:], centre), motions[:, 3:]
    rigid = (shifts[:, None, :] + np.cross(turns[:, None, :], Y)).reshape(len(shifts), -1).T
    root = np.repeat(np.sqrt(weights), 3)
    motion, *_ = np.linalg.lstsq(rigid * root[:, None], u.ravel() * root, rcond=None)
    return u - (rigid @ motion).reshape(-1, 3)


def deformation(frame: Frame, is_free: Free) -> Array:
    """The displacement (n, 3), of a free body less the rigid motion, which means nothing there."""
    if is_free is False:
        return frame.u
    return remove_rigid_motion(frame.X, frame.u, vertex_areas(frame.X, frame.F), is_free)


def displacement_error(X: Array, F: Array, u: Array, u_reference: Array, is_free: Free) -> DisplacementError:
    """Relative difference of two surface displacements (n, 3) over the rest surface X, F.

    is_free: rigid motion that means nothing is removed from both.
    """
    pair = (deformation(Frame(X, field, F), is_free) for field in (u, u_reference))
    return _error_of(np.zeros(1), [tuple(pair)], vertex_areas(X, F))


def _error_of(times: Array, pairs: Sequence[tuple[Array, ...]], weights: Array) -> DisplacementError:
    """pairs: displacement and that of the reference at each time."""
    squares = np.array([[((u - v) ** 2).sum(axis=1), (v**2).sum(axis=1)] for u, v in pairs])
    means = _mean_over(times, squares @ weights / weights.sum())
    if not means[1] > 0:
        raise RunError("the reference does not deform, so there is nothing to compare with")
    return DisplacementError(*(float(np.sqrt(part / means[1])) for part in (means[0], squares[:, 0].max())))


def _mean_over(times: Array, values: Array) -> Array:
    """By the trapezoidal rule; of a single moment, what it is."""
    return values[0] if len(times) == 1 else np.trapezoid(values, times, axis=0) / (times[-1] - times[0])


def change_error(times: Array, change: Array, times_ref: Array, change_ref: Array) -> ChangeError:
    """Difference of two curves over the reference's times, the first linearly interpolated to them.

    change: of a volume or an area, over its value at rest.
    """
    difference = np.interp(times_ref, times, change) - change_ref
    squares = _mean_over(times_ref, np.stack([difference, change_ref], axis=1) ** 2)
    relative = np.sqrt(squares[0] / squares[1]) if squares[1] > 0 else np.nan
    return ChangeError(float(relative), float(np.abs(difference).max()))


def volume_change(run: Run) -> tuple[Array, Array]:
    """Times and dV/V0 of a run's volume curve."""
    return run.curves["time"], run.curves["volume"] / volume(run.last.X, run.last.F) - 1


def area_change(run: Run) -> tuple[Array, Array]:
    """Times and dA/A0 of a run's curve of surface area."""
    return run.curves["time"], run.curves["area"] / vertex_areas(run.last.X, run.last.F).sum() - 1


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


def trajectory_error(run: Run, reference: Run, is_free: Free = False) -> DisplacementError:
    """Relative difference of two motions, over surface and time.

    The run's frames are interpolated linearly to the reference's times, which is exact where both have the same.
    is_free: rigid motion is removed from both at every time. Raises RunError for different surfaces or lengths.
    """
    run = on_same_problem(run, reference)
    X, F = reference.last.X, reference.last.F
    pairs = [
        tuple(
            deformation(Frame(X, u, F), is_free)
            for u in (displacement_at(run, time), reference.frame(index).u)
        )
        for index, time in enumerate(reference.times)
    ]
    return _error_of(reference.times, pairs, vertex_areas(X, F))


def root_mean_square(reference: Run, is_free: Free, time: float) -> float:
    """Length (m) that errors are relative to: of the reference's displacement over its surface at a time, of a motion over it
    all."""
    X, F = reference.last.X, reference.last.F
    is_moving = is_dynamic(reference)
    fields = (
        [reference.frame(k).u for k in range(len(reference.times))]
        if is_moving
        else [displacement_at(reference, time)]
    )
    squares = np.array([(deformation(Frame(X, u, F), is_free) ** 2).sum(axis=1) for u in fields])
    means = np.average(squares, axis=1, weights=vertex_areas(X, F))
    return float(np.sqrt(_mean_over(reference.times if is_moving else np.zeros(1), means)))


@dataclass(frozen=True)
class Tip:
    """The vertex that the reference moves farthest, and the direction in which it does."""

    vertex: int
    direction: Array
    time: float  #: of the reference's frame where it does

    def curve(self, run: Run, is_free: Free) -> tuple[Array, Array]:
        """Times of a run's frames, and how far its tip has moved in that direction (m)."""
        moved = [
            deformation(run.frame(k), is_free)[self.vertex] @ self.direction for k in range(len(run.times))
        ]
        return run.times, np.array(moved)


def tip_of(reference: Run, is_free: Free) -> Tip:
    """Of a motion, where it is widest; else at its end."""
    index = reference.widest if is_dynamic(reference) else len(reference.times) - 1
    u = deformation(reference.frame(index), is_free)
    lengths = np.linalg.norm(u, axis=1)
    vertex = int(lengths.argmax())
    return Tip(vertex, u[vertex] / max(lengths[vertex], 1e-300), float(reference.times[index]))


def is_dynamic(run: Run) -> bool:
    """Whether the run is a motion in time of which there is more than the end."""
    return scene_of(run).get("time", {}).get("mode") == "dynamic" and len(run.times) > 1


def on_same_problem(run: Run, reference: Run) -> Run:
    """The run at the vertices of the reference's surface.

    Raises RunError unless both are of the same load case and surface, however cut, and end at the same time. One that has
    stopped on its way may end earlier.
    """
    here, there = scene_of(run), scene_of(reference)
    for key in _LOAD_CASE if here and there else ():
        if here.get(key) != there.get(key):
            raise RunError(
                f"{run.folder}: the scene's {key} is {here.get(key)}, expected {there.get(key)} as in {reference.folder}"
            )
    t, t_reference = run.times[-1], reference.times[-1]
    is_whole = not (run.stopped or reference.stopped)
    if is_whole and abs(t - t_reference) > _SAME_TIME * max(abs(t_reference), 1e-300):
        raise RunError(
            f"{run.folder}: last frame is at time {t:g}, expected {t_reference:g} as in {reference.folder}"
        )
    return on_points_of(run, reference)


@dataclass(frozen=True)
class ModelComparison:
    """One spring model against the reference, as it stands in comparison.json."""

    status: str
    reached: float  #: load factor or time (s) up to which both are compared
    displacement_error_l2: float
    displacement_error_max: float
    volume_change_error: float  #: NaN where the reference keeps its volume
    volume_change_difference: float
    area_change_error: float  #: NaN where the reference keeps its area
    tip_displacement: float  #: m, where the reference's tip is farthest; NaN: not reached
    is_linear: bool  #: in the displacement, as a reference of small strain is
    n_nodes: int
    n_springs: int | None  #: independent ones that pull; None: the run does not say
    n_patches: int | None  #: of coupled springs
    diagnostics: (
        dict[str, float] | None
    )  #: errors and compliances against exact fields, where they were measured
    n_floppy_motions: int | None
    floppy_load_share: float | None
    least_jacobian: float | None  #: smallest det F of any tetrahedron on the way
    estimated_error: float | None  #: by the springs themselves, relative in the L2 norm
    seconds: dict[str, float]
    has_waited: bool  #: for a core or a disk, so that its seconds tell nothing
    displacement_error_finest: float | None = (
        None  #: likewise, by the finest reference; None: there is one alone
    )
    surface_distance: float | None = (
        None  #: mean, at the end, relative as displacement errors are; None: vertices tell enough
    )


@dataclass(frozen=True)
class ModelSummary:
    """A spring model that has no reference to be compared with."""

    status: str
    n_nodes: int
    n_springs: int | None
    n_patches: int | None
    volume_change: float
    largest_displacement: float  #: m
    kinetic_energy_left: float  #: at the end, of its largest
    seconds: dict[str, float]
    has_waited: bool


@dataclass(frozen=True)
class ReferenceSummary:
    """How much the reference moves, a dynamic one at its widest: what the relative errors are relative to."""

    n_points: int  #: vertices of the surface as it was cut, at which displacements are compared
    n_cut: int  #: of these, those that the surface's file does not have
    n_nodes: int
    n_dofs: int
    stopped: str  #: why it ended on its way; "": it did not
    reached: float  #: load factor or time (s) of its end
    largest_displacement: float  #: m, of the tip, of a free body without rigid motion
    largest_volume_change: float
    swept_volume: float  #: by the surface, of the volume at rest
    keeps_volume: bool  #: changes it by less than a hundredth of what the surface sweeps, as in bending
    keeps_area: bool  #: changes it by less than a twentieth of what its triangles do, taken without sign
    rotation: float  #: rad, of all but a twentieth of the surface at most
    strain: float  #: along the surface, of the same part
    largest_strain: float | None  #: anywhere within the body
    least_jacobian: float | None  #: smallest det F at any node of an element on the way
    law_error: float | None  #: estimated, of the displacement, for being of small strain; None: it is not
    seconds: dict[str, float]
    has_waited: bool
    estimated_error_l2: float | None = None  #: of the displacement, by its mesh; None: not estimated
    n_refinements: int = 0  #: of the reference as the scene has it
    unrefined_seconds: dict[str, float] | None = None  #: of that
    unrefined_has_waited: bool = False
    unrefined_error: float | None = None  #: of that, by the finest


def compare_runs(run: Run, reference: Run, is_free: Free) -> ModelComparison:
    """The figures of a run against the reference; displacements at the end, of a dynamic scene over the whole time.

    The end is the last moment that both have reached. is_free: as in displacement_error. Raises RunError where the two
    are not of the same problem.
    """
    run = on_same_problem(run, reference)
    X, F = reference.last.X, reference.last.F
    end = min(run.times[-1], reference.times[-1])
    displacement = (
        trajectory_error(run, reference, is_free)
        if is_dynamic(reference)
        else displacement_error(X, F, displacement_at(run, end), displacement_at(reference, end), is_free)
    )
    of_volume = _error_until(end, volume_change(run), volume_change(reference))
    of_area = _error_until(end, area_change(run), area_change(reference))
    tip = tip_of(reference, is_free)
    tip_displacement = np.nan
    if tip.time <= end * (1 + _SAME_TIME):
        moved = deformation(Frame(X, displacement_at(run, tip.time), F), is_free)
        tip_displacement = moved[tip.vertex] @ tip.direction
    record = run.record
    return ModelComparison(
        status=run.stopped or record["status"],
        reached=float(end),
        displacement_error_l2=displacement.l2,
        displacement_error_max=displacement.max,
        volume_change_error=np.nan if keeps_volume(reference) else of_volume.relative,
        volume_change_difference=of_volume.absolute,
        area_change_error=np.nan if keeps_area(reference) else of_area.relative,
        tip_displacement=float(tip_displacement),
        is_linear=record.get("geometry") == "linear",
        n_nodes=record["n_nodes"],
        n_springs=record.get("n_springs"),
        n_patches=record.get("n_patches"),
        diagnostics=record.get("diagnostics"),
        n_floppy_motions=record.get("n_floppy_motions"),
        floppy_load_share=record.get("floppy_load_share"),
        least_jacobian=record.get("min_J_nodes"),
        estimated_error=record.get("estimated_error"),
        seconds=record["seconds"],
        has_waited=run.has_waited,
    )


def _error_until(end: float, curve: tuple[Array, Array], reference: tuple[Array, Array]) -> ChangeError:
    times, change = reference
    is_before = times <= end * (1 + _SAME_TIME)
    return change_error(*curve, times[is_before], change[is_before])


def describe_alone(run: Run) -> ModelSummary:
    """The figures of a spring model that has no reference to be compared with."""
    kinetic = run.curves["kinetic_energy"]
    return ModelSummary(
        status=run.record["status"],
        n_nodes=run.record["n_nodes"],
        n_springs=run.record.get("n_springs"),
        n_patches=run.record.get("n_patches"),
        volume_change=float(volume_change(run)[1][-1]),
        largest_displacement=float(np.linalg.norm(run.last.u, axis=1).max()),
        kinetic_energy_left=float(kinetic[-1] / kinetic.max()) if kinetic.max() > 0 else 0.0,
        seconds=run.record["seconds"],
        has_waited=run.has_waited,
    )


def describe_reference(
    reference: Run, is_free: Free = False, estimated_error: float | None = None
) -> ReferenceSummary:
    """The figures of the reference; estimated_error: of its displacement, relative in the L2 norm, where it is known."""
    frame, scene = _widest_frame(reference), scene_of(reference)
    tip = tip_of(reference, is_free)
    bent = deformation_of(frame.X, frame.F, deformation(frame, is_free))
    strains = reference.curves.get("max_strain")
    return ReferenceSummary(
        n_points=len(frame.X),
        n_cut=reference.record.get("n_cut", 0),
        n_nodes=reference.record["n_nodes"],
        n_dofs=reference.record["n_dofs"],
        stopped=reference.stopped,
        reached=float(reference.times[-1]),
        largest_displacement=float(np.linalg.norm(deformation(frame, is_free)[tip.vertex])),
        largest_volume_change=_largest(volume_change(reference)),
        swept_volume=swept_volume(frame),
        keeps_volume=keeps_volume(reference),
        keeps_area=keeps_area(reference),
        rotation=bent.rotation,
        strain=bent.strain,
        largest_strain=None if strains is None else float(strains.max()),
        least_jacobian=reference.record.get("min_J_nodes"),
        law_error=bent.error("collapse" in scene) if reference.record.get("law") == "small_strain" else None,
        seconds=reference.record["seconds"],
        has_waited=reference.has_waited,
        estimated_error_l2=estimated_error,
    )


def _widest_frame(run: Run) -> Frame:
    return run.frame(run.widest) if is_dynamic(run) else run.last


def _largest(curve: tuple[Array, Array]) -> float:
    return float(np.abs(curve[1]).max())


def swept_volume(frame: Frame) -> float:
    """What the surface passes through, outwards and inwards alike, of the volume at rest."""
    swept = np.abs((triangle_normals(frame.X, frame.F) * frame.u[frame.F].mean(axis=1)).sum(axis=1)).sum()
    return float(swept / volume(frame.X, frame.F))


def keeps_volume(run: Run) -> bool:
    """Whether it changes by less than a hundredth of what the surface sweeps: bending, torsion."""
    return _largest(volume_change(run)) <= _KEPT_VOLUME * swept_volume(_widest_frame(run))


def keeps_area(run: Run) -> bool:
    """Whether it changes by less than a twentieth of what the areas of the triangles change by."""
    frame = _widest_frame(run)
    before, after = (
        np.linalg.norm(triangle_normals(points, frame.F), axis=1) for points in (frame.X, frame.X + frame.u)
    )
    return _largest(area_change(run)) <= _KEPT_AREA * float(np.abs(after - before).sum() / before.sum())
