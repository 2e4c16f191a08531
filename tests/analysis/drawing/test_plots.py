"""What plots draw of curves, errors and seconds that are given."""

import numpy as np
import pytest

from analysis.drawing import plots
from analysis.methods import REFERENCE, label_of


def points_of(line):
    return list(line.get_xdata()), list(line.get_ydata())


def test_volume_is_drawn_in_percent_with_its_difference_at_the_references_times(drawn):
    curves = {
        REFERENCE: (np.array([0, 0.5, 1]), np.array([0, -0.02, -0.01])),
        "affine": (np.array([0.0, 1]), np.array([0, -0.04])),
    }
    above, below = drawn(plots).plot_volume(curves, "time (s)").axes
    assert points_of(above.lines[0]) == ([0, 0.5, 1], [0, -2, -1])
    assert points_of(above.lines[1]) == ([0, 1], [0, -4])
    difference, zero = below.lines
    assert points_of(difference) == ([0, 0.5, 1], pytest.approx([0, 0, -3]))
    assert list(zero.get_ydata()) == [0, 0]
    assert below.get_xlabel() == "time (s)"
    (alone,) = plots.plot_volume({"affine": curves["affine"]}, "time (s)").axes
    assert points_of(alone.lines[0]) == ([0, 1], [0, -4]) and alone.get_xlabel() == "time (s)"


def test_errors_are_drawn_in_percent_above_a_band_of_the_references_own(drawn):
    (axes,) = drawn(plots).plot_errors({"affine": 0.2, "lloyd": 0.0}, 0.01).axes
    affine, lloyd, band = axes.patches
    assert [bar.get_width() for bar in (affine, lloyd)] == pytest.approx([20, plots.SMALLEST])
    assert band.get_x() + band.get_width() == pytest.approx(1)
    assert [label.get_text() for label in axes.get_yticklabels()] == [label_of("affine"), label_of("lloyd")]


@pytest.mark.filterwarnings("error")
def test_references_own_error_is_drawn_where_every_model_failed(drawn):
    (axes,) = drawn(plots).plot_errors({}, 0.02).axes
    (band,) = axes.patches
    assert 0 < axes.get_xlim()[0] < 2 and band.get_x() == pytest.approx(axes.get_xlim()[0])
    assert band.get_x() + band.get_width() == pytest.approx(2) and axes.get_xlim()[1] > 2
    assert not plots.plot_errors({}, None).axes[0].patches


def test_seconds_are_drawn_by_stage_and_in_total(drawn):
    seconds = {"affine": {"solve": 4.0, "mesh": 1.0}, REFERENCE: {"mesh": 2.0, "assemble": 3.0, "solve": 5.0}}
    (axes,) = drawn(plots).plot_times(seconds).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["mesh", "assemble", "solve", "total"]
    assert [bar.get_width() for bar in axes.patches] == [1, 0, 4, 5, 2, 3, 5, 10]
    # Every bar stands at its row, the methods' beside each other.
    rows = [round(bar.get_y() + bar.get_height() / 2) for bar in axes.patches]
    assert rows == [0, 1, 2, 3] * 2
