"""Error norms on fields and runs whose errors are known in closed form."""

from dataclasses import asdict

import numpy as np
import pytest
import pyvista as pv
from synthetic import write_run

from analysis import compare
from analysis.compare import (
    change_error,
    compare_runs,
    describe_alone,
    describe_reference,
    displacement_at,
    displacement_error,
    free_motions,
    free_motions_of,
    remove_rigid_motion,
    tip_of,
    trajectory_error,
    vertex_areas,
    volume,
)
from analysis.comparison import relative_distance
from analysis.runs import RunError, load_run

ROUNDING = 1e-12  # a few hundred operations on numbers of order one


def rigid_motion(X):
    return np.array([0.3, -0.2, 0.5]) + np.cross([0.1, 0.2, -0.3], X)


@pytest.fixture
def cube():
    """Of edge 2, a corner at the origin."""
    X = np.array([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return X, np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])


@pytest.fixture
def uneven(ball):
    """A long body whose triangles differ in area by a factor of a hundred."""
    X = ball[0] * [3, 1, 0.4]
    return X + np.array([0.3, 0, 0]) * X[:, :1] ** 2, ball[1]


def surface_integral(X, F, values):
    """Triangle by triangle, of area by Heron's formula and the mean of its corners' values."""
    total = 0
    for corners in F:
        a, b, c = (np.linalg.norm(X[corners[k]] - X[corners[k - 1]]) for k in range(3))
        s = (a + b + c) / 2
        total += np.sqrt(s * (s - a) * (s - b) * (s - c)) * np.mean([values[k] for k in corners], axis=0)
    return total


def trapezium(times, values):
    return sum(
        (t - s) * (a + b) / 2 for s, t, a, b in zip(times, times[1:], values, values[1:], strict=False)
    )


def test_volume_of_a_cube_far_from_the_origin(cube):
    X, F = cube[0] + 1000, cube[1]
    assert volume(X, F) == pytest.approx(8, rel=ROUNDING)
    assert vertex_areas(X, F).sum() == pytest.approx(24, rel=ROUNDING)


def test_a_tenth_too_much_everywhere_is_an_error_of_a_tenth(ball):
    X, F = ball
    u = X * [1, 2, 3]
    error = displacement_error(X, F, 1.1 * u, u, is_free=False)
    assert error.l2 == pytest.approx(0.1, rel=ROUNDING)
    # Where the body moves most, by the square of which the rest is averaged.
    mean = np.sqrt(surface_integral(X, F, (u**2).sum(axis=1)) / surface_integral(X, F, np.ones(len(X))))
    assert error.max == pytest.approx(0.1 * np.linalg.norm(u, axis=1).max() / mean, rel=ROUNDING)


def test_worst_is_never_below_the_mean(uneven):
    X, F = uneven
    for u in (X * [1, 0, 0], X**2, np.abs(X) + 1):
        error = displacement_error(X, F, u + 0.1, u, is_free=False)  # the same everywhere
        assert error.max == pytest.approx(error.l2, rel=1e3 * ROUNDING)
        error = displacement_error(X, F, u + 0.1 * X, u, is_free=False)
        assert error.max > error.l2


def test_error_at_one_vertex_counts_with_its_area(ball):
    X, F = ball
    u = np.tile([1.0, 0, 0], (len(X), 1))
    wrong = u.copy()
    wrong[7, 1] = 0.5
    areas = vertex_areas(X, F)
    error = displacement_error(X, F, wrong, u, is_free=False)
    assert error.l2 == pytest.approx(0.5 * np.sqrt(areas[7] / areas.sum()), rel=ROUNDING)
    assert error.max == pytest.approx(0.5, rel=ROUNDING)


@pytest.mark.parametrize("size, origin", [(1, 0), (1e-6, 0), (1e3, 1e4)])
def test_rigid_motion_is_removed_whole_at_any_size_and_place(ball, size, origin):
    X = size * ball[0] + origin
    areas = vertex_areas(X, ball[1])
    left = remove_rigid_motion(X, size * rigid_motion(X / size), areas)
    # Coordinates of 1e4 carry that much more rounding than those of 1e3.
    assert np.abs(left).max() < size * ROUNDING * max(1, origin / size) ** 2


def test_removing_rigid_motion_leaves_a_deformation_alone(ball):
    X, F = ball
    u = X * [1, -1, 0]
    assert remove_rigid_motion(X, u + rigid_motion(X), vertex_areas(X, F)) == pytest.approx(u, abs=1e-6)


def test_motions_that_supports_leave_free_are_removed_alone(ball):
    """A turn about a hinge beside a body that is not at the origin; shifts and other turns stay."""
    X, F = ball[0] + [7, -5, 3], ball[1]
    hinge, axis = np.array([6, -5, 3.5]), np.array([0, 0.5, 0])
    motions = np.array([[*np.cross(hinge, axis), *axis]])
    free = np.cross(3 * axis, X - hinge)
    stretch = np.array([0.1, 0, 0]) * (X - X.mean(axis=0))
    left = remove_rigid_motion(X, free + stretch, vertex_areas(X, F), motions)
    assert left == pytest.approx(remove_rigid_motion(X, stretch, vertex_areas(X, F), motions), abs=1e-9)
    assert left == pytest.approx(stretch, abs=0.01)
    shift = remove_rigid_motion(X, np.tile([0, 0.2, 0], (len(X), 1)), vertex_areas(X, F), motions)
    assert shift == pytest.approx(np.tile([0, 0.2, 0], (len(X), 1)), abs=1e-9)
    record = {"is_free": True, "free_motions": motions.tolist()}
    assert displacement_error(X, F, free + stretch, stretch, free_motions(record)).l2 < 1e-6
    for record in ({"is_free": False, "free_motions": motions.tolist()}, {"is_free": True}, {}):
        assert free_motions(record) is False


@pytest.mark.parametrize(
    "scene, is_free",
    [({"supports": [{}]}, False), ({"handles": [{}]}, False), ({"obstacles": [{}]}, True), ({}, True)],
)
def test_handles_hold_a_body_and_obstacles_do_not(scene, is_free):
    assert free_motions_of(scene, []) is is_free


def test_what_is_left_has_no_mean_motion_over_the_surface(uneven):
    """The nearest rigid motion leaves no mean displacement and no mean rotation, both over the area."""
    X, F = uneven
    u = X[:, [1, 2, 0]] ** 2 + rigid_motion(X)
    left = remove_rigid_motion(X, u, vertex_areas(X, F))
    assert surface_integral(X, F, left) == pytest.approx(np.zeros(3), abs=1e3 * ROUNDING)
    assert surface_integral(X, F, np.cross(X, left)) == pytest.approx(np.zeros(3), abs=1e3 * ROUNDING)
    assert np.abs(left.mean(axis=0)).max() > 0.01  # over the vertices it has


def test_error_is_the_surface_integral_of_the_difference(uneven):
    X, F = uneven
    u, u_reference = X * [1.1, 1, 2], X * [1, 1.2, 1]
    squares = surface_integral(X, F, ((u - u_reference) ** 2).sum(axis=1))
    squares_reference = surface_integral(X, F, (u_reference**2).sum(axis=1))
    error = displacement_error(X, F, u, u_reference, is_free=False)
    assert error.l2 == pytest.approx(np.sqrt(squares / squares_reference), rel=ROUNDING)


def test_rigid_motion_counts_where_the_body_is_supported(ball):
    X, F = ball
    u = 0.01 * X
    assert displacement_error(X, F, u + rigid_motion(X), u, is_free=True).l2 < 1e-9
    assert displacement_error(X, F, u + rigid_motion(X), u, is_free=False).l2 > 1


def test_reference_at_rest_is_refused(ball):
    with pytest.raises(RunError, match="does not deform"):
        displacement_error(*ball, ball[0], 0 * ball[0], is_free=False)


def test_volume_curves_are_compared_at_the_reference_times():
    times_ref = np.linspace(0, 1, 5)
    times = np.linspace(0, 1, 3)  # a straight line is resampled without error
    error = change_error(times, 0.03 * times, times_ref, 0.02 * times_ref)
    assert error == pytest.approx((0.5, 0.01), rel=ROUNDING)


def test_volume_error_sees_a_difference_in_mid_curve():
    times = np.linspace(0, 1, 101)
    change_ref = -times
    change = change_ref + 0.2 * np.sin(np.pi * times)
    error = change_error(times, change, times, change_ref)
    assert error.absolute == pytest.approx(0.2)
    # ||0.2 sin(pi t)|| / ||t|| over [0, 1]; the trapezoidal rule on 100 steps is good to 1e-4.
    assert error.relative == pytest.approx(0.2 * np.sqrt(0.5) / np.sqrt(1 / 3), rel=1e-4)


def test_volume_error_weighs_uneven_intervals_by_their_length():
    times, change_ref = np.array([0, 0.1, 0.5, 2]), np.array([1, 1, 1, 1.0])
    error = change_error(times, np.array([1, 1, 1.5, 1]), times, change_ref)
    # A square of 0.25 at one time counts for half of the intervals beside it, 0.4 and 1.5 of 2.
    assert error == pytest.approx((np.sqrt(0.25 * (0.4 + 1.5) / 2 / 2), 0.5), rel=ROUNDING)


def test_a_single_volume_is_compared_as_it_is():
    once = np.array([1.0])
    assert change_error(once, np.array([-0.3]), once, np.array([-0.2])) == pytest.approx((0.5, 0.1))
    assert np.isnan(change_error(once, np.array([-0.3]), once, np.array([0.0])).relative)


def test_runs_of_known_difference(ball, tmp_path):
    springs = load_run(write_run(tmp_path / "a", *ball, lambda X: -1.2e-6 * X + 1e-3 * rigid_motion(X)))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: -1e-6 * X))
    result = compare_runs(springs, reference, is_free=True)
    # Displacements of 1e-6 are stored as differences of coordinates of order one.
    assert result.displacement_error_l2 == pytest.approx(0.2, rel=1e-6)
    assert result.displacement_error_max == pytest.approx(0.2, rel=1e-6)


def test_volume_curve_of_runs(ball, tmp_path):
    springs = load_run(write_run(tmp_path / "a", *ball, lambda X: 0 * X, times=np.linspace(0, 1, 9)))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: -0.1 * X))
    result = compare_runs(springs, reference, is_free=True)
    assert result.volume_change_error == pytest.approx(1, rel=1e-9)
    assert result.volume_change_difference == pytest.approx(1 - 0.9**3, rel=1e-9)
    assert result.seconds["solve"] == 0.3


def bend(X):
    return 1e-4 * (X**2)[:, [0]] * [1, 0, 0]


def test_a_bending_reference_keeps_volume_and_area_and_withdraws_their_errors(ball, tmp_path):
    """Every point of a ball moves along x by its x^2: one half bulges by what the other caves in, and a little more."""
    X, F = ball
    reference = load_run(
        write_run(tmp_path / "a", X, F, lambda X: 1e-4 * (X**2)[:, [0]] * [1, 0, 0] + 1e-8 * X)
    )
    springs = load_run(write_run(tmp_path / "b", X, F, lambda X: 1e-3 * X))
    described = describe_reference(reference)
    assert described.keeps_volume and described.keeps_area
    assert described.largest_volume_change < 1e-3 * described.swept_volume
    figures = compare_runs(springs, reference, is_free=False)
    assert np.isnan(figures.volume_change_error) and np.isnan(figures.area_change_error)
    # A run that does change them is compared with the springs'.
    assert not describe_reference(springs).keeps_volume and not describe_reference(springs).keeps_area
    assert compare_runs(reference, springs, is_free=False).area_change_error == pytest.approx(1, rel=1e-3)


def areas_of(X, F):
    return np.linalg.norm(np.cross(X[F[:, 1]] - X[F[:, 0]], X[F[:, 2]] - X[F[:, 0]]), axis=1) / 2


@pytest.mark.parametrize("part, share, is_kept", [
    ("volume", 0.0098, True), ("volume", 0.0102, False), ("area", 0.049, True), ("area", 0.051, False),
])  # fmt: skip
def test_volume_and_area_are_kept_below_a_share_of_what_parts_of_the_surface_do(
    part, share, is_kept, ball, tmp_path
):
    """A small growth c beside the motion x^2 along x, which cancels: it adds 3 c to the volume, 2 c to the area."""
    X, F = ball
    if part == "volume":
        growth = share * describe_reference(load_run(write_run(tmp_path / "a", X, F, bend))).swept_volume / 3
    else:
        growth = share * np.abs(areas_of(X + bend(X), F) - areas_of(X, F)).sum() / areas_of(X, F).sum() / 2
    described = describe_reference(load_run(write_run(tmp_path / "b", X, F, lambda X: bend(X) + growth * X)))
    assert (described.keeps_volume if part == "volume" else described.keeps_area) == is_kept


def test_area_is_compared_over_the_whole_curve(ball, tmp_path):
    springs = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.3 * X))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.2 * X))
    t = np.linspace(0, 1, 5)
    change, change_ref = (1 + 0.3 * t) ** 2 - 1, (1 + 0.2 * t) ** 2 - 1
    expected = np.sqrt(trapezium(t, (change - change_ref) ** 2) / trapezium(t, change_ref**2))
    assert compare_runs(springs, reference, True).area_change_error == pytest.approx(expected, rel=1e-6)


def test_tip_is_the_vertex_that_the_reference_moves_farthest(ball, tmp_path):
    X, F = ball
    reference = load_run(write_run(tmp_path / "a", X, F, lambda X: np.abs(X[:, [0]] + 1) * [0, -0.1, 0]))
    springs = load_run(write_run(tmp_path / "b", X, F, lambda X: np.abs(X[:, [0]] + 1) * [0.7, -0.05, 0]))
    tip = tip_of(reference, is_free=False)
    assert X[tip.vertex, 0] == X[:, 0].max()
    assert tip.direction == pytest.approx([0, -1, 0])
    size = X[:, 0].max() + 1
    times, moved = tip.curve(springs, is_free=False)
    assert moved == pytest.approx(0.05 * size * times, abs=1e-12)
    assert compare_runs(springs, reference, is_free=False).tip_displacement == pytest.approx(0.05 * size)
    assert describe_reference(reference).largest_displacement == pytest.approx(0.1 * size)
    # Of a free body, which bends here as well, less than all of it is left.
    assert describe_reference(reference, is_free=True).largest_displacement < 0.05 * size


def test_what_small_strain_costs_is_estimated_where_it_is_the_law(ball, tmp_path):
    shrunk = load_run(write_run(tmp_path / "a", *ball, lambda X: -0.02 * X, law="small_strain"))
    finite = load_run(write_run(tmp_path / "b", *ball, lambda X: -0.02 * X, law="neo_hookean"))
    assert describe_reference(shrunk).law_error == pytest.approx(0.02)
    assert describe_reference(finite).law_error is None
    (shrunk.folder / "scene.toml").write_text("[collapse]\ncoefficient = 0.02\n")
    assert describe_reference(shrunk).law_error == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("who", ["reference", "springs"])
def test_runs_that_stopped_are_compared_where_they_did(who, ball, tmp_path):
    """One of five steps is beyond what was reached; the springs leave it in their files, the reference does not."""
    times = np.linspace(0, 0.8, 5) if who == "springs" else np.linspace(0, 0.6, 4)
    more = {"load_factor_reached": 0.6} if who == "reference" else {"reason": "step 4 of 5"}
    stopped = write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times, status="not_converged", **more)
    whole = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.2 * X, np.linspace(0, 1, 6)))
    with pytest.raises(RunError, match="status is 'not_converged'"):
        load_run(stopped)
    run = load_run(stopped, may_stop=True)
    assert run.times[-1] == pytest.approx(0.6) and len(run.times) == 4
    if who == "reference":
        figures = compare_runs(whole, run, is_free=False)
        assert (figures.status, figures.displacement_error_l2) == ("ok", pytest.approx(1))
        assert figures.volume_change_error == pytest.approx(1.05, rel=0.1)
        assert describe_reference(run).stopped == "not_converged"
        assert describe_reference(run).reached == pytest.approx(0.6)
    else:
        figures = compare_runs(run, whole, is_free=False)
        assert (figures.status, figures.displacement_error_l2) == (
            "not_converged, step 4 of 5",
            pytest.approx(0.5),
        )
        assert np.isnan(figures.tip_displacement)  # of the whole load
        assert figures.volume_change_error == pytest.approx(0.52, rel=0.1)
    assert figures.reached == pytest.approx(0.6)


def test_a_run_that_stopped_at_once_has_nothing_to_compare(ball, tmp_path):
    at_rest = write_run(
        tmp_path / "a", *ball, lambda X: X, np.array([0, 0.2]), status="not_converged", reason="step 1"
    )
    with pytest.raises(RunError, match="not_converged, step 1, and no load was reached"):
        load_run(at_rest, may_stop=True)
    moving = write_motion(tmp_path / "b", *ball, lambda X: 0.1 * X, TIMES, SIZES)
    record = moving.folder / "run.json"
    record.write_text(record.read_text().replace('"ok"', '"diverged"'))
    with pytest.raises(RunError, match="diverged"):
        load_run(moving.folder, may_stop=True)


def test_other_vertex_position_is_refused(ball, tmp_path):
    X, F = ball
    moved = X.copy()
    moved[5, 2] += 1e-3
    a = load_run(write_run(tmp_path / "a", moved, F, lambda X: 0.1 * X))
    b = load_run(write_run(tmp_path / "b", X, F, lambda X: 0.1 * X))
    with pytest.raises(RunError, match=r"different surfaces: 642 vertices, .* lie [0-9.e-]+ m apart"):
        compare_runs(a, b, is_free=True)


def test_another_order_of_vertices_is_the_same_surface(ball, tmp_path):
    X, F = ball
    order = np.random.default_rng(1).permutation(len(X))
    a = load_run(write_run(tmp_path / "a", X[order], np.argsort(order)[F][::-1], lambda X: 0.11 * X**2))
    b = load_run(write_run(tmp_path / "b", X, F, lambda X: 0.1 * X**2))
    assert compare_runs(a, b, is_free=False).displacement_error_l2 == pytest.approx(0.1, rel=1e-9)


def test_errors_are_measured_where_the_surface_was_cut_not_at_its_corners_alone(cube, tmp_path):
    """A field that vanishes in all corners of the file: only the vertices between them see it."""
    X, F = cube
    finer = pv.PolyData.from_regular_faces(X, F).subdivide(2)
    b = load_run(write_run(tmp_path / "b", finer.points.astype(float), finer.regular_faces, bulge))
    a = load_run(write_run(tmp_path / "a", X, F, bulge))
    figures = compare_runs(a, b, is_free=False)
    assert figures.displacement_error_l2 == pytest.approx(1)  # linear between corners, at which nothing moves
    assert describe_reference(b).n_points == len(finer.points)


def bulge(X):
    return np.sin(np.pi * X[:, :1] / 2) * [0, 0.1, 0]


def test_run_that_ends_early_is_refused(ball, tmp_path):
    a = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times=np.array([0, 0.5])))
    b = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.1 * X))
    with pytest.raises(RunError, match=r"last frame is at time 0.5, expected 1 "):
        compare_runs(a, b, is_free=True)


def test_short_motions_end_together_within_a_share_of_their_length(ball, tmp_path):
    reference = load_run(write_run(tmp_path / "a", *ball, lambda X: X, np.array([0, 1e-6])))
    early = load_run(write_run(tmp_path / "b", *ball, lambda X: X, np.array([0, 0.9999e-6])))
    rounded = load_run(write_run(tmp_path / "c", *ball, lambda X: X, np.array([0, 1e-6 * (1 + 1e-12)])))
    compare_runs(rounded, reference, is_free=False)
    with pytest.raises(RunError, match="last frame is at time"):
        compare_runs(early, reference, is_free=False)


def test_comparison_keeps_what_the_springs_say_of_themselves(ball, tmp_path):
    said = {
        "n_nodes": 7,
        "n_springs": 8,
        "n_patches": 9,
        "diagnostics": {"pressure_error": 0.1},
        "n_floppy_motions": 2,
        "floppy_load_share": 0.3,
        "estimated_error": 0.04,
    }
    linear = {"geometry": "linear"}
    run = load_run(write_run(tmp_path / "a", *ball, lambda X: X, **said, **linear, min_J_nodes=-0.1))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: X, program="fem_reference"))
    result = compare_runs(run, reference, is_free=False)
    assert {key: value for key, value in asdict(result).items() if key in said} == said
    assert result.least_jacobian == -0.1
    assert result.is_linear and not compare_runs(reference, reference, is_free=False).is_linear


def test_displacement_is_linear_between_frames(ball, tmp_path):
    run = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times=np.array([0, 0.4, 1])))
    for time in (0, 0.1, 0.4, 0.7, 1):
        assert displacement_at(run, time) == pytest.approx(0.1 * time * ball[0], abs=1e-15)
    with pytest.raises(RunError, match=r"no frame at time 1.1, expected 0 to 1"):
        displacement_at(run, 1.1)


TIMES, SIZES = np.array([0, 0.5, 2, 3]), np.array([0, 1, 3, 1])
FEWER_TIMES, FEWER_SIZES = np.array([0, 2, 3]), np.array([0, 4, 2])  # 1 at 0.5, as the reference
TRAJECTORY_ERROR = np.sqrt(trapezium(TIMES, [0, 0, 1, 1]) / trapezium(TIMES, SIZES**2))
# They differ most at 2 s and 3 s, by a size of 1; the reference is averaged over the time.
LARGEST_ERROR = 1 / np.sqrt(trapezium(TIMES, SIZES**2) / 3)


def write_motion(folder, X, F, field, times, sizes):
    """A run whose displacement is field(X) times one of the sizes at each time."""
    write_run(folder, X, F, field, times, lambda time: float(sizes[list(times).index(time)]))
    (folder / "scene.toml").write_text('[time]\nmode = "dynamic"\n')
    return load_run(folder)


def test_trajectories_are_compared_over_the_whole_time(ball, tmp_path):
    reference = write_motion(tmp_path / "a", *ball, lambda X: 0.1 * X, TIMES, SIZES)
    fewer = write_motion(tmp_path / "b", *ball, lambda X: 0.1 * X, FEWER_TIMES, FEWER_SIZES)
    assert trajectory_error(fewer, reference) == pytest.approx((TRAJECTORY_ERROR, LARGEST_ERROR))
    assert compare_runs(fewer, reference, is_free=False).displacement_error_l2 == pytest.approx(
        TRAJECTORY_ERROR
    )


def test_trajectories_are_compared_over_the_surface(uneven, tmp_path):
    X, F = uneven
    reference = write_motion(tmp_path / "a", X, F, lambda X: 0.1 * X[:, [1, 0, 2]], TIMES, SIZES)
    run = write_motion(tmp_path / "b", X, F, lambda X: 0.1 * X, FEWER_TIMES, FEWER_SIZES)
    at = np.array([0, 1, 4, 2])
    squares = [
        [surface_integral(X, F, (part**2).sum(axis=1)) for part in (a * X - b * X[:, [1, 0, 2]], b * X)]
        for a, b in zip(at, SIZES, strict=True)
    ]
    over_time = trapezium(TIMES, np.array(squares))
    assert trajectory_error(run, reference).l2 == pytest.approx(np.sqrt(over_time[0] / over_time[1]))


def test_motions_of_free_bodies_are_compared_without_the_rigid_part(ball, tmp_path):
    reference = write_motion(tmp_path / "a", *ball, lambda X: 0.1 * X, TIMES, SIZES)
    turned = write_motion(
        tmp_path / "b", *ball, lambda X: 0.1 * X + rigid_motion(X), FEWER_TIMES, FEWER_SIZES
    )
    assert trajectory_error(turned, reference, is_free=True) == pytest.approx(
        (TRAJECTORY_ERROR, LARGEST_ERROR)
    )
    assert trajectory_error(turned, reference).l2 > 1


def test_a_motion_that_ends_at_rest_is_compared_on_its_way(ball, tmp_path):
    times, sizes = np.array([0, 1, 2, 4]), np.array([0, 1, 2, 0])
    reference = write_motion(tmp_path / "a", *ball, lambda X: 0.1 * X, times, sizes)
    run = write_motion(tmp_path / "b", *ball, lambda X: 0.1 * X, times, np.array([0, 1, 2.5, 0]))
    result = compare_runs(run, reference, is_free=False)
    expected = np.sqrt(trapezium(times, [0, 0, 0.25, 0]) / trapezium(times, sizes**2))
    assert result.displacement_error_l2 == pytest.approx(expected)
    assert result.displacement_error_max == pytest.approx(0.5 / np.sqrt(trapezium(times, sizes**2) / 4))
    assert result.tip_displacement == pytest.approx(0.25 * np.linalg.norm(ball[0], axis=1).max())


def test_a_pushed_cube_sweeps_its_own_volume(cube, tmp_path):
    """Moved along an edge, two faces sweep their area times the way; a volume change would cancel them."""
    X, F = cube
    run = load_run(
        write_run(tmp_path / "a", X, F, lambda X: 0 * X + [0.3, 0, 0], program="fem_reference", n_dofs=7)
    )
    described = describe_reference(run)
    assert described.swept_volume == pytest.approx(2 * 4 * 0.3 / 8)
    assert described.largest_displacement == pytest.approx(0.3)
    assert described.largest_volume_change == pytest.approx(0, abs=ROUNDING)
    assert described.n_dofs == 7


def test_a_moving_reference_is_described_at_its_widest(ball, tmp_path):
    run = write_motion(tmp_path / "a", *ball, lambda X: -0.1 * X, TIMES, SIZES)
    described = describe_reference(run)
    radius = np.linalg.norm(ball[0], axis=1).max()
    assert described.largest_displacement == pytest.approx(0.3 * radius)
    # X spreads by the divergence 3, of which each triangle has its share.
    assert described.swept_volume == pytest.approx(3 * 0.3)
    assert described.largest_volume_change == pytest.approx(1 - 0.7**3)
    (run.folder / "scene.toml").unlink()  # without it the run is static
    assert describe_reference(load_run(run.folder)).swept_volume == pytest.approx(3 * 0.1)


def test_springs_alone_are_described_at_their_end(ball, tmp_path):
    run = write_motion(tmp_path / "a", *ball, lambda X: -0.1 * X, TIMES, SIZES)
    described = describe_alone(run)
    assert described.volume_change == pytest.approx(0.9**3 - 1)
    assert described.largest_displacement == pytest.approx(0.1 * np.linalg.norm(ball[0], axis=1).max())
    assert described.kinetic_energy_left == pytest.approx(0.25)


def test_a_reference_at_rest_has_no_trajectory(ball, tmp_path):
    fewer = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.12 * X))
    with pytest.raises(RunError, match="does not deform"):
        trajectory_error(fewer, load_run(write_run(tmp_path / "e", *ball, lambda X: 0 * X)))


@pytest.mark.parametrize(
    "key",
    [
        "gravity = [0, 0, -9.81]",
        "[material]\nE = 2e5",
        "[[loads]]\npressure = 1",
        "[[supports]]\nregion.sphere.radius = 1",
    ],
)
def test_runs_of_different_load_cases_are_refused(key, ball, tmp_path):
    folders = [write_run(tmp_path / name, *ball, lambda X: 0.1 * X) for name in "ab"]
    for folder, text in zip(folders, (key, key.replace("1", "3").replace("2e5", "1e5")), strict=True):
        (folder / "scene.toml").write_text(f"{text}\n[network]\nk = {len(text)}{folder.name == 'a':d}\n")
    runs = [load_run(folder) for folder in folders]
    with pytest.raises(RunError, match=f"the scene's {key.strip('[').split()[0].strip(']')} is .*, expected"):
        compare_runs(*runs, is_free=True)
    (folders[0] / "scene.toml").write_text((folders[1] / "scene.toml").read_text())
    compare_runs(*runs, is_free=True)


def test_largest_strain_of_the_reference_is_that_of_all_its_way(ball, tmp_path):
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: 0.1 * X, program="fem_reference"))
    run.curves["max_strain"] = np.array([0, 0.1, 0.3, 0.2, 0.1])
    assert describe_reference(run).largest_strain == 0.3


def test_bodies_that_roll_have_other_points_on_one_surface(cube, tmp_path):
    X, F = cube[0] - 1, cube[1]
    flat = np.array([1, 0.4, 1])
    rolled = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # by a quarter about z, onto itself
    reference = load_run(write_run(tmp_path / "a", X, F, lambda X: X * flat - X, program="fem_reference"))
    run = load_run(write_run(tmp_path / "b", X, F, lambda X: X @ rolled.T * flat - X))
    assert compare_runs(run, reference, False).displacement_error_l2 > 2
    assert relative_distance(run, reference, False, 1.0) < ROUNDING


@pytest.mark.parametrize("is_free", [False, True])
def test_distance_of_surfaces_is_over_the_displacement_and_leaves_shifts_out_where_they_mean_nothing(
    cube, tmp_path, is_free
):
    X, F = cube[0] - 1, cube[1]
    d = 0.02
    reference = load_run(write_run(tmp_path / "a", X, F, lambda X: 0.1 * X, program="fem_reference"))
    run = load_run(write_run(tmp_path / "b", X, F, lambda X: 0.1 * X + [0, 0, 1.1 * d]))
    # Two of six faces lie apart by all of the shift; the sides' strips beyond the other cube are of second order.
    expected = 0 if is_free else 1.1 * d / 3 / (0.1 * np.sqrt(3))
    assert relative_distance(run, reference, is_free, 1.0) == pytest.approx(expected, rel=3 * d, abs=ROUNDING)


def test_surfaces_of_a_model_that_stopped_are_set_beside_those_of_the_same_moment(cube, tmp_path):
    """Both grow alike, and the model for half as long."""
    X, F = cube[0] - 1, cube[1]
    reference = load_run(write_run(tmp_path / "a", X, F, lambda X: 0.1 * X, program="fem_reference"))
    times = np.linspace(0, 0.5, 3)
    stopped = {"status": "not_converged", "load_factor_reached": 0.5}
    run = load_run(
        write_run(tmp_path / "b", X, F, lambda X: 0.1 * X, times, **stopped),
        may_stop=True,
    )
    assert relative_distance(run, reference, False, 0.5) < ROUNDING


@pytest.mark.parametrize("is_moving, mean_square", [(True, 0.375), (False, 1)])
def test_length_that_errors_are_relative_to_is_of_a_motion_over_it_all(
    cube, tmp_path, monkeypatch, is_moving, mean_square
):
    monkeypatch.setattr(compare, "is_dynamic", lambda run: is_moving)
    run = load_run(write_run(tmp_path / "a", cube[0] - 1, cube[1], lambda X: 0.1 * X, np.array([0, 0.5, 1])))
    # Of squares 0, 1/4 and 1 by the trapezoidal rule, or at the end.
    expected = 0.1 * np.sqrt(3 * mean_square)
    assert compare.root_mean_square(run, False, 1.0) == pytest.approx(expected)
