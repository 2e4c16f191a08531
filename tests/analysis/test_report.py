"""What a report says and shows of a comparison whose figures are given."""

import html
import math

import pytest

from analysis.report import render, svg_figure, tables, text_of, text_table
from analysis.verdict import (
    RULES,
    conclusion,
    finding,
    is_out_of_range,
    needs_finer_reference,
    next_command,
    trust_in_reference,
    verdict_on,
)


def model_of(error=0.2, **more):
    return {
        "status": "ok",
        "reached": 1.0,
        "displacement_error_l2": error,
        "displacement_error_max": 1.5 * error,
        "volume_change_error": 1.02,
        "volume_change_difference": 0.004,
        "area_change_error": 0.033,
        "tip_displacement": 0.0185,
        "is_linear": True,
        "n_nodes": 10,
        "n_springs": 30,
        "n_patches": 0,
        "n_floppy_motions": 0,
        "seconds": {"mesh": 0.5, "solve": 1.5},
        "displacement_error_finest": error,
        "surface_distance": None,
        "has_waited": False,
    } | more


def comparison_of(models=None, name="affine", **of_reference):
    """Of springs that take 2 s and miss elements, which take 6 s and move by 20 mm, by 20 %."""
    seconds = {"mesh": 2.0, "assemble": 1.0, "solve": 3.0}
    reference = {
        "n_points": 9,
        "n_cut": 0,
        "n_nodes": 11,
        "n_dofs": 33,
        "stopped": "",
        "reached": 1.0,
        "largest_displacement": 0.02,
        "largest_volume_change": 0.5,
        "swept_volume": 0.1,
        "keeps_volume": False,
        "keeps_area": False,
        "rotation": 0.1,
        "strain": 0.02,
        "largest_strain": 0.03,
        "law_error": None,
        "estimated_error_l2": 0.0,
        "n_refinements": 0,
        "unrefined_seconds": seconds,
        "unrefined_error": 0.5,
        "has_waited": False,
        "unrefined_has_waited": False,
        "next_seconds": None,
        "unrefined": "",
        "seconds": seconds,
    }
    return {
        "scene": "bend",
        "surface": "bar",
        "calibration": name,
        "law": "small_strain",
        "nu": 0.25,
        "rigid_motion_removed": False,
        "command": "./testbed run bend.toml",
        "target_error": 0.0,
        "is_static": True,
        "across": 1.0,
        "is_coarse_at_supports": False,
        "is_too_thin": False,
        "smaller_steps": "time.load_steps=20",
        "notes": [],
        "models": models or {name: model_of()},
        "reference": reference | of_reference,
    }


def cells_of(table, row=0):
    head, rows = table
    return dict(zip(head, rows[row], strict=True))


def test_a_number_that_is_withdrawn_is_printed_nowhere():
    page = render(comparison_of(), None, {}, {}, {})
    assert "their volume change by 102 %" in finding(comparison_of()) and page.count("102 %") == 2
    assert "is left out" not in page
    models = {"affine": model_of(volume_change_error=math.nan)}
    comparison = comparison_of(models, keeps_volume=True)
    page = render(comparison, None, {}, {}, {})
    assert "volume" not in finding(comparison)
    assert (
        "The volume changes by less than a hundredth of what the surface sweeps, so its error is left out."
        in page
    )
    assert "The area changes" not in page and "nan" not in page
    assert cells_of(tables(comparison)[0])["volume error"] == "-"
    assert cells_of(tables(comparison)[0])["area error"] == "3.3 %"


def test_tip_is_in_the_unit_of_the_reference():
    errors = tables(comparison_of())[0]
    assert [cells_of(errors, row)["tip (mm)"] for row in (0, 1)] == ["18.5", "20"]
    models = {"affine": model_of(tip_displacement=math.nan)}
    assert cells_of(tables(comparison_of(models))[0])["tip (mm)"] == "-"


@pytest.mark.parametrize("own, is_named", [(0.018, False), (0.022, True)])
def test_references_own_error_is_named_beyond_a_tenth_of_the_difference(own, is_named):
    comparison = comparison_of(estimated_error_l2=own)
    assert ("the reference's own error is some 2.2 %" in finding(comparison)) == is_named
    (sentence,) = trust_in_reference(comparison)
    assert ("more than a tenth of the difference from affine (11 % of it)" in sentence) == is_named
    assert ("less than a tenth of every difference" in sentence) == (not is_named)
    assert ("own error of some 2.2 % limits this" in " ".join(conclusion(comparison))) == is_named


def test_references_own_error_is_the_finding_where_it_exceeds_the_difference():
    comparison = comparison_of(estimated_error_l2=0.5)
    assert finding(comparison) == (
        "bend, bar: the finite elements' own displacement error, some 50 %, exceeds the 20 % by which the affine springs "
        "differ from them."
    )
    assert "affine (2.5 times as much)" in trust_in_reference(comparison)[0]
    rounding = comparison_of({"affine": model_of(0.0)}, estimated_error_l2=1e-14)
    assert "miss the finite elements' surface displacement by 0 %" in finding(rounding)


@pytest.mark.parametrize(
    "law_error, is_linear, is_out",
    [
        (None, False, False),
        (0.019, False, False),
        (0.021, False, True),
        (0.021, True, True),
        (0.0009, True, False),
        (0.0009, False, False),
    ],
)
def test_small_strain_is_out_of_range_beyond_a_tenth_of_the_difference(law_error, is_linear, is_out):
    model = model_of(is_linear=is_linear)
    comparison = comparison_of({"affine": model}, law_error=law_error)
    assert is_out_of_range(model, comparison["reference"]) == is_out
    assert ("being of small strain, are off by some 2.1 %" in finding(comparison)) == is_out
    for sentences in (conclusion(comparison), trust_in_reference(comparison)):
        assert ('material.law = "neo_hookean"' in " ".join(sentences)) == is_out


@pytest.mark.parametrize("own, verdict", [(0.005, "use"), (0.02, "undecided")])
def test_errors_of_the_mesh_and_of_the_law_add_up(own, verdict):
    """At a difference of 2 % and an error of the law of 2 %, 1 % is left to serve."""
    model = model_of(0.02, is_linear=False)
    reference = comparison_of({"a": model}, "a", law_error=0.02, estimated_error_l2=own)["reference"]
    assert verdict_on(model, reference) == verdict


def test_errors_of_a_law_that_both_share_are_news_from_a_hundredth_on():
    """Springs that take the same linear law may agree to rounding."""
    for law_error, is_linear, is_out in ((0.005, True, False), (0.015, True, True), (0.005, False, True)):
        model = model_of(1e-9, is_linear=is_linear)
        assert is_out_of_range(model, comparison_of(law_error=law_error)["reference"]) == is_out
    words = " ".join(trust_in_reference(comparison_of(law_error=0.025)))
    assert (
        "turns by at most 5.7 degrees and strains by at most 2 %: an answer of small strain is off by some 2.5 %."
        in words
    )


def test_conclusion_names_models_to_use_and_not_to_use_and_the_seconds_saved():
    models = {
        "moment": {"status": "diverged"},
        "affine": model_of(0.3),
        "edge_coupled": model_of(0.04, n_springs=0),
        "node_averaged": model_of(0.01, n_springs=0),
        "lloyd": model_of(0.1),
        "uniform": model_of(0.19),
    }
    comparison = comparison_of(models, estimated_error_l2=0.015)
    first, second, third, fourth, *rest = conclusion(comparison)
    assert first == "Use node_averaged (1 %) here, not affine (30 %)."
    assert second == "lloyd (10 %) lies in between."
    # Their errors are 2.5 to 5.5 % and 17.5 to 20.5 %: on either side of a bound.
    assert third == "This run cannot decide on edge_coupled (4 %) or uniform (19 %)."
    assert (
        fourth
        == "node_averaged took 2 s and the finite elements 6 s, off by 1 % and 50 % by refined ones: it saves 4 s."
    )
    assert rest == [
        "The finite elements' own error of some 1.5 % limits this.",
        "affine, lloyd and uniform stand on one random network, and another gives another error.",
        "Seconds are of single runs, whose errors differ.",
    ]
    sure = conclusion(comparison_of(models, estimated_error_l2=1e-14))
    assert sure[0] == "Use node_averaged (1 %) or edge_coupled (4 %) here, not affine (30 %)."
    assert sure[1] == "lloyd (10 %) and uniform (19 %) lie in between."


@pytest.mark.parametrize("solve, saved", [(4.29, "1.2 s"), (4.31, "no time"), (20.0, "no time")])
def test_time_is_saved_where_a_fifth_of_it_is(solve, saved):
    models = {"affine": model_of(0.01, seconds={"mesh": 0.5, "solve": solve})}
    refined = {"solve": 60.0}  # of elements that judge, which no user would have needed
    assert conclusion(comparison_of(models, seconds=refined))[1].endswith(f"it saves {saved}.")


@pytest.mark.parametrize("of_elements, is_compared", [(0.0096, True), (0.009, False), (None, False)])
def test_time_is_only_compared_at_equal_error(of_elements, is_compared):
    comparison = comparison_of({"affine": model_of(0.01)}, unrefined_error=of_elements)
    assert ("it saves 4 s" in conclusion(comparison)[1]) == is_compared
    assert ("at unequal errors (off by 1 % and 0.9 % by refined ones)" in conclusion(comparison)[1]) == (
        of_elements == 0.009
    )


@pytest.mark.parametrize(
    "of_model, of_reference",
    [({}, {"unrefined_has_waited": True, "has_waited": True}), ({"has_waited": True}, {})],
)
def test_nothing_is_said_on_time_of_a_busy_machine(of_model, of_reference):
    calm, busy = (
        " ".join(conclusion(comparison_of({"a": model_of(0.01, **model)}, "a", **reference)))
        for model, reference in (({}, {}), (of_model, of_reference))
    )
    assert "it saves 4 s" in calm and "busy" not in calm
    assert "saves" not in busy and "Nothing is said on time, as the machine was busy." in busy
    assert "The machine was busy with other things: seconds are longer than" in busy


@pytest.mark.parametrize("is_unrefined", [False, True])
def test_time_is_compared_with_the_unrefined_references_whoever_else_waited(is_unrefined):
    waited = {"unrefined_has_waited": is_unrefined, "has_waited": not is_unrefined}
    words = " ".join(conclusion(comparison_of({"a": model_of(0.01)}, "a", **waited)))
    assert ("it saves 4 s" in words) != is_unrefined
    assert ("Nothing is said on time, as the machine was busy." in words) == is_unrefined


def test_without_an_estimate_of_the_references_error_nothing_is_recommended():
    """One that is unknown is not zero."""
    models = {"a": model_of(0.001), "b": model_of(0.9)}
    why = {"next_seconds": 250.0, "unrefined": ""}
    comparison = comparison_of(models, "a", estimated_error_l2=None, **why)
    words = " ".join(conclusion(comparison))
    assert words.startswith(
        "No model is shown to serve here. This run cannot decide on a (0.1 %) or b (90 %)."
    )
    assert "own error is not estimated: a refinement takes some 4 min." in words
    assert needs_finer_reference(comparison)
    assert next_command(comparison) == ("To decide", "./testbed run bend.toml --time-limit 250", "4 min more")
    failed = comparison_of(models, "a", estimated_error_l2=None, **(why | {"unrefined": "not_converged"}))
    assert "not estimated: refined, they gave nothing (not_converged)." in " ".join(conclusion(failed))
    assert next_command(failed) == (
        "To refine the finite elements in smaller steps",
        "./testbed run bend.toml --set time.load_steps=20",
        "20 s",
    )


@pytest.mark.parametrize(
    "error, own, target, is_needed",
    [
        (0.00585, 0.047, 0, True),
        (0.00585, 0.044, 0, False),
        (0.3, 0.09, 0, False),
        (0.24, 0.09, 0, True),
        (0.1, 0.04, 0, False),
        (0.01, 0.03, 0.02, True),
        (0.01, 0.015, 0.02, False),
    ],
)
def test_the_reference_is_refined_until_it_can_decide(error, own, target, is_needed):
    comparison = comparison_of({"a": model_of(error)}, "a", estimated_error_l2=own)
    assert needs_finer_reference(comparison | {"target_error": target}) == is_needed
    undecided = "cannot decide" in " ".join(conclusion(comparison))
    assert undecided == (is_needed and not target)


def test_no_refinement_helps_where_the_law_limits():
    models = {"a": model_of(0.04, is_linear=False)}
    comparison = comparison_of(models, "a", estimated_error_l2=0.001, law_error=0.1)
    assert "cannot decide on a" in " ".join(conclusion(comparison)) and not needs_finer_reference(comparison)
    assert next_command(comparison)[1].endswith("--set material.law=neo_hookean")


def test_a_verdict_that_helps_nobody_names_a_command_that_may():
    def step(name, of_model=None, of_comparison=None, **of_reference):
        comparison = comparison_of({name: of_model or model_of(0.1)}, name, **of_reference)
        return next_command(comparison | (of_comparison or {}))

    assert step("uniform")[1:] == ("./testbed run bend.toml --set network.calibration=node_averaged", "8 s")
    assert step("node_averaged")[1].endswith("node_averaged --set network.target_error=0.02")
    assert step("node_averaged")[2] == "60 s"  # thirty times the springs' two
    # Each is named until it has been tried.
    assert step("node_averaged", n_cut=5)[1].endswith("--set surface.across=3")
    assert step("node_averaged", None, {"across": 3}, n_cut=5)[1].endswith("network.target_error=0.02")
    adapted = {"across": 3, "target_error": 0.02}
    assert step("node_averaged", None, adapted, n_cut=5)[1].endswith("--set surface.across=6")
    assert step("node_averaged", None, {"is_static": False})[1].endswith("--set surface.across=3")
    assert step("node_averaged", None, {"is_coarse_at_supports": True}, n_cut=5)[1].endswith("at_supports=1")
    assert step("node_averaged", None, {"notes": ["run --remesh makes it even."]})[1].endswith(" --remesh")
    stopped = model_of(0.1, status="not_converged, step 3 of 5", reached=0.4)
    for model in (stopped, {"status": "diverged"}):
        assert step("node_averaged", model)[1].endswith("--set time.load_steps=20")
    assert next_command(comparison_of({"a": model_of(0.01)}, "a")) is None


def test_no_smaller_steps_are_named_for_a_model_that_was_refused_in_words():
    models = {"node_averaged": {"status": "the supports leave 6 rigid motions free, and loads drive them"}}
    comparison = comparison_of(models, "node_averaged")
    assert next_command(comparison) is None
    assert tables(comparison)[0][1][0][:2] == ["springs, node_averaged", "no result"]
    comparison["models"]["node_averaged"]["status"] = "not_converged, load factor 0.5"
    assert tables(comparison)[0][1][0][1] == "not_converged, load factor 0.5"


@pytest.mark.parametrize(
    "error, own, ending",
    [
        (0.04, 0.02, "cannot decide on"),
        (0.1, 0.001, "lies in between"),
        (0.4, 0.001, "No model is shown to serve"),
    ],
)
def test_each_verdict_but_use_ends_with_its_rule_one_command_and_its_cost(error, own, ending):
    models = {"node_averaged": model_of(error)}
    comparison = comparison_of(models, "node_averaged", estimated_error_l2=own, next_seconds=90.0)
    purpose, command, cost = next_command(comparison)
    for text in (render(comparison, None, {}, {}, {}), text_of(comparison)):
        text = html.unescape(text)
        verdict, rule, step = (text.index(words) for words in (ending, RULES, f"{purpose} (some {cost}):"))
        assert verdict < rule < step < text.index(command) < text.index("exact fields")
        assert text.count("./testbed run") == 1


@pytest.mark.parametrize(
    "errors, own, is_too_thin, nearest, serve",
    [
        ({"node_averaged": 0.26, "affine": 0.24}, 0.01, True, "affine", True),
        ({"node_averaged": 0.26, "affine": 0.24}, 0.01, False, "affine", True),
        ({"node_averaged": 0.26, "affine": 0.1}, 0.01, True, None, True),  # one lies in between
        ({"node_averaged": 0.26, "affine": 0.02}, 0.01, True, None, False),  # one serves
        ({"node_averaged": 0.36, "affine": 0.34}, 0.06, True, None, False),  # elements do not
    ],
)
def test_where_elements_alone_serve_it_is_said_and_of_thin_bodies_before_the_figure(
    errors, own, is_too_thin, nearest, serve
):
    models = {name: model_of(error) for name, error in errors.items()}
    comparison = comparison_of(models, "node_averaged", estimated_error_l2=own)
    comparison |= {"is_too_thin": is_too_thin}
    first, words = finding(comparison), " ".join(conclusion(comparison))
    assert ("too thin" in first) == (serve and is_too_thin)
    if serve and is_too_thin:
        assert first.index(
            "finite elements serve here and springs do not (they are off by some 1 %, in 6 s)"
        ) < (first.index("26 %"))
    assert ("The finite elements serve here: they are off by some 1 %, in 6 s." in words) == serve
    assert ("All models are far off" in words) == (nearest is not None)
    assert nearest is None or f"All models are far off, {nearest} the least." in words


def test_a_body_that_is_cut_as_far_as_it_goes_is_not_to_be_cut_further():
    comparison = comparison_of({"node_averaged": model_of(0.3)}, "node_averaged", n_cut=5)
    assert "surface.across" in next_command(comparison)[1]
    assert next_command(comparison | {"is_too_thin": True})[1].endswith("network.target_error=0.02")


def test_models_that_differ_by_rounding_are_named_in_the_scenes_order():
    models = {"node_averaged": model_of(2e-12), "edge_coupled": model_of(1e-12)}
    first = conclusion(comparison_of(models, "node_averaged"))[0]
    assert first == "Use node_averaged (less than 0.001 %) or edge_coupled (less than 0.001 %) here."


def test_conclusion_says_what_limits_it():
    words = " ".join(conclusion(comparison_of()))
    assert words.startswith("No model is shown to serve here. affine (20 %) lies in between.")
    assert "saves" not in words and "network, and another" in words
    mechanisms = {name: model_of(0.01, n_floppy_motions=n) for name, n in (("a", 2), ("b", 0), ("c", None))}
    words = " ".join(conclusion(comparison_of(mechanisms, "a")))
    assert "a is a mechanism, whose error another load may change." in words
    failing = conclusion(comparison_of({"affine": model_of(0.3)}))
    assert failing[0] == "No model is shown to serve here; do not use affine (30 %)."


@pytest.mark.parametrize("distance, is_told", [(None, False), (0.09, False), (0.01, True)])
def test_points_that_go_elsewhere_along_one_surface_are_told(distance, is_told):
    comparison = comparison_of({"affine": model_of(0.3, surface_distance=distance)})
    assert ("though their surfaces lie 1 % of it apart" in finding(comparison)) == is_told
    assert (
        "Points of affine go elsewhere along nearly the same surface" in " ".join(conclusion(comparison))
    ) == is_told
    assert (next_command(comparison) is None) == is_told


@pytest.mark.parametrize("nu, times", [(0.45, "5"), (0.0, "0.5"), (0.25, None), (0.3, None)])
def test_conclusion_says_where_springs_have_another_poissons_ratio_than_the_material(nu, times):
    models = {name: model_of(0.3) for name in ("node_averaged", "uniform", "affine")} | {
        "lloyd": {"status": "diverged"}
    }
    words = " ".join(conclusion(comparison_of(models, "uniform") | {"nu": nu}))
    told = f"at {nu:g} the material resists a change of volume {times} times as much as they do."
    assert ("The springs of uniform and affine have a Poisson's ratio of 1/4" in words) == (times is not None)
    assert (told in words) == (times is not None)
    # K(nu) / K(1/4), K = E / 3 (1 - 2 nu).
    assert times is None or float(times) == pytest.approx((1 - 2 * 0.25) / (1 - 2 * nu))


def test_conclusion_names_whose_tetrahedra_were_turned_inside_out():
    models = {
        name: model_of(0.01, least_jacobian=least) for name, least in (("a", -0.1), ("b", 0.2), ("c", None))
    }
    assert "Tetrahedra of a springs were turned inside out." in conclusion(comparison_of(models, "a"))
    words = " ".join(conclusion(comparison_of(models, "a", least_jacobian=0.0)))
    assert "Tetrahedra of the reference and a springs were turned inside out." in words


def test_without_a_reference_no_model_is_recommended():
    alone = {"volume_change": 0.1, "largest_displacement": 1.0}
    models = {name: model_of(**alone, kinetic_energy_left=left) for name, left in (("a", 0.001), ("b", 0.5))}
    comparison = comparison_of(models, "a") | {"no_reference": "contact", "half_step_volume_change": None}
    (sentence,) = conclusion(comparison)
    assert sentence.endswith("there is no reference to judge it by; a came to rest.")
    assert trust_in_reference(comparison) == []
    for half, words in (
        (0.11, "Half the step changes the volume at its end by 1 % of that at rest."),
        (-0.2, "This depends on its step: 110 % of the volume is left, and 80 % at half the step."),
    ):
        assert conclusion(comparison | {"half_step_volume_change": half})[1:] == [words]
    models["a"]["has_waited"] = True
    assert conclusion(comparison)[1].startswith("The machine was busy")
    models.pop("a")
    assert conclusion(comparison)[0].endswith("none came to rest.")
    models["b"] = {"status": "diverged"}
    assert conclusion(comparison)[0].endswith("none gave a result.")


def test_wide_plots_are_scrolled_rather_than_made_too_small_to_read():
    wide, narrow = (svg_figure(f'<svg width="{width}pt" height="9pt">', "a") for width in (900, 490))
    assert (
        'style="min-width: 585pt"' in wide and 'style="min-width: 318pt"' in narrow
    )  # of a page of 500 pixels: 351 pt
    assert "figure { margin: 1.5rem 0; overflow-x: auto; }" in render(comparison_of(), None, {}, {}, {})


def test_runs_that_stopped_are_named_with_where_and_why():
    models = {"affine": model_of(status="not_converged, step 3 of 5", reached=0.4)}
    comparison = comparison_of(models, stopped="not_converged", reached=0.6)
    assert finding(comparison).startswith(
        "bend, bar: the finite elements stopped at load factor 0.6 (not_converged); there the affine springs stopped at "
        "load factor 0.4 (not_converged, step 3 of 5); there the affine springs miss"
    )
    assert tables(comparison)[0][1][0][0] == "springs, affine, up to 0.4 of the load"


def test_conclusion_is_the_second_sentence_of_page_and_terminal():
    comparison = comparison_of(estimated_error_l2=0.001)
    words = " ".join(conclusion(comparison))
    assert text_of(comparison).splitlines()[:2] == [finding(comparison), words]
    page = render(comparison, None, {}, {}, {})
    assert page.index(">bend, bar: the affine") < page.index(words) < page.index("<table>")


def test_tables_hold_sizes_trust_and_seconds_of_each_method():
    diagnostics = {"pressure_error": 0.01, "bending_error": 0.25, "bending_compliance": 0.99}
    more = {
        "diagnostics": diagnostics,
        "n_floppy_motions": 2,
        "floppy_load_share": 0.03,
        "estimated_error": 0.04,
    }
    more["seconds"] = {"start-up": 0.25, "mesh": 0.5, "solve": 1.5, "estimate": 7.0}
    errors, trust, seconds = tables(comparison_of({"affine": model_of(**more)}))
    springs, elements = cells_of(errors), cells_of(errors, 1)
    assert [springs[part] for part in ("nodes", "springs", "dofs")] == ["10", "30", "30"]
    assert [springs[part] for part in ("displacement error", "at worst")] == ["20 %", "30 %"]
    assert [elements[part] for part in ("nodes", "springs", "dofs")] == ["11", "-", "33"]
    assert trust[1] == [["springs, affine", "1 %", "-", "25 %", "-", "2 (3 % of the load)", "4 %"]]
    assert list(cells_of(seconds).values())[1:] == ["0.25", "0.50", "-", "-", "1.50", "-", "2.25", "7.00"]
    assert list(cells_of(seconds, 1).values())[1:] == ["-", "2.00", "-", "1.00", "3.00", "-", "6.00", "-"]


@pytest.mark.parametrize("n, cell", [(None, "unknown"), (0, "0")])
def test_floppy_motions_that_nobody_counted_are_not_none(n, cell):
    trust = tables(comparison_of({"affine": model_of(n_floppy_motions=n)}))[1]
    assert cells_of(trust)["floppy motions"] == cell


@pytest.mark.parametrize(
    "n_springs, n_patches, cell",
    [(30, 0, "30"), (0, 12, "12 patches"), (30, 12, "30, 12 patches"), (0, 0, "0")],
)
def test_tables_tell_springs_from_patches_of_coupled_ones(n_springs, n_patches, cell):
    of = {"n_springs": n_springs, "n_patches": n_patches}
    assert cells_of(tables(comparison_of({"affine": model_of(**of)}))[0])["springs"] == cell
    described = model_of(**of, volume_change=0.1, largest_displacement=1.0, kinetic_energy_left=0.0)
    alone = comparison_of({"affine": described})
    assert cells_of(tables(alone | {"no_reference": "contact"})[0])["springs"] == cell


def test_text_tables_are_aligned():
    lines = text_table(["", "nodes"], [["springs", "7"], ["elements", "12345"]]).splitlines()
    assert lines == ["          nodes", "springs       7", "elements  12345"]
