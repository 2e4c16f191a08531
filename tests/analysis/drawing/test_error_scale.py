"""A colour is the same error in every picture, and changes its kind where a verdict does."""

import colorsys

import numpy as np
import pytest

from analysis.drawing import error_scale
from analysis.drawing.error_scale import LEAST, MOST, TICKS, colour_of
from analysis.verdict import FAILS, SERVES


def hue(error):
    """Degrees, of the colour of an error (%)."""
    return 360 * colorsys.rgb_to_hsv(*colour_of(error))[0]


@pytest.mark.parametrize("mark", [100 * SERVES, 100 * FAILS])
def test_colours_change_where_a_verdict_does(mark):
    below, above = (np.array(colour_of(share * mark)) for share in (0.985, 1.015))
    nearer = np.array(colour_of(0.955 * mark))
    assert np.abs(above - below).max() > 0.3 > 10 * np.abs(below - nearer).max()
    assert mark in TICKS


def test_what_serves_is_blue_what_does_not_is_red_and_yellow_lies_between():
    assert all(200 < hue(error) < 220 for error in np.geomspace(LEAST, 4.9, 20))
    assert all(25 < hue(error) < 50 for error in np.geomspace(5.1, 19.5, 20))
    assert all(hue(error) < 10 or hue(error) > 340 for error in np.geomspace(20.5, MOST, 20))


@pytest.mark.parametrize("low, high", [(LEAST, 4.9), (5.1, 19.5), (20.5, MOST)])
def test_colours_darken_within_each_part(low, high):
    darkness = [-np.dot((0.2126, 0.7152, 0.0722), colour_of(error)) for error in np.geomspace(low, high, 30)]
    assert darkness == sorted(darkness)


def test_scale_is_logarithmic_and_ends_hold_all_beyond():
    assert colour_of(0.001) == colour_of(LEAST) and colour_of(400) == colour_of(MOST)
    quarter = [np.array(colour_of(0.1 * 50**share)) for share in (0, 0.25, 0.499, 0.75)]
    steps = np.diff(quarter, axis=0)
    assert steps == pytest.approx(np.broadcast_to(steps[0], steps.shape), abs=0.01)


def test_bar_of_the_scale_names_its_marks(drawn):
    (axes,) = drawn(error_scale).scale_svg().axes
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.1", "1", "5", "20", "100"]
    assert axes.get_xscale() == "log" and axes.get_xlim() == pytest.approx((LEAST, MOST))
    assert [line.get_xdata()[0] for line in axes.lines] == [5, 20]
    assert [text.get_text() for text in axes.texts] == ["serves", "in between", "does not serve"]
