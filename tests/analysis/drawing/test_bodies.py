"""Bodies of a comparison are drawn whole, in proportion, on one scale, and cut open where they are hollow."""

import numpy as np
import pytest
import pyvista as pv
from PIL import Image
from synthetic import write_run

from analysis import comparison_figures
from analysis.compare import vertex_areas
from analysis.drawing.bodies import Body, bodies_of, cut_plane, draw_bodies, has_cavity
from analysis.drawing.error_scale import colour_of
from analysis.drawing.pictures import (
    PANEL,
    floor_of,
    outline_of,
    round_length,
    seen_size,
    skin_of,
    view_axes,
)
from analysis.drawing.view import Shown
from analysis.runs import load_run


def pixels_of(file):
    return np.asarray(Image.open(file).convert("RGB"), dtype=int)


def extent(picture):
    """Rows and columns (pixels) over which a picture is not white."""
    covered = (picture < 245).any(axis=2)
    return np.ptp(covered.any(axis=1).nonzero()[0]), np.ptp(covered.any(axis=0).nonzero()[0])


@pytest.mark.parametrize("stretch", [(1, 1, 1), (1, 2, 1), (3, 1, 3)])
def test_bodies_are_whole_and_in_their_proportions(stretch, ball, tmp_path):
    X, F = ball[0] * stretch, ball[1]
    files = [tmp_path / "a.png", tmp_path / "b.png"]
    draw_bodies(files, [Body(X, F, 0.33 * X), Body(X, F, 0.3 * X)], 1)
    width, height = seen_size(1.33 * X)
    panel = Image.open(files[0]).size
    assert panel[0] == PANEL[0] and PANEL[1] / 2 < panel[1] <= PANEL[1]
    per_metre = min(0.94 * panel[0] / width, 0.94 * panel[1] / height)
    assert per_metre * width > 0.9 * panel[0] or panel[1] == PANEL[1]  # no wider margin than is needed
    for file, size in zip(files, (1.33, 1.3), strict=True):
        rows, columns = extent(pixels_of(file))
        assert rows == pytest.approx(size / 1.33 * height * per_metre, abs=5)
        assert columns == pytest.approx(size / 1.33 * width * per_metre, abs=5)


def test_a_body_that_bursts_does_not_make_the_others_small(ball, tmp_path):
    X, F = ball
    files = [tmp_path / "a.png", tmp_path / "b.png"]
    draw_bodies(files, [Body(X, F, 0.1 * X), Body(X, F, 90 * X)], 1)
    assert min(extent(pixels_of(files[0]))) > 0.3 * PANEL[0]


def test_outline_at_rest_is_seen_before_a_body_that_grows(ball, tmp_path):
    X, F = ball
    for name, rest in (("with", X), ("without", 1.5 * X)):
        draw_bodies([tmp_path / f"{name}.png"], [Body(rest, F, 1.5 * X - rest)], 1)
    within = np.abs(pixels_of(tmp_path / "with.png") - pixels_of(tmp_path / "without.png")).max(axis=2) > 30
    rows, columns = within.nonzero()
    middle = np.array(within.shape) / 2
    radii = np.hypot(rows - middle[0], columns - middle[1])
    # Of the circle of radius 1 within that of 1.5, which fills the picture's width.
    share = radii / (0.94 * PANEL[0] / 2)
    is_inner = np.abs(share - 1 / 1.5) < 0.03
    assert is_inner.sum() > 300 and is_inner.sum() > 0.95 * (share < 0.8).sum()
    degrees = np.degrees(np.arctan2(rows - middle[0], columns - middle[1])[is_inner])
    lined, _ = np.histogram(degrees, np.arange(-180, 181, 1))
    # All the way around, but no line that could be taken for a crack: gaps as long as the dashes.
    assert all(np.split(lined > 0, 36)[k].any() for k in range(36))
    assert 0.4 < (lined > 0).mean() < 0.8 and (lined[::3] == 0).sum() > 20


def length_of(outline):
    lines = outline.lines.reshape(-1)
    ends, total, at = np.asarray(outline.points), 0.0, 0
    while at < len(lines):
        points = ends[lines[at + 1 : at + 1 + lines[at]]]
        total += np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        at += 1 + lines[at]
    return total


def test_outline_is_half_of_the_border_of_what_the_camera_sees():
    """Of a cube seen along the camera's direction: a hexagon, whose edges are the cube's as they are seen; no edge within."""
    cube = pv.Cube().triangulate().clean()
    X = np.array(cube.points, dtype=float)
    towards = view_axes()[2]
    border = 2 * np.sqrt(1 - towards**2).sum()
    assert length_of(outline_of(X, cube.regular_faces)) == pytest.approx(border / 2, rel=1e-6)
    # A hole is a border, too: the box of the torus is 3 by 3 by 1.
    torus = pv.ParametricTorus(ringradius=1, crosssectionradius=0.5).triangulate().clean()
    seen = outline_of(np.array(torus.points, dtype=float), torus.regular_faces)
    from_above = np.asarray(seen.points) @ view_axes()[:2].T
    assert np.linalg.norm(from_above, axis=1).min() < 0.5


def test_creases_stay_sharp_and_all_else_is_smooth(ball):
    X, F = ball
    assert len(skin_of(X, F).ids) == len(X)
    cube = pv.Cube().triangulate().clean()
    skin = skin_of(np.array(cube.points, dtype=float), cube.regular_faces)
    assert len(skin.ids) == 24  # each corner belongs to three sides


def runs_of(ball, folder, **more):
    X, F = ball
    springs = write_run(folder / "springs", X, F, lambda P: 0.3 * P + [0, 5, 0], n_patches=1)
    reference = write_run(folder / "reference", X, F, lambda P: 0.2 * P, program="fem_reference")
    return load_run(springs), load_run(reference)


def test_error_is_in_percent_of_the_references_mean_displacement(ball, tmp_path):
    """The springs' body is shifted, too, which means nothing where it is free."""
    X, F = ball[0] * [2, 1, 1], ball[1]
    springs, reference = runs_of((X, F), tmp_path)
    of_reference, body = bodies_of(springs, reference, 1.0, is_free=True, is_cut=False)
    length = np.linalg.norm(X, axis=1)
    np.testing.assert_allclose(of_reference.u, 0.2 * X, atol=1e-6)
    np.testing.assert_allclose(body.u, 0.3 * X, atol=1e-6)
    mean = np.sqrt(np.average((0.2 * length) ** 2, weights=vertex_areas(X, F)))
    np.testing.assert_allclose(body.error, 100 * 0.1 * length / mean, rtol=1e-5)
    assert body.inside is None


def test_error_on_the_way_is_over_what_the_reference_moves_there(ball, tmp_path):
    """Both grow evenly with the load, so that half of it leaves the error as it is."""
    springs, reference = runs_of(ball, tmp_path)
    half, whole = (bodies_of(springs, reference, load, True, False)[1] for load in (0.5, 1.0))
    np.testing.assert_allclose(half.error, whole.error, rtol=1e-5)


def test_cut_moves_with_its_surface(ball, tmp_path):
    springs, reference = runs_of(ball, tmp_path)
    for body, stretch in zip(bodies_of(springs, reference, 1.0, True, True), (0.2, 0.3), strict=True):
        cut = body.inside
        assert cut.n_points >= 3
        np.testing.assert_allclose(cut["u"], stretch * cut.points, atol=1e-6)
        origin, normal = cut_plane(body.X)
        np.testing.assert_allclose((cut.points - origin) @ normal, 0, atol=1e-6)


def test_caption_names_the_bodies_that_are_cut_open(ball, tmp_path, monkeypatch):
    """Networks of links have no tetrahedra to be cut."""
    X, F = ball
    cut = pv.PolyData(X)
    for name in ("draw_bodies", "draw_thumbnail", "write_view"):
        monkeypatch.setattr(comparison_figures, name, lambda *_: None)

    def caption(*inside):
        shown = {
            f"m{n}": Shown(f"model {n}", "", Body(X, F, 0.1 * X, 0 * X[:, 0], part))
            for n, part in enumerate(inside)
        }
        return comparison_figures.row_of(tmp_path, "title", "", shown).caption

    assert caption(cut, cut).endswith("drawn over what hides it. Cut open: model 0 and model 1.")
    assert caption(cut, None).endswith("Cut open: model 0; others have no tetrahedra.")
    assert "ut open" not in caption(None, None)


def test_a_cavity_is_told_from_a_second_body(ball):
    X, F = ball
    hollow = np.vstack([X, X / 2]), np.vstack([F, F[:, ::-1] + len(X)])
    two = np.vstack([X, X + 5]), np.vstack([F, F + len(X)])
    assert has_cavity(*hollow)
    assert not has_cavity(*two) and not has_cavity(X, F)


@pytest.mark.parametrize("error", [0.3, 4, 12, 60])
def test_a_body_has_the_colour_of_its_error(error, ball, tmp_path):
    """In whatever company: light alone darkens it, by a quarter at most where it falls."""
    X, F = ball
    bodies = [
        Body(X, F, 0.1 * X, np.full(len(X), error)),
        Body(X, F, 0.1 * X, np.linspace(1e-9, 900, len(X))),
    ]
    draw_bodies([tmp_path / "a.png", tmp_path / "b.png"], bodies, 1)
    seen = pixels_of(tmp_path / "a.png")[PANEL[0] // 2 - 60, PANEL[0] // 2 + 40]
    expected = 255 * np.array(colour_of(error))
    assert (0.75 * expected < seen + 4).all() and (seen < expected + 26).all()


def test_a_floor_is_where_a_body_is_constrained_at_its_bottom(ball):
    X, _ = ball
    is_low = X[:, 1] < -0.8
    u = np.where(is_low[:, None], 0.0, [0.1, 0, 0])
    floor = floor_of(X, u, X)
    assert floor.height == pytest.approx(-1)
    assert floor_of(X, u + 0.1, X) is None  # free
    assert floor_of(X, np.where((X[:, 1] > 0.8)[:, None], 0.0, u + 0.1), X) is None  # hangs
    assert (
        floor_of(X, np.where(is_low[:, None], 0.0, [0, -2.0, 0]), X - np.array([0, 2, 0])) is None
    )  # falls through
    # Light falls at a slant: a point h above the floor throws its shadow h times as far aside as the sun leans.
    shadow = floor.shadow_of(np.array([[0.0, 1.0, 0.0]]))
    assert shadow[0] == pytest.approx([-0.7, -1, -0.5], abs=0.01)


@pytest.mark.parametrize("wanted, got", [(1, 1), (1.9, 1), (0.02, 0.02), (7e-4, 5e-4), (340, 200)])
def test_round_lengths_are_one_two_or_five(wanted, got):
    assert round_length(wanted) == pytest.approx(got)
