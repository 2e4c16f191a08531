"""What plots draw of curves, errors and seconds that are given."""

import numpy as np
import pytest

from analysis.drawing import plots
from analysis.methods import REFERENCE, label_of


def points_of(line):
    return list(line.get_xdata()), list(line.get_ydata())


def test_curves_are_drawn_with_their_difference_at_the_references_times(drawn):
    curves = {
        REFERENCE: (np.array([0, 0.5, 1]), np.array([0, -0.02, -0.01])),
        "affine": (np.array([0.0, 1]), np.array([0, -0.04])),
        "lloyd": (np.array([0.0, 0.5]), np.array([0, -0.01])),  # stopped
    }
    panels = [plots.Panel("volume (%)", 100, curves), plots.Panel("tip (m)", 1, curves)]
    above, beside, below, _ = drawn(plots).plot_curves(panels, "time (s)").svg().axes
    assert points_of(above.lines[0]) == ([0, 0.5, 1], [0, -2, -1])
    assert points_of(above.lines[1]) == ([0, 1], [0, -4])
    assert points_of(beside.lines[1]) == ([0, 1], [0, -0.04])
    affine, lloyd, zero = below.lines
    assert points_of(affine) == ([0, 0.5, 1], pytest.approx([0, 0, -3]))
    assert points_of(lloyd) == ([0, 0.5], pytest.approx([0, 1]))
    assert list(zero.get_ydata()) == [0, 0]
    assert below.get_xlabel() == "time (s)" and above.get_ylabel() == "volume (%)"
    alone = [plots.Panel("volume (%)", 100, {"affine": curves["affine"]})]
    (only,) = plots.plot_curves(alone, "time (s)").svg().axes
    assert points_of(only.lines[0]) == ([0, 1], [0, -4]) and only.get_xlabel() == "time (s)"


def test_errors_are_points_in_percent_with_a_band_up_to_the_references_own(drawn):
    errors = {"affine": (0.2, 0.3), "lloyd": (0.0, 0.1)}
    (axes,) = drawn(plots).plot_errors(errors, 0.01).svg().axes
    filled, hollow = axes.lines[2::3], axes.lines[1::3]
    assert [points_of(line) for line in filled] == [([20], [0]), ([plots.SMALLEST], [1])]
    assert [points_of(line) for line in hollow] == [([30], [0]), ([10], [1])]
    assert [text.get_text() for text in axes.texts] == ["20 %", "0 %"]
    (band,) = axes.patches
    assert band.get_x() + band.get_width() == pytest.approx(1)
    assert [label.get_text() for label in axes.get_yticklabels()] == [label_of("affine"), label_of("lloyd")]
    assert axes.get_ylim() == (1.5, -0.5)  # the first on top


@pytest.mark.filterwarnings("error")
def test_references_own_error_is_drawn_where_every_model_failed(drawn):
    (axes,) = drawn(plots).plot_errors({}, 0.02).svg().axes
    (band,) = axes.patches
    assert 0 < axes.get_xlim()[0] < 2 and band.get_x() == pytest.approx(axes.get_xlim()[0])
    assert band.get_x() + band.get_width() == pytest.approx(2) and axes.get_xlim()[1] > 2
    assert not plots.plot_errors({}, None).svg().axes[0].patches


def test_seconds_are_one_bar_a_method_of_its_stages(drawn):
    seconds = {"affine": {"solve": 4.0, "mesh": 1.0}, REFERENCE: {"mesh": 2.0, "assemble": 3.0, "solve": 5.0}}
    (axes,) = drawn(plots).plot_times(seconds).svg().axes
    bars = {
        bar.get_label(): [(part.get_x(), part.get_width()) for part in bar.patches] for bar in axes.containers
    }
    assert bars == {
        "mesh": [(0, 1), (0, 2)],
        "assemble": [(1, 0), (2, 3)],
        "solve": [(1, 4), (5, 5)],
    }
    assert [text.get_text() for text in axes.texts] == ["5 s", "10 s"]
    assert [label.get_text() for label in axes.get_yticklabels()] == [label_of("affine"), label_of(REFERENCE)]
    assert axes.get_xscale() == "linear" and axes.get_xlim() == (0, pytest.approx(11.5))
    assert axes.yaxis_inverted()


def test_errors_over_the_surface_are_shares_of_its_area(drawn):
    areas = np.array([1.0, 1, 6, 2])
    errors = {"affine": np.array([5.0, 40, 20, 0.001]), "lloyd": np.full(4, 1e-9)}
    labels = {"affine": "a", "lloyd": "b"}
    (axes,) = drawn(plots).plot_errors_over_surface(errors, areas, labels).axes
    line, *marks = axes.lines  # what lies below the least is on the axis
    assert [mark.get_xdata()[0] for mark in marks] == [5, 20]
    assert points_of(line) == ([0.1, 5, 20, 40], pytest.approx([80, 70, 10, 0]))
    assert line.get_label() == "a" and axes.get_xlim() == (0.1, 100)
    (axes,) = plots.plot_errors_over_surface({"lloyd": errors["lloyd"]}, areas, labels).axes
    assert axes.get_legend() is None
