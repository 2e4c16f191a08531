"""What a report says and shows of a comparison whose figures are given."""

import pytest

from analysis.report import (
    finding,
    is_nearly_isochoric,
    percent_signed,
    render,
    tables,
    text_table,
    trust_in_reference,
)


def comparison_of(largest_volume_change=0.5, own_error=None, **more):
    """Of springs that take 2 s and miss elements, which take 6 s and sweep a tenth of their volume, by 20 %."""
    model = {
        "status": "ok",
        "displacement_error_l2": 0.2,
        "displacement_error_max": 0.3,
        "volume_change_error": 1.02,
        "volume_change_difference": 0.004,
        "n_nodes": 10,
        "n_springs": 30,
        "n_patches": 0,
        "seconds": {"mesh": 0.5, "solve": 1.5},
    }
    reference = {
        "n_nodes": 11,
        "n_dofs": 33,
        "largest_volume_change": largest_volume_change,
        "swept_volume": 0.1,
        "estimated_error_l2": own_error,
        "seconds": {"mesh": 2.0, "assemble": 1.0, "solve": 3.0},
    }
    return {
        "scene": "bend",
        "surface": "bar",
        "calibration": "affine",
        "law": "small_strain",
        "rigid_motion_removed": False,
        "models": {"affine": model | more},
        "reference": reference,
    }


def cells_of(table, row=0):
    head, rows = table
    return dict(zip(head, rows[row], strict=True))


@pytest.mark.parametrize("change, is_nearly", [(0.00099, True), (0.00101, False)])
def test_volume_is_no_fraction_of_less_than_a_hundredth_of_what_is_swept(change, is_nearly):
    comparison = comparison_of(change)
    assert is_nearly_isochoric(comparison["reference"]) == is_nearly
    page = render(comparison, {}, {}, {})
    # The sentence and the table below it never speak of the volume in two ways.
    assert ("which changes by less than a hundredth of what the surface sweeps" in page) == is_nearly
    assert ("by 0.4 % of itself" in page) == is_nearly
    assert ("their volume change by 102 %" in finding(comparison)) == (not is_nearly)
    assert cells_of(tables(comparison)[0])["volume error"] == ("-" if is_nearly else "102 %")
    assert page.count("102 %") == (0 if is_nearly else 2)


def test_finding_compares_all_seconds_of_both():
    assert "by 20 % (at worst 30 %)" in finding(comparison_of())
    assert finding(comparison_of()).endswith("they took 2 s against 6 s, 3 times faster.")
    slow = comparison_of(seconds={"mesh": 9.0, "solve": 9.0})
    assert finding(slow).endswith("they took 18 s against 6 s, 3 times slower.")


@pytest.mark.parametrize("own, is_named", [(0.018, False), (0.022, True)])
def test_references_own_error_is_named_beyond_a_tenth_of_the_difference(own, is_named):
    assert ("the reference's own error is some 2.2 %" in finding(comparison_of(own_error=own))) == is_named
    (sentence,) = trust_in_reference(comparison_of(own_error=own))
    assert ("more than a tenth of the difference from affine (11 % of it)" in sentence) == is_named
    assert ("less than a tenth of every difference" in sentence) == (not is_named)


def test_tables_hold_sizes_trust_and_seconds_of_each_method():
    diagnostics = {"pressure_error": 0.01, "bending_compliance": 1.25}
    more = {"diagnostics": diagnostics, "n_floppy_motions": 2, "floppy_load_share": 0.03}
    errors, trust, seconds = tables(comparison_of(**more))
    springs, elements = cells_of(errors), cells_of(errors, 1)
    assert [springs[part] for part in ("nodes", "springs", "dofs")] == ["10", "30", "30"]
    assert [springs[part] for part in ("displacement error", "largest")] == ["20 %", "30 %"]
    assert [elements[part] for part in ("nodes", "springs", "dofs")] == ["11", "-", "33"]
    assert trust[1] == [["springs, affine", "1 %", "-", "1.250", "-", "2 (3 % of the load)"]]
    assert list(cells_of(seconds).values())[1:] == ["0.50", "-", "-", "1.50", "-", "2.00"]
    assert list(cells_of(seconds, 1).values())[1:] == ["2.00", "-", "1.00", "3.00", "-", "6.00"]


@pytest.mark.parametrize(
    "n_springs, n_patches, cell",
    [(30, 0, "30"), (0, 12, "12 patches"), (30, 12, "30, 12 patches"), (0, 0, "0")],
)
def test_tables_tell_springs_from_patches_of_coupled_ones(n_springs, n_patches, cell):
    of = {"n_springs": n_springs, "n_patches": n_patches}
    assert cells_of(tables(comparison_of(**of))[0])["springs"] == cell
    alone = comparison_of(**of, volume_change=0.1, largest_displacement=1.0, kinetic_energy_left=0.0)
    assert cells_of(tables(alone | {"no_reference": "contact"})[0])["springs"] == cell


def test_text_tables_are_aligned():
    lines = text_table(["", "nodes"], [["springs", "7"], ["elements", "12345"]]).splitlines()
    assert lines == ["          nodes", "springs       7", "elements  12345"]


def test_signs_of_percentages():
    assert [percent_signed(x) for x in (0.25, -0.25, 0)] == ["+25 %", "-25 %", "+0 %"]
