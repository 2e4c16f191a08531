"""Error norms on fields and runs whose errors are known in closed form."""

import numpy as np
import pytest
from synthetic import write_run

from analysis.compare import (
    compare_runs,
    displacement_at,
    displacement_error,
    remove_rigid_motion,
    trajectory_error,
    vertex_areas,
    volume,
    volume_error,
)
from analysis.runs import RunError, load_run

ROUNDING = 1e-12  # a few hundred operations on numbers of order one


def rigid_motion(X):
    return np.array([0.3, -0.2, 0.5]) + np.cross([0.1, 0.2, -0.3], X)


def test_volume_of_a_cube_far_from_the_origin():
    X = np.array([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)]) + 1000.0
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    F = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    assert volume(X, F) == pytest.approx(8, rel=ROUNDING)
    assert vertex_areas(X, F).sum() == pytest.approx(24, rel=ROUNDING)


def test_a_tenth_too_much_everywhere_is_an_error_of_a_tenth(ball):
    X, F = ball
    u = X * [1, 2, 3]
    error = displacement_error(X, F, 1.1 * u, u, is_free=False)
    assert error == pytest.approx((0.1, 0.1), rel=ROUNDING)


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
    error = volume_error(times, 0.03 * times, times_ref, 0.02 * times_ref)
    assert error == pytest.approx((0.5, 0.01), rel=ROUNDING)


def test_volume_error_sees_a_difference_in_mid_curve():
    times = np.linspace(0, 1, 101)
    change_ref = -times
    change = change_ref + 0.2 * np.sin(np.pi * times)
    error = volume_error(times, change, times, change_ref)
    assert error.absolute == pytest.approx(0.2)
    # ||0.2 sin(pi t)|| / ||t|| over [0, 1]; the trapezoidal rule on 100 steps is good to 1e-4.
    assert error.relative == pytest.approx(0.2 * np.sqrt(0.5) / np.sqrt(1 / 3), rel=1e-4)


def test_runs_of_known_difference(ball, tmp_path):
    springs = load_run(write_run(tmp_path / "a", *ball, lambda X: -1.2e-6 * X + 1e-3 * rigid_motion(X)))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: -1e-6 * X))
    result = compare_runs(springs, reference, is_free=True)
    # Displacements of 1e-6 are stored as differences of coordinates of order one.
    assert result["displacement_error_l2"] == pytest.approx(0.2, rel=1e-6)
    assert result["displacement_error_max"] == pytest.approx(0.2, rel=1e-6)


def test_volume_curve_of_runs(ball, tmp_path):
    springs = load_run(write_run(tmp_path / "a", *ball, lambda X: 0 * X, times=np.linspace(0, 1, 9)))
    reference = load_run(write_run(tmp_path / "b", *ball, lambda X: -0.1 * X))
    result = compare_runs(springs, reference, is_free=True)
    assert result["volume_change_error"] == pytest.approx(1, rel=1e-9)
    assert result["volume_change_difference"] == pytest.approx(1 - 0.9**3, rel=1e-9)
    assert result["seconds"]["solve"] == 0.3


def test_other_vertex_position_is_refused(ball, tmp_path):
    X, F = ball
    moved = X.copy()
    moved[5, 2] += 1e-6
    a = load_run(write_run(tmp_path / "a", moved, F, lambda X: 0.1 * X))
    b = load_run(write_run(tmp_path / "b", X, F, lambda X: 0.1 * X))
    with pytest.raises(RunError, match="different surfaces: vertex 5 lies 1e-06 m apart"):
        compare_runs(a, b, is_free=True)


def test_other_vertex_order_is_refused(ball, tmp_path):
    X, F = ball
    a = load_run(write_run(tmp_path / "a", X, F[::-1], lambda X: 0.1 * X))
    b = load_run(write_run(tmp_path / "b", X, F, lambda X: 0.1 * X))
    with pytest.raises(RunError, match="different surfaces"):
        compare_runs(a, b, is_free=True)


def test_run_that_ends_early_is_refused(ball, tmp_path):
    a = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times=np.array([0, 0.5])))
    b = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.1 * X))
    with pytest.raises(RunError, match="last frame is at time 0.5, expected 1 "):
        compare_runs(a, b, is_free=True)


def test_displacement_is_linear_between_frames(ball, tmp_path):
    run = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times=np.array([0, 0.4, 1])))
    for time in (0, 0.1, 0.4, 0.7, 1):
        assert displacement_at(run, time) == pytest.approx(0.1 * time * ball[0], abs=1e-15)
    with pytest.raises(RunError, match="no frame at time 1.1, expected 0 to 1"):
        displacement_at(run, 1.1)


def test_trajectories_are_compared_over_the_whole_time(ball, tmp_path):
    reference = load_run(write_run(tmp_path / "a", *ball, lambda X: 0.1 * X, times=np.linspace(0, 1, 9)))
    fewer = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.12 * X, times=np.linspace(0, 1, 3)))
    assert trajectory_error(fewer, reference) == pytest.approx((0.2, 0.2))
    turned = load_run(write_run(tmp_path / "c", *ball, lambda X: 0.12 * X + rigid_motion(X)))
    assert trajectory_error(turned, reference, is_free=True) == pytest.approx((0.2, 0.2))
    assert trajectory_error(turned, reference).l2 > 1


def test_a_motion_that_ends_at_rest_is_compared_on_its_way(ball, tmp_path):
    X, F = ball
    runs = []
    for name, size in (("a", 0.12), ("b", 0.1)):
        folder = write_run(tmp_path / name, X, F, lambda X, size=size: size * X, times=np.array([0, 1, 2]))
        (folder / "scene.toml").write_text('[time]\nmode = "dynamic"\n')
        (folder / "frames" / "frame_000002.vtu").write_bytes(
            (folder / "frames" / "frame_000000.vtu").read_bytes()
        )
        runs.append(load_run(folder))
    assert compare_runs(*runs, is_free=False)["displacement_error_l2"] == pytest.approx(0.2)


def test_a_reference_at_rest_has_no_trajectory(ball, tmp_path):
    fewer = load_run(write_run(tmp_path / "b", *ball, lambda X: 0.12 * X))
    with pytest.raises(RunError, match="does not deform"):
        trajectory_error(fewer, load_run(write_run(tmp_path / "e", *ball, lambda X: 0 * X)))


@pytest.mark.parametrize("key", ["gravity = [0, 0, -9.81]", "[material]\nE = 2e5", "[[loads]]\npressure = 1"])
def test_runs_of_different_load_cases_are_refused(key, ball, tmp_path):
    folders = [write_run(tmp_path / name, *ball, lambda X: 0.1 * X) for name in "ab"]
    for folder, text in zip(folders, (key, key.replace("1", "3").replace("2e5", "1e5")), strict=True):
        (folder / "scene.toml").write_text(f"{text}\n[network]\nk = {len(text)}{folder.name == 'a':d}\n")
    runs = [load_run(folder) for folder in folders]
    with pytest.raises(RunError, match=f"the scene's {key.strip('[').split()[0].strip(']')} is .*, expected"):
        compare_runs(*runs, is_free=True)
    (folders[0] / "scene.toml").write_text((folders[1] / "scene.toml").read_text())
    compare_runs(*runs, is_free=True)
