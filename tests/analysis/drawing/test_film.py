"""Films and strips show the runs they are given, whole and in motion."""

import numpy as np
import pytest
from PIL import Image
from synthetic import write_run

from analysis.compare import trajectory_error
from analysis.drawing import film as film_module
from analysis.drawing.error_scale import CLAY, colour_of
from analysis.drawing.film import draw_film, draw_strip, main
from analysis.runs import RunError, load_run

N_FRAMES = 6


@pytest.fixture
def runs(ball, tmp_path):
    times = np.linspace(0, 0.5, N_FRAMES)
    springs = write_run(tmp_path / "springs", *ball, lambda X: 0.6 * X, times, calibration="affine")
    reference = write_run(tmp_path / "reference", *ball, lambda X: [0.4, 0, 0] * X, times)
    return {"affine": load_run(springs), "fem_reference": load_run(reference)}


def painted(picture: Image.Image) -> float:
    return float((np.asarray(picture.convert("RGB")) < 245).any(axis=2).mean())


def test_film_has_a_moving_body_for_each_run(runs, tmp_path):
    draw_film(tmp_path / "film.gif", runs, n_frames=N_FRAMES)
    film = Image.open(tmp_path / "film.gif")
    assert film.n_frames == N_FRAMES
    width, bottom = film.width // 2, film.height - 150 - 30
    film.seek(0)
    first = film.convert("RGB").crop((0, 24, width, bottom))
    film.seek(N_FRAMES - 1)
    last = film.convert("RGB")
    left, right = last.crop((0, 24, width, bottom)), last.crop((width, 24, film.width, bottom))
    assert np.abs(np.asarray(left, dtype=int) - np.asarray(first, dtype=int)).max() > 100
    # The springs' ball grows in all directions, to 1.3; the other's in one of them, so that it covers less.
    assert painted(first) == pytest.approx(painted(left) / 1.3**2, rel=0.05)
    assert 0.2 < painted(right) < painted(left) < 0.9


MOTION = '[time]\nmode = "dynamic"\n[[supports]]\n'


@pytest.fixture
def motion(ball, tmp_path):
    """Two balls that grow evenly, the springs' by half more: an error of 86.6 % in the end, and of half of that before."""
    times = np.linspace(0, 1, 101)
    runs = {
        "fem_reference": write_run(tmp_path / "fem_reference", *ball, lambda X: 0.2 * X, times),
        "affine": write_run(tmp_path / "affine", *ball, lambda X: 0.3 * X, times, calibration="affine"),
    }
    for folder in runs.values():
        (folder / "scene.toml").write_text(MOTION)
    return {name: load_run(folder) for name, folder in runs.items()}


def test_film_beside_a_reference_has_the_colours_and_errors_of_the_report(motion, tmp_path):
    draw_film(tmp_path / "film.gif", motion, n_frames=3)
    film = Image.open(tmp_path / "film.gif")
    middle = (film.height - 150) // 2
    for number, error in ((1, 43.3), (2, 86.6)):
        film.seek(number)
        page = np.asarray(film.convert("RGB"), dtype=int)
        clay = page[middle, film.width // 4]
        assert np.ptp(clay) < 20 and clay.mean() == pytest.approx(int(CLAY[1:3], 16), abs=40)
        # Light and the palette of the film change it a little.
        assert page[middle, 3 * film.width // 4] == pytest.approx(255 * np.array(colour_of(error)), abs=40)
    camera = film_module._Camera(motion, np.linspace(0, 1, 101), 100)
    painted_square = np.trapezoid(
        [np.mean(10 ** (2 * values)) for values in camera.bodies["affine"].values], dx=0.01
    )
    of_table = trajectory_error(motion["affine"], motion["fem_reference"]).l2
    assert 100 * of_table == pytest.approx(50) == pytest.approx(np.sqrt(painted_square))
    assert camera.title("affine") == "springs, affine (50 %)"
    assert camera.title("fem_reference") == "finite elements"


def test_film_draws_the_tip_where_the_reference_keeps_its_volume(motion, ball, tmp_path):
    times = np.linspace(0, 1, 5)
    bent = lambda X: 0.01 * np.column_stack([0 * X[:, 0], X[:, 0] ** 2, 0 * X[:, 0]])  # noqa: E731
    runs = {}
    for name, more in (("fem_reference", {}), ("affine", {"calibration": "affine"})):
        folder = write_run(tmp_path / f"bent_{name}", *ball, bent, times, **more)
        (folder / "scene.toml").write_text(MOTION)
        runs[name] = load_run(folder)
    label, curves = film_module._Camera(runs, times, 100).curves()
    assert label == "tip (mm)" and list(curves) == ["fem_reference", "affine"]
    assert curves["affine"][1] == pytest.approx(10 * times, rel=0.02)
    label, curves = film_module._Camera(motion, times, 100).curves()
    assert label == "volume (%)" and curves["affine"][1][-1] == pytest.approx(100 * (1.3**3 - 1))


def test_a_body_of_a_film_has_480_pixels_and_a_bar_tells_its_size(ball, tmp_path):
    X, F = ball[0] * 0.1, ball[1]
    run = load_run(write_run(tmp_path / "run", X, F, lambda X: 0.6 * X, calibration="affine"))
    draw_film(tmp_path / "film.gif", {"affine": run}, n_frames=2)
    film = Image.open(tmp_path / "film.gif")
    film.seek(1)
    panel = np.asarray(film.convert("RGB"), dtype=int)[24:502]
    assert min(panel.shape[:2]) > 470
    bar = (panel[-9:-4] < 60).all(axis=2)[2].sum()
    body = np.ptp((np.ptp(panel, axis=2) > 40).any(axis=0).nonzero()[0])
    # The ball ends 0.32 m wide; 0.05 m is the longest round length within a quarter of the picture.
    assert 0.32 * bar / body == pytest.approx(0.05, rel=0.05)


def test_strip_has_a_row_for_each_run(runs, tmp_path):
    draw_strip(tmp_path / "one.png", {"affine": runs["affine"]}, n_frames=4)
    draw_strip(tmp_path / "two.png", runs, n_frames=4)
    one, two = Image.open(tmp_path / "one.png"), Image.open(tmp_path / "two.png")
    assert two.height - one.height > 240
    assert one.width == two.width
    panels = [one.crop((k * one.width // 4, 24, (k + 1) * one.width // 4, 260)) for k in range(4)]
    shares = [painted(panel) for panel in panels]
    assert shares == sorted(shares) and shares[0] > 0.05


def test_film_ends_with_the_run_that_ends_first(ball, runs, tmp_path):
    longer = write_run(
        tmp_path / "longer", *ball, lambda X: 0.6 * X, np.linspace(0, 2, 3), calibration="lloyd"
    )
    draw_film(tmp_path / "film.gif", {"lloyd": load_run(longer), "affine": runs["affine"]}, n_frames=3)
    film = Image.open(tmp_path / "film.gif")
    film.seek(film.n_frames - 1)
    last, middle = film.convert("RGB"), film.width // 2
    # Both grow alike, so that they look alike at every time that both have.
    left, right = last.crop((0, 22, middle, 502)), last.crop((middle, 22, film.width, 502))
    assert np.abs(np.asarray(left, dtype=int) - np.asarray(right, dtype=int)).max() == 0


def test_a_single_frame_is_no_film(ball, tmp_path):
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: X, times=np.array([1.0])))
    with pytest.raises(RunError, match="at least two frames"):
        draw_film(tmp_path / "film.gif", {"fem_reference": run})


def test_a_body_at_rest_is_no_film(ball, tmp_path):
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: 0 * X))
    with pytest.raises(RunError, match="nothing moves"):
        draw_film(tmp_path / "film.gif", {"fem_reference": run})


OBSTACLES = {
    "plane": "plane = { point = [0, -1.7, 0], normal = [0, 1, 0] }",
    "sphere": "sphere = { center = [0, -2, 0], radius = 1 }",
    "box": "box = { low = [-1, -2, -1], high = [1, -1.2, 1] }",
    "capsule": "capsule = { a = [-1, -1.5, 0], b = [1, -1.5, 0], radius = 0.4 }",
    "moving": "sphere = { center = [0, 90, 0], radius = 1 }\nmotion = [[0, 0, -92, 0], [1, 0, -92, 0]]",
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_obstacles_are_drawn(name, runs, tmp_path):
    def grey() -> float:
        draw_strip(tmp_path / "strip.png", {"affine": runs["affine"]}, n_frames=2)
        return float((np.asarray(Image.open(tmp_path / "strip.png").convert("L"))[20:260] < 250).mean())

    without = grey()
    (runs["affine"].folder / "scene.toml").write_text(f"[[obstacles]]\n{OBSTACLES[name]}\n")
    assert grey() - without > 0.03


MOVING = """[[obstacles]]
sphere = { center = [0, -92, 0], radius = 1 }
motion = [[0, 0, 0, 0], [0.5, 0, 180, 0]]
"""


def covered(run, folder, n_frames):
    """Shares of a strip's panels that are not white."""
    draw_strip(folder / "strip.png", {"affine": run}, n_frames=n_frames)
    strip = np.asarray(Image.open(folder / "strip.png").convert("L"))[24:260]
    return np.array([(panel < 250).mean() for panel in np.split(strip, n_frames, axis=1)])


def test_obstacles_move_as_the_scene_says(runs, tmp_path):
    """The sphere passes below the body at half time, and is far off at the start and the end."""
    without = covered(runs["affine"], tmp_path, 3)
    (runs["affine"].folder / "scene.toml").write_text(MOVING)
    more = covered(runs["affine"], tmp_path, 3) - without
    assert more[1] > 0.03
    assert more[[0, 2]] == pytest.approx([0, 0], abs=1e-3)


def test_small_motion_is_enlarged_but_among_obstacles(ball, tmp_path, monkeypatch):
    for mark in ("add_outline", "_write_scale"):  # which cover a part of the picture, too
        monkeypatch.setattr(film_module, mark, lambda *_: None)
    run = load_run(write_run(tmp_path / "run", *ball, lambda X: 0.01 * X, calibration="affine"))
    # Enlarged, the ball grows to 1.2: by 20, the round number below 0.08 of the box's diagonal over 0.01.
    first, last = covered(run, tmp_path, 2)
    assert last / first == pytest.approx(1.2**2, rel=0.02)
    (run.folder / "scene.toml").write_text(MOVING.replace("[0.5,", "[1,"))
    first, last = covered(run, tmp_path, 2)
    assert last / first == pytest.approx(1.01**2, rel=0.02)


def test_command_names_what_is_missing(tmp_path, capsys):
    assert main([str(tmp_path)]) == 1
    assert "no run.json" in capsys.readouterr().err
