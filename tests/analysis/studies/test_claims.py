"""Verdicts on the paper's claims, and figure 11 as published, from runs whose answer is known."""

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import write_run

from analysis.paths import SCENES
from analysis.reproduce import tables_of
from analysis.runs import Frame, RunError, load_frames, load_run
from analysis.studies import claims, paper, published


def test_medians_decide_what_rises():
    assert claims.is_rising([[1, 9, 1], [2, 2, 0], [3]])
    assert not claims.is_rising([[1], [1]])
    assert not claims.is_rising([[1], []])


def test_range_has_two_digits_and_one_end_where_both_agree():
    assert claims.span([1.234, 5.678], " %") == "1.2 to 5.7 %"
    assert claims.span([2, 2.001]) == "2"
    assert claims.span([]) == "no run was solved"


def test_roughness_of_a_ball_is_one(ball, tmp_path):
    write_run(tmp_path / "run", *ball, lambda X: 0 * X, np.linspace(0, 1, 2), calibration="uniform")
    run = load_run(tmp_path / "run")
    run.curves["volume"][-1], run.curves["area"][-1] = 4 / 3 * np.pi * 8, 4 * np.pi * 4
    assert claims.roughness(run) == pytest.approx(1)


def test_error_is_relative_to_the_reference(ball, tmp_path):
    """Springs that move three times as far are off by 200 %, not by 67 %."""
    for name, field in (("springs", lambda X: 0.3 * X), ("reference", lambda X: 0.1 * X)):
        write_run(tmp_path / name, *ball, field, calibration="uniform")
    error = claims.error_against(load_run(tmp_path / "reference"))
    assert error(SimpleNamespace(folder=tmp_path / "springs")) == pytest.approx(200)


def test_depletion_of_a_second_is_that_of_the_steps_in_it():
    for name in paper.FIGURE_11:
        scene = SCENES / f"{name}.toml"
        own = tomllib.loads(scene.read_text())
        step = own["time"]["step"]
        for part in (1, 0.5):
            words = dict(w.split("=") for w in published.overrides_of(scene, "implicit_euler", part))
            assert words["paper"] == "true"
            assert float(words["time.step"]) == pytest.approx(step * part)
            if "collapse" in own:
                left = (1 - float(words["collapse.coefficient"])) ** (1 / step)
                assert left == pytest.approx(1 - own["collapse"]["coefficient"], rel=1e-6)


def test_rates_of_table_1_stand_beside_the_papers_of_the_same_scheme():
    rates = {"explicit_euler": (1.0, 3.0, 2.0), "implicit_euler": (10.0, 30.0, 20.0)}
    rows = [
        {"run_name": f"torus/{scheme}/soft/repeats:3", "FPS": rate, "nodes": 7, "springs": 9}
        for scheme, values in rates.items()
        for rate in values
    ]
    head, lines = paper.table_1(rows)
    (torus,) = [dict(zip(head, line, strict=True)) for line in lines if line[0] == "torus"]
    _, springs, explicit, implicit = paper.PUBLISHED["torus"]
    assert torus["springs, the paper"] == str(springs)
    for scheme, own, theirs in ((claims.EXPLICIT, "2", explicit), (claims.IMPLICIT, "20", implicit)):
        assert (torus[scheme], torus[f"{scheme}, the paper"]) == (own, f"{theirs:.2f}")


def test_film_goes_there_and_back_by_every_warp(ball, tmp_path):
    """From the later start to the earlier end; the explosion has shown half of it after an eighth of its time."""
    runs = []
    for number, times in enumerate((np.linspace(0, 1, 5), np.linspace(0.5, 3, 5))):
        write_run(tmp_path / str(number), *ball, lambda X: 0 * X, times, calibration="uniform")
        runs.append(load_frames(tmp_path / str(number)))
    forwards, constant, elastic, explode = np.split(published.there_and_back(*runs), 4)
    assert forwards == pytest.approx(np.linspace(0.5, 1, len(forwards)))
    assert constant == pytest.approx(forwards[::-1])
    for back in (elastic, explode):
        assert (back[0], back[-1]) == (1, 0.5) and (np.diff(back) < 0).all()
    assert (elastic[1] > constant[1]) and (explode[len(explode) // 8 + 1] < 0.75)


def test_far_side_answers_when_it_has_lost_a_tenth_of_its_speed(ball, tmp_path):
    """A ball at 2 m/s stops as a whole at 0.1 s; another slows down evenly within 0.2 s; a third goes on, its nodes swinging to
    the left and right."""
    X, F = ball
    times = np.linspace(0, 0.2, 101)
    side = np.where(np.arange(len(X) + 3) % 2, 0.5, -0.5)
    fields = {
        "stops": (lambda X: 0 * X + [0, 1, 0], lambda time: -2 * min(time, 0.1)),
        "slows": (lambda X: 0 * X + [0, 1, 0], lambda time: -2 * time + 5 * time**2),
        "swings": (lambda X: 0 * X + [0, 1, 0] + side[: len(X), None] * [1, 0, 0], lambda time: -2 * time),
    }
    found = {}
    for name, (field, amplitude) in fields.items():
        write_run(tmp_path / name, X, F, field, times, amplitude, calibration="uniform")
        found[name] = claims.answer_and_oscillation(load_run(tmp_path / name))
    assert found["stops"] == pytest.approx((101, 0))
    assert found["slows"][0] == pytest.approx(21), "in the middle of the first two frames below 1.8 m/s"
    assert found["swings"] == pytest.approx((np.inf, np.var(side[: len(X)])))


def test_frames_count_until_the_body_is_far_away(ball, tmp_path):
    """Moved by 0, 1.03, 2.07 and 3.1 of its diagonals; two are far."""
    size = np.linalg.norm(np.ptp(ball[0], axis=0))
    times = np.linspace(0, 1, 4)
    write_run(tmp_path / "run", *ball, lambda X: 0 * X + [3.1 * size, 0, 0], times, calibration="uniform")
    run = published.sound_part(load_frames(tmp_path / "run"))
    assert list(run.times) == pytest.approx(times[: len(run.times)])
    assert len(run.times) == len(run.curves["time"]) == 2


@pytest.mark.parametrize(
    "error, holding", [(lambda n: 1 / n, {"convincing", "accuracy"}), (lambda n: n, {"dense"})]
)
def test_links_and_nodes_are_worth_what_the_error_falls_by(error, holding, monkeypatch):
    """Of runs whose error and springs follow from the number of links or of nodes inside."""

    class Known:
        store = None

        def values(self, _, overrides, measure):
            words = dict(word.split("=") for word in overrides)
            n = float(words.get("network.multiplicity") or words.get("network.k") or 1)
            return [error(n) if measure == "error" else n]

    monkeypatch.setattr(claims, "reference_of", lambda *_: SimpleNamespace(folder=None))
    monkeypatch.setattr(claims, "load_run", lambda _: None)
    monkeypatch.setattr(claims, "error_against", lambda _: "error")
    found = {claim.claim.split()[-1]: claim.verdict for claim in claims.of_network(Known())}
    assert found["shell"] == claims.FAILS and found["slower"] == claims.HOLDS
    for name in ("convincing", "accuracy", "dense"):
        assert found[name] == (claims.HOLDS if name in holding else claims.FAILS), name


def test_each_iteration_of_bi_conjugate_gradients_takes_two_products():
    """Of two seeds, which take 11 and 18 iterations where conjugate gradients take 10 and 20."""

    class Known:
        seeds = (1, 2)

        def values(self, _, overrides, __):
            return {"time.linear_solver=cg": [10, 20], "time.linear_solver=bicg": [11, 18]}.get(
                overrides[-1], [1, 1]
            )

        def n_ok(self, *_):
            return 2

    (found,) = (claim for claim in claims.of_steps(Known()) if "bi-conjugate" in claim.claim)
    assert found.measured == "products over those of conjugate gradients: 1.8 to 2.2"
    assert found.verdict == "holds within 10%"


def test_longest_stable_step_is_twice_that_which_is_taken():
    """Explicit runs take a quarter of a millisecond on the surface, half of one with a node inside, and 0.75 ms with PCP."""

    class Known:
        seeds = (1,)

        def values(self, _, overrides, measure):
            step = {"surface": 0.25e-3, "central": 0.5e-3, "pcp": 0.75e-3}.get(
                overrides[-1].partition("=")[2]
            )
            return [measure(SimpleNamespace(record={"step": step}))] if step else [1]

        def n_ok(self, *_):
            return 1

    found = claims.of_steps(Known())[0]
    assert found.measured == "longest stable step, surface, one central node, PCP: 0.5 ms; 1 ms; 1.5 ms"
    assert found.verdict == claims.HOLDS


def test_claims_of_other_studies_are_read_from_their_tables():
    page = claims.RESULTS.read_text()
    _, stored = tables_of((claims.PACKAGE / "CLAIMS.md").read_text(), "The PCP paper, claim by claim")[0][1]
    for claim in claims.of_tables(page):
        assert list(claim) in stored
    wild, real_time, costly, realistic, cheap = claims.of_tables(PAGE)
    verdicts = [claim.verdict for claim in claims.of_tables(PAGE)]
    assert verdicts == [claims.FAILS, claims.HOLDS, claims.FAILS, claims.FAILS, claims.HOLDS]
    assert realistic.measured == "its outlines are 21 to 53 % off those of finite elements"
    assert cheap.measured == "CPU seconds over those of linear elements: 0.25 to 0.5"
    assert claims.of_tables(PAGE.replace("53", "1").replace("21", "4"))[3].verdict == claims.HOLDS
    assert claims.of_tables(PAGE.replace("| 4 | 21", "| 24 | 21"))[4].verdict == claims.FAILS
    assert wild.measured == "25 of 210 starts gain energy"
    assert real_time.measured == "4397 nodes: 6260 and 543 frames a second on one core"
    assert costly.measured == "its network errs by 5 to 130 % in statics"
    assert claims.of_tables(PAGE.replace("| 180 | 5 | 25 |", "| 205 | 5 | 0 |"))[0].verdict == claims.HOLDS
    assert claims.of_tables(PAGE.replace("543", "12"))[1].verdict == claims.FAILS
    assert claims.of_tables(PAGE.replace("130 %", "4 %").replace("75", "2"))[2].verdict == claims.HOLDS
    with pytest.raises(RunError, match="no row 'head'"):
        claims.of_tables(PAGE.replace("| head |", "| hat |"))
    with pytest.raises(RunError, match="no table under '6 Stability'"):
        claims.of_tables(PAGE.replace("# 6 Stability", "# 6"))


PAGE = """# 1 Statics at small strain

| scene or body | uniform on PCP | reference |
|---|---|---|
| a | 130 % | - |
| b | rounding | - |
| c | 5 % | - |
| d | 75 % | - |

# 6 Stability

| method | sound | short | energy gained |
|---|---|---|---|
| linearised implicit Euler (the paper) | 180 | 5 | 25 |

# 7 The paper's figures and table

| | nodes | explicit Euler | linearised implicit Euler |
|---|---|---|---|
| head | 4397 | 6 260 (5.14) | 543 (0.23) |

# 11 The paper's scenes

| scene | method | status | CPU s | silhouette |
|---|---|---|---|---|
| a | finite elements, linear | ok | 16 | 0 |
| a | springs, uniform, as published | ok | 4 | 21 % |
| b | finite elements, linear | ok | 10 | 3 % |
| b | springs, uniform, as published | ok | 5 | 53 % |
| c | finite elements, linear | ok | 10 | 3 % |
| c | springs, uniform, as published | energy_gained | 1 | 90 % |
"""


@pytest.mark.parametrize("axis, found", [(0, 0), (1, 100 * np.sqrt(2))])
def test_shapes_on_the_way_back_are_set_beside_those_of_equal_volume(ball, axis, found):
    """A ball is pressed along x to half its volume, and grows back along x or along y."""
    X, F = ball
    times = np.linspace(0, 1, 9)

    def frame(k):
        u, depth = np.zeros_like(X), 0.5 * (1 - abs(2 * times[k] - 1))
        side = 0 if k <= 4 else axis
        u[:, side] = -depth * X[:, side]
        return Frame(X, u, F)

    run = SimpleNamespace(times=times, frame=frame)
    assert claims.difference_on_the_way_back(run) == pytest.approx(found, abs=1e-6, rel=0.01)
