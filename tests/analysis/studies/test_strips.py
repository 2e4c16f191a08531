"""Strips of motions whose differences are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from solvers import Backwards
from synthetic import write_run

from analysis.methods import FEM_P1, FEM_P2, label_of
from analysis.paths import SCENES
from analysis.run_store import Outcome, made_by
from analysis.runs import RunError, load_frames
from analysis.studies import strips

SIZE = 2 * np.sqrt(3)  # of a ball of radius 1


def motion(folder, ball, displacement, times=None):
    times = np.linspace(0, 1, 5) if times is None else times
    write_run(folder, *ball, displacement, times, calibration="uniform")
    return load_frames(folder)


def test_a_motion_differs_from_itself_by_nothing(ball, tmp_path):
    run = motion(tmp_path / "a", ball, lambda X: 0.1 * X)
    found = strips.differences(run, run)
    assert max(vars(found).values()) < 1e-12


def test_a_body_beside_another_differs_by_the_way_between(ball, tmp_path):
    """Displacements grow evenly over time, so that the mean over four frames of five is 5/8 of the last."""
    still = motion(tmp_path / "a", ball, lambda X: 0 * X)
    moved = motion(tmp_path / "b", ball, lambda X: 0 * X + [0.2, 0, 0])
    found = strips.differences(moved, still, 4)
    assert found.centre == pytest.approx(0.2 * 5 / 8 / SIZE, rel=1e-2)
    assert found.volume < 1e-12 and found.area < 1e-12 and found.inertia < 1e-9
    assert 0 < found.mean_distance < found.hausdorff <= 0.2 * 5 / 8 / SIZE + 1e-2


def test_a_body_that_grows_differs_by_its_volume(ball, tmp_path):
    still = motion(tmp_path / "a", ball, lambda X: 0 * X)
    grown = motion(tmp_path / "b", ball, lambda X: 0.1 * X)
    found = strips.differences(grown, still, 1)
    assert found.volume == pytest.approx(1.1**3 - 1, rel=1e-9)
    assert found.area == pytest.approx(1.1**2 - 1, rel=1e-9)
    assert found.inertia == pytest.approx(1.1**5 - 1, rel=1e-9)
    assert found.silhouette == pytest.approx(1 - 1 / 1.1**2, rel=1e-6)
    assert found.mean_distance == pytest.approx(0.1 / SIZE, rel=2e-2)


def test_motions_are_compared_to_the_end_of_the_one_that_ends_first(ball, tmp_path):
    """Both move alike, one for half as long; what comes after is no difference."""
    short, whole = (
        motion(tmp_path / name, ball, lambda X, to=to: [0.1 * to, 0, 0] + 0 * X, np.linspace(0, 1, 5) * to)
        for name, to in (("short", 0.5), ("whole", 1.0))
    )
    for run, referee in ((short, whole), (whole, short)):
        assert strips.shared_times(run, referee, 2) == pytest.approx([0.25, 0.5])


def test_contact_and_energy_differ_by_a_part_of_the_referees_largest(ball, tmp_path):
    """Springs store what elements store in solid and skin, and 1 J more at the end; elements press by 5 and 13 N."""
    still = motion(tmp_path / "a", ball, lambda X: 0 * X, np.array([0.0, 1.0]))
    none = {"time": np.array([0.0, 1]), "kinetic_energy": np.array([0.0, 2])}
    press = {f"obstacle_{k}_force_{axis}": np.array([0.0, of]) for k, force in enumerate(((3, 4, 0), (0, 5, 12)))
             for axis, of in zip("xyz", force, strict=True)}  # fmt: skip
    elements = none | press | {
        "elastic_energy": np.array([0.0, 3]), "membrane_energy": np.array([0.0, 1]), "surface_energy": np.array([0.0, 4]),
        "obstacle_0_area": np.array([0.0, 1]), "obstacle_1_area": np.array([0.0, 3]),
    }  # fmt: skip
    springs = none | {name: 0.5 * of for name, of in press.items()} | {
        "elastic_energy": np.array([0.0, 9]), "obstacle_0_area": np.array([0.0, 4]), "obstacle_1_area": np.array([0.0, 1]),
    }  # fmt: skip
    a, b, c = (replace(still, curves=of) for of in (springs, elements, none))
    assert strips.contact_and_energy(b)["contact force"][-1] == pytest.approx(5 + 13)
    assert strips.curve_differences(a, b, 1) == pytest.approx(
        {"kinetic energy": 0, "stored energy": 1 / 8, "contact force": 1 / 2, "in touch": 1 / 4}
    )
    assert strips.curve_differences(c, b, 2) == {"kinetic energy": 0}
    assert strips.curve_differences(a, b, 2)["stored energy"] == pytest.approx((1 + 0.5) / 2 / 8)


def test_surfaces_between_frames_are_linear_in_time(ball, tmp_path):
    run = motion(tmp_path / "a", ball, lambda X: 0.4 * X, np.linspace(0, 1, 2))
    X, _ = strips.surface_at(run, 0.25)
    assert X == pytest.approx(1.1 * run.frame(0).X)
    assert strips.surface_at(run, 9.0)[0] == pytest.approx(1.4 * run.frame(0).X)


def test_a_run_of_one_frame_is_refused(ball, tmp_path):
    run = motion(tmp_path / "a", ball, lambda X: 0 * X, np.array([0.0]))
    with pytest.raises(RunError, match="two frames"):
        strips.differences(run, run)


def test_copies_move_inwards_by_a_part_of_an_edge_and_by_their_name(ball):
    X, F = ball
    moved = strips.jittered(X, F, "a_1")
    edges = np.linalg.norm(X[F] - X[np.roll(F, 1, axis=1)], axis=2).mean()
    way = np.linalg.norm(moved - X, axis=1)
    assert np.sqrt((way**2).mean()) == pytest.approx(1e-3 * edges, rel=0.2)
    assert np.linalg.norm(X, axis=1) - np.linalg.norm(moved, axis=1) == pytest.approx(way, rel=1e-2)
    assert (moved == strips.jittered(X, F, "a_1")).all()
    assert (moved != strips.jittered(X, F, "a_2")).any()


def test_copies_run_on_surfaces_of_their_own(ball, tmp_path):
    asked = []

    def run(_method, words):
        asked.append(words)
        return SimpleNamespace(status="late")

    rest = SimpleNamespace(X=ball[0], F=ball[1])
    strip = SimpleNamespace(
        scene=SimpleNamespace(stem="s"), runs={"m": SimpleNamespace(frame=lambda _: rest)}, run=run
    )
    assert strips.Strip.copies(strip, "m", 2, tmp_path) == []
    assert {words[0] for words in asked} == {f'surface.file="{tmp_path / f"s_{n}.obj"}"' for n in (0, 1)}
    moved = [line for line in (tmp_path / "s_0.obj").read_text().splitlines() if line.startswith("v ")]
    assert len(moved) == len(ball[0])


@pytest.mark.parametrize(
    "ends, referee",
    [
        ({FEM_P1: "ok", FEM_P2: "ok"}, FEM_P2),
        ({FEM_P1: "ok", FEM_P2: "time limit"}, FEM_P1),
        ({FEM_P1: "not_converged", FEM_P2: "not_converged"}, None),
    ],
)
def test_the_finest_elements_that_came_to_the_end_judge(ends, referee):
    strip = strips.Strip(SimpleNamespace(stem="scene"), None, [])
    strip.outcomes = {method: Outcome(status, "", 1, 1, 0) for method, status in ends.items()}
    assert strip.referee == referee


def test_chance_names_who_scatters(monkeypatch, ball):
    """Copies of springs lie 0.1 of the size apart, those of elements 0.01, the pairs of both 5."""
    ends = {"node_averaged": (0.0, 0.1, 0.2, 0.3), FEM_P1: (5.0, 5.01, 5.02, 5.03)}
    strip = SimpleNamespace(
        scene=SimpleNamespace(stem="scene"),
        copies=lambda method, n, folder: [(ball[0] + [at, 0, 0], ball[1]) for at in ends[method]],
    )
    size = strips.size_of(ball[0])

    def apart(a, b):
        return SimpleNamespace(mean=size * abs(a[0] - b[0]).max())

    monkeypatch.setattr(strips, "surface_distance", apart)
    row = strips.chance_row("scene", strips.chance(strip, 4, None))
    assert dict(zip(strips.CHANCE, row, strict=True)) == {
        "scene": "scene",
        "two of springs, node_averaged": "17 %",
        "two of finite elements, linear": "1.7 %",
        "one of each": "490 %",
        "chance does as much": "2.9 %",
    }


def test_chance_is_not_told_of_too_few_ends():
    strip = SimpleNamespace(copies=lambda method, n, folder: [None])
    assert strips.chance_row("scene", strips.chance(strip, 1, None)) == ["scene", "-", "-", "-", "-"]


def test_steps_tell_what_the_scheme_takes_of_the_work_and_how_far_methods_are_apart(
    monkeypatch, ball, tmp_path
):
    """Of work 3 + 1 J springs lose 1 J and elements 2 J; in half the step half of it, and they lie as far apart."""
    made, runs = [], {}

    def run(strip, method, overrides=()):
        made.append((method, tuple(overrides)))
        lost, at = (1, 0.0) if method == "node_averaged" else (2, 0.1)
        folder = tmp_path / str(len(made))
        motion(folder, ball, lambda X: 0 * X + [at, 0, 0])
        curves = {
            "work_of_loads": [0, 3],
            "work_of_rest": [0, 1],
            "lost_to_scheme": [0, lost / (1 + len(overrides))],
        }
        runs[folder] = replace(load_frames(folder), curves=curves)
        return Outcome("ok", "", 1, 1, 0, folder)

    monkeypatch.setattr(strips.Strip, "run", run)
    monkeypatch.setattr(strips, "load_frames", runs.__getitem__)
    rows = strips.step_rows(strips.Strip(SCENES / "handle_folds.toml", None, []))
    assert [row[:4] for row in rows] == [
        ["handle_folds", "5", "25 %", "50 %"],
        ["handle_folds", "2.5", "12 %", "25 %"],
    ]
    assert rows[0][4] == rows[1][4] != "0 %"
    assert made == [
        (method, of) for of in ((), ("time.step=0.0025",)) for method in ("node_averaged", FEM_P1)
    ]


def test_runs_of_all_strips_are_made_by_the_engine(tmp_path, monkeypatch):
    """Beside each other, and listed scene by scene."""
    made = []

    def run(strip, method, overrides=()):
        made.append((strip.scene.stem, label_of(method)))
        return Outcome("time limit", str(overrides), 1, 1, 0, tmp_path)

    monkeypatch.setattr(strips.Strip, "run", run)
    scenes = [SCENES / f"{name}.toml" for name in ("torus_implodes", "ball_deflates")]
    tables, sections = strips.compare(scenes, None, tmp_path, without=(FEM_P2,))
    rows = tables["strips"][1]
    in_order = [(row[0], row[1]) for row in rows]
    assert made == in_order and label_of(FEM_P2) not in {method for _, method in made}
    assert [name for name, _ in in_order] == sorted((name for name, _ in in_order), reverse=True)
    assert {row[2] for row in rows} == {"time limit"} and [s.title for s in sections] == [
        s.stem for s in scenes
    ]
    made.clear()
    with made_by(Backwards()):
        again, _ = strips.compare(scenes, None, tmp_path, without=(FEM_P2,))
    assert again == tables and made == in_order[::-1]
