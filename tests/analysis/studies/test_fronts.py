"""Fronts, crossings, levels and words on curves whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from races import measurement, timed

from analysis.front import pareto, seconds_for
from analysis.methods import FEM_P2
from analysis.studies import fronts
from analysis.studies.fronts import best_of, crossovers, curves_of, finding, levels, noise, regimes, winners

# error = seconds^-1 and, ten times as slow at first, seconds^-2 / 10: they meet where t^-1 = 10 t^-2, t = 10, error 0.1.
SPRINGS = [(t, 1 / t) for t in (1.0, 10.0, 100.0, 1000.0)]
ELEMENTS = [(t, 10 / t**2) for t in (4.0, 40.0, 400.0)]


def test_front_is_what_no_other_beats():
    points = [(3, 0.1), (1, 0.5), (2, 0.6), (4, 0.1), (5, 0.05), (1, 0.4)]
    assert [points[i] for i in pareto(points)] == [(1, 0.4), (3, 0.1), (5, 0.05)]
    points = [tuple(point) for point in np.random.default_rng(1).uniform(size=(200, 2))]
    brute_force = {p for p in points if not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)}
    assert {points[i] for i in pareto(points)} == brute_force


def test_seconds_are_interpolated_in_the_logarithms():
    assert seconds_for(SPRINGS, 0.02) == pytest.approx(50)
    assert seconds_for(SPRINGS, 5) == 1
    assert seconds_for(SPRINGS, 1e-4) is None
    assert seconds_for([*SPRINGS, (500.0, 0.9)], 0.02) == pytest.approx(50)  # a bad point beside the front


def test_methods_change_places_where_their_curves_cross():
    parts = winners({"node_averaged": SPRINGS, FEM_P2: ELEMENTS})
    assert [name for name, _, _ in parts] == ["node_averaged", FEM_P2]
    assert parts[0][2] == pytest.approx(0.1, rel=0.05)  # 400 steps over 4 decades


def test_errors_of_no_use_win_nothing():
    curves = {"uniform": [(0.001, 0.9)], "affine": [(1.0, 0.8), (10.0, 0.01)]}
    assert winners(curves) == [("affine", pytest.approx(0.3), pytest.approx(0.01))]
    assert winners({"uniform": [(0.1, 0.9)], "affine": [(1.0, 0.6)]}) == [
        ("affine", pytest.approx(0.6), pytest.approx(0.6))
    ]
    assert winners({}) == []


def race(**curves):
    """A scene's study whose methods have these points (seconds, error)."""
    found = [
        measurement(timed(solve=seconds), errors=[error], method=name)
        for name, curve in curves.items()
        for seconds, error in curve
    ]
    return SimpleNamespace(measurements=found, name="ball", regime="linear statics")


def test_crossovers_name_who_is_fastest_where():
    assert crossovers({"uniform": SPRINGS}) == "springs, uniform is the fastest at every error reached."
    words = crossovers({"node_averaged": SPRINGS, FEM_P2: ELEMENTS})
    assert words.startswith(
        "The fastest is springs, node_averaged down to 10 %, then finite elements, quadratic"
    )
    assert crossovers({}) == "No method gave a result."


def test_levels_have_both_sides_and_the_ratio_of_their_seconds():
    head, rows = levels([race(node_averaged=SPRINGS, fem_p2=ELEMENTS)])
    at = {row[2]: dict(zip(head[3:], row[3:], strict=True)) for row in rows}
    # At 3 %: 33.3 s against sqrt(10 / 0.03) = 18.3 s; at 0.3 %: 333 against 57.7.
    assert at["3 %"]["springs / elements"] == "1.8" and at["0.3 %"]["springs / elements"] == "5.8"
    assert at["3 %"]["springs"] == "springs, node_averaged"
    assert at["3 %"]["elements"] == "finite elements, quadratic"
    assert best_of({"node_averaged": SPRINGS}, 1e-4) == (None, None)
    _, rows = levels([race(uniform=[(1.0, 0.5)], fem_p2=ELEMENTS)])
    assert rows[0][3:5] == ["-", "-"] and rows[0][-1] == "-"
    assert levels([race(uniform=[(1.0, 0.5)])])[1] == [], "neither reaches any error"


def test_finding_says_losses_before_wins_and_how_large_they_are():
    # At 10 % both take 10 s; at 3, 1, 0.3 and 0.1 % springs take longer, at most 1000 / 100 times.
    words = finding([race(node_averaged=SPRINGS, fem_p2=ELEMENTS)])
    assert words == (
        "Linear statics: springs lose 4 of 5 comparisons (by up to 10 times: ball at 0.1 %), win 0 and are level in 1."
    )
    words = finding([race(node_averaged=[(1.0, 0.02)], fem_p2=[(4.0, 0.02), (9.0, 0.009)])])
    assert words == (
        "Linear statics: springs lose 1 of 3 comparisons (the other does not get there), "
        "win 2 (by up to 4 times: ball at 3 %) and are level in 0."
    )
    assert finding([]) == "No method gave a result."


def test_regimes_are_counted_over_their_scenes():
    lost = race(node_averaged=SPRINGS, fem_p2=ELEMENTS)
    won = race(node_averaged=[(1.0, 0.02)], fem_p2=[(4.0, 0.02), (9.0, 0.009)])
    nothing = race(uniform=[(1.0, 0.5)])
    nothing.regime = "large motion"
    assert regimes([lost, nothing, won])[1] == [
        ["linear statics", "8", "5", "10 times: ball at 0.1 %", "2", "4 times: ball at 3 %", "1"]
    ]
    won.regime = "large statics"
    assert [row[:3] for row in regimes([lost, won])[1]] == [
        ["linear statics", "5", "4"],
        ["large statics", "3", "1"],
    ]
    alone = race(uniform=[(1.0, 0.002)])
    assert regimes([alone])[1] == [
        ["linear statics", "4", "0", "-", "4", "the other does not get there", "0"]
    ]


def test_plot_has_errors_over_seconds_and_a_band_of_the_references_own(drawn):
    rungs = [
        measurement(
            timed(setup=9 * s, solve=s, output=5),
            two_threads=timed(solve=2 * s),
            errors=[error],
            reference_error=0.01,
        )
        for s, error in ((1, 0.1), (10, 0.001))
    ]
    study = SimpleNamespace(measurements=rungs, name="ball")
    figure = drawn(fronts).plot(study)
    for axes, seconds in zip(figure.axes, ([10, 100], [1, 10], [2, 20]), strict=True):
        _, curve, _, resolved, hollow = axes.lines
        assert list(curve.get_xdata()) == seconds and list(curve.get_ydata()) == pytest.approx([10, 0.1])
        assert list(resolved.get_xdata()) == seconds[:1] and list(hollow.get_xdata()) == seconds[1:]
        assert hollow.get_markerfacecolor() == "white" != resolved.get_markerfacecolor()
        (band,) = axes.patches
        assert band.get_y() + band.get_height() == pytest.approx(1)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["springs, uniform"]


def test_lines_follow_the_front_alone(drawn):
    rungs = [measurement(timed(solve=s), errors=[e]) for s, e in ((1, 0.1), (2, 0.2), (3, 0.01))]
    whole, *_ = drawn(fronts).plot(SimpleNamespace(measurements=rungs, name="")).axes
    assert list(whole.lines[1].get_xdata()) == [1, 3]


def test_runs_that_waited_for_a_core_are_counted():
    clean, shared = measurement(timed(), timed()), measurement(timed(), timed())
    assert noise([clean]) == "Every timed run had a core for itself."
    shared.timed.pop()
    assert noise([clean, shared]).startswith("1 of 4 timed runs waited")
    shared.timed.pop()
    assert noise([clean, shared]).endswith("left out; 1 rungs have no others.")


def test_plot_has_bars_over_all_seeds(drawn):
    """Of runs of 2, 40 and 3 s, of which 1 s is not the solve, with errors of 20, 10 and 5 %."""
    runs = [timed(setup=1, solve=solve) for solve in (1, 39, 2)]
    rung = measurement(*runs, errors=[0.2, 0.1, 0.05], reference_error=0.06)
    whole, solve = drawn(fronts).plot(SimpleNamespace(name="", measurements=[rung])).axes
    for axes, seconds in ((whole, (2, 3, 40)), (solve, (1, 2, 39))):
        across, up = (bars.get_segments()[0] for bars in axes.containers[0].lines[2])
        np.testing.assert_allclose(across, [[seconds[0], 10], [seconds[2], 10]])
        np.testing.assert_allclose(up, [[seconds[1], 5], [seconds[1], 20]])


def test_table_has_the_seconds_of_every_stage():
    """Adaption, set-up and assembly count as set-up; a rung without a run has its message alone."""
    rungs = [
        measurement(timed(mesh=0.25, adapt=2, setup=0.5, assemble=1, solve=5), errors=[0.1]),
        measurement(message="not made"),
    ]
    scene = SimpleNamespace(measurements=rungs, overrides=lambda _: ["surface.n_vertices=162"])
    head, (row, unmade) = fronts.table(scene)
    cells = dict(zip(head, row, strict=True))
    stages = [cells[f"{stage} (s)"] for stage in ("mesh", "set-up", "solve", "whole")]
    assert stages == ["0.25", "3.5", "5", "8.75"]
    assert unmade[1] == "162" and unmade[-1] == "not made" and set(unmade[4:-1]) == {"-"}


def test_errors_below_the_references_own_count_as_that():
    known = [
        measurement(timed(solve=2), errors=[e], reference_error=r)
        for e, r in ((0.2, 0.1), (0.1, 0.2), (0.3, None))
    ]
    assert curves_of(known) == {"uniform": [(2, 0.2), (2, 0.2), (2, 0.3)]}
