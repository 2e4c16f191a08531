"""Numbers as they read in reports."""

import re

import pytest

from analysis.wording import (
    about,
    duration,
    listed,
    percent,
    percent_in_words,
    percent_signed,
    seconds,
    share,
    significant,
    unit_of_length,
)


@pytest.mark.parametrize(
    "fraction, text",
    [
        (0.12345, "12.3 %"),
        (0.0041, "0.41 %"),
        (10.94, "1090 %"),
        (99.996, "10000 %"),
        (123, "> 10000 %"),
        (1e-9, "< 0.001 %"),
        (0, "0 %"),
        (None, "-"),
        (float("nan"), "-"),
    ],
)
def test_percentages_have_three_digits_and_two_ends(fraction, text):
    assert percent(fraction) == text


def test_signs_of_percentages():
    assert [percent_signed(x) for x in (0.25, -0.25, 0, -1e-9)] == ["+25 %", "-25 %", "+0 %", "< 0.001 %"]


def test_ends_are_written_out_in_sentences():
    assert [percent_in_words(x) for x in (1e-9, 123, 0.2)] == [
        "less than 0.001 %",
        "more than 10000 %",
        "20 %",
    ]


def test_estimates_have_two_digits():
    assert about(0.05432) == "some 5.4 %"


@pytest.mark.parametrize(
    "fraction, text",
    [(0.254, "25 % of it"), (0.97, "as much"), (1.04, "as much"), (5.37, "5.4 times as much")],
)
def test_a_share_is_no_percentage_of_more_than_all(fraction, text):
    assert share(fraction) == text


@pytest.mark.parametrize(
    "value, text",
    [(0.004, "< 0.01 s"), (0.096, "0.096 s"), (1.449, "1.4 s"), (12.34, "12 s"), (123.4, "123 s"), (4321, "4320 s")],
)  # fmt: skip
def test_seconds_are_written_out(value, text):
    assert seconds(value) == text


@pytest.mark.parametrize("exponent", range(-9, 10))
@pytest.mark.parametrize("digits", [1, 9.996, 1.2345])
def test_no_number_has_an_exponent_and_none_is_off_by_more_than_its_digits(digits, exponent):
    text = significant(digits * 10.0**exponent)
    assert re.fullmatch(r"[0-9]+(\.[0-9]+)?", text)
    assert float(text) == pytest.approx(digits * 10.0**exponent, rel=0.005)


@pytest.mark.parametrize("metres, unit", [(2, "m"), (0.1, "m"), (0.097, "mm"), (5e-5, "µm"), (0, "m")])
def test_lengths_are_read_in_a_unit_that_leaves_few_zeros(metres, unit):
    name, size = unit_of_length(metres)
    assert name == unit and size == {"m": 1, "mm": 1e-3, "µm": 1e-6}[unit]


def test_lists_are_read_aloud():
    assert [listed(list(words)) for words in ("", "a", "ab", "abc")] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    "foreseen, words",
    [(0.2, "1 s"), (7.4, "7 s"), (43, "40 s"), (250, "4 min"), (5900, "98 min"), (7300, "2 h")],
)
def test_seconds_that_are_foreseen_are_told_in_round_numbers(foreseen, words):
    assert duration(foreseen) == words
