"""Estimates before a run: what grows with what, and what is said of runs that are too large."""

import json
import math

import pytest

from analysis.extent import Extent, available_memory, extent_of

SCENE = {"n_vertices": 1000, "models": ["affine", "uniform"], "degree": 2, "refine": 0, "law": "small_strain"}


def extent(**changes):
    scene = {**SCENE, "mode": "static", **changes}
    return extent_of(json.dumps({"n_vertices_of_springs": scene["n_vertices"], **scene}))


def test_springs_have_nodes_by_the_vertices_of_the_surface_as_it_is_cut():
    cut = extent(n_vertices_of_springs=3000)
    assert cut.n_network == pytest.approx(3 * extent().n_network, rel=1e-3)
    assert cut.n_elements == extent().n_elements


def test_quadratic_elements_have_seven_times_the_nodes_of_linear_ones_and_a_refinement_eight_times():
    assert extent().n_elements / extent(degree=1).n_elements == pytest.approx(7, rel=0.05)
    assert extent(refine=2).n_elements == 64 * extent().n_elements


def test_seconds_grow_with_vertices_models_and_steps():
    assert extent(n_vertices=3000).seconds == pytest.approx(3 * extent().seconds)
    one, two, three = (extent(models=["affine"] * n).seconds for n in (1, 2, 3))
    assert three - two == pytest.approx(two - one) and two > one
    moving = [extent(mode="dynamic", n_steps=n).seconds for n in (100, 200, 300)]
    assert moving[2] - moving[1] == pytest.approx(moving[1] - moving[0]) and moving[1] > moving[0]
    assert extent(law="neo_hookean").seconds > extent().seconds


def test_advice_is_given_to_runs_that_are_long_or_exceed_the_memory():
    assert extent().advice(available=8e9) == ""
    large = extent(n_vertices=1_000_000)
    assert large.seconds > 300 and "coarser surface" in large.advice(available=math.inf)
    assert "2.0 GB are available" in large.advice(available=2e9)
    assert "available" not in large.advice(available=math.inf)


def test_the_text_gives_rounded_figures():
    text = Extent(49_999, 114_998, 749_985, 170.0, 3.24e9).text
    assert text.startswith("49999 vertices, about 110,000 nodes of springs and 750,000 of finite elements")
    assert "3 min and 3.2 GB on one core" in text


def test_available_memory_is_read_in_bytes(tmp_path):
    file = tmp_path / "meminfo"
    file.write_text("MemTotal: 4000 kB\nMemAvailable:    3000 kB\n")
    assert available_memory(file) == 3000 * 1024
