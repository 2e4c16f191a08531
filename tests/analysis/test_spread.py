"""What is said of two solvers whose runs are drawn from known distributions."""

import numpy as np
import pytest

from analysis.spread import LEVEL, spread, statement


def gap(a, b):
    return abs(a - b)


def test_distances_are_means_over_pairs_of_runs():
    found = spread([0.0, 1.0, 5.0], [10.0, 12.0], gap)
    assert found.between == pytest.approx(np.mean([10, 12, 9, 11, 5, 7]))
    assert found.first == pytest.approx(np.mean([1, 5, 4])) and found.second == pytest.approx(2)


def test_solvers_apart_are_told_from_one_by_the_least_probability_there_is():
    found = spread([0.0, 0.1, 0.2, 0.3], [5.0, 5.1, 5.2, 5.3], gap)
    assert found.probability == found.least == pytest.approx(2 / 70)
    assert found.differ is True
    unequal = spread([0.0, 0.1, 0.2], [5.0, 5.1, 5.2, 5.3], gap)
    assert unequal.probability == unequal.least == pytest.approx(1 / 35)


def test_few_runs_tell_nothing():
    found = spread([0.0, 0.1], [9.0, 9.1], gap)
    assert found.least == pytest.approx(2 / 6) and found.differ is None
    with pytest.raises(ValueError, match="1 and 3 runs, expected two of each solver at least"):
        spread([0.0], [1.0, 2.0, 3.0], gap)


@pytest.mark.parametrize("n", [5, 12])
def test_one_solver_is_taken_for_two_as_rarely_as_is_said(n):
    """Of 12 runs each the ways to deal them out are drawn by chance."""
    random = np.random.default_rng(1)
    alarms = [spread(*random.normal(size=(2, n)), gap).differ for _ in range(60 if n == 12 else 300)]
    assert np.mean(alarms) == pytest.approx(LEVEL, abs=0.05)
    assert any(alarms) or n == 12


def test_a_difference_in_scatter_alone_is_a_difference_too():
    random = np.random.default_rng(2)
    for n, m in ((10, 10), (8, 12)):
        assert spread(random.normal(size=n), 30 * random.normal(size=m), gap).differ is True


def test_statement_tells_distances_and_chance():
    apart = spread([0.0, 0.1, 0.2, 0.3], [5.0, 5.1, 5.2, 5.3], gap)
    assert statement(apart, "springs", "elements", "mm") == (
        "Runs of springs and elements are 5 mm apart in the mean, two of springs 0.17 mm and two of elements 0.17 mm: "
        "the solvers differ, as chance does as much in 2.9 % of cases."
    )
    mixed = spread([0.0, 0.2, 0.4, 0.6], [0.1, 0.3, 0.5, 0.7], gap)
    assert ": no difference is shown, as chance does as much in " in statement(mixed, "a", "b", "m")
    few = spread([0.0, 0.1], [9.0, 9.1], gap)
    assert statement(few, "a", "b", "m").endswith("0.1 m: too few to tell a difference from chance.")
