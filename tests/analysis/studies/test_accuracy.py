"""The summary of the accuracy study, on tables whose answer is known."""

import subprocess

import pytest

from analysis.__main__ import parse_arguments
from analysis.grid import csv_of
from analysis.paths import PROGRAMS
from analysis.studies import accuracy
from analysis.studies.accuracy import batches, convergence, finding, read_table, slope_of, summarise, table
from analysis.studies.command import main


def row(model: str, load: str, error: float, status: str = "ok", surface: str = "ball:162") -> dict[str, str]:
    return {
        "surface": surface, "spacing": "0", "seed": "0", "nu": "0.25", "n_nodes": "200",
        "model": model, "load": load, "status": status, "error_l2": str(error),
    }  # fmt: skip


def test_ratio_is_to_linear_elements_in_the_same_case() -> None:
    rows = [
        row("edge_coupled", "bending", 0.2),
        row("edge_coupled", "torsion", 0.1),
        row("node_averaged", "bending", 0.02),
        row("node_averaged", "torsion", 0.05),
        row("node_averaged", "uniaxial", 1e-12),
    ]
    (averaged,) = [s for s in summarise(rows) if s["model"] == "node_averaged"]
    assert averaged["median"] == pytest.approx(0.3)
    assert averaged["largest"] == pytest.approx(0.5)
    assert averaged["at_most_third"] == pytest.approx(0.5)
    assert averaged["worst_patch"] == pytest.approx(1e-12)


def test_refused_models_are_counted_not_averaged() -> None:
    rows = [row("edge_coupled", "bending", 0.2), row("uniform", "bending", 0, status="refused: floppy")]
    (uniform,) = [s for s in summarise(rows) if s["model"] == "uniform"]
    assert (uniform["cases"], uniform["refused"], uniform["median"]) == (0, 1, None)


def test_undecided_cases_are_counted_not_averaged() -> None:
    rows = [
        row("edge_coupled", "end_shear", 0.2),
        row("node_averaged", "end_shear", 0.02),
        row("edge_coupled", "clamp", 0.2),
        row("node_averaged", "clamp", 0.03, status="undecided") | {"reference_error": "0.02"},
        row("affine", "clamp", 0.045, status="undecided") | {"reference_error": "0.02"},
    ]
    by_load = {(s["model"], s["of"]): s for s in summarise(rows, "load")}
    shear, clamp = (by_load["node_averaged", load] for load in ("end_shear", "clamp"))
    assert (shear["median"], shear["undecided"]) == (pytest.approx(0.1), 0)
    assert (clamp["median"], clamp["undecided"], clamp["refused"]) == (None, 1, 0)
    # At most (0.03 + 0.02) / (0.2 - 0.02), below a third; (0.045 + 0.02) / 0.18 is more, over 0.2 it is less.
    assert clamp["undecided_at_most_third"] == 1
    assert by_load["affine", "clamp"]["undecided_at_most_third"] == 0


def test_slope_is_in_the_spacing() -> None:
    nodes = [100.0, 800.0, 6400.0]  # spacing halves each time
    assert slope_of(nodes, [0.4, 0.1, 0.025]) == pytest.approx(2)


@pytest.mark.skipif(not (PROGRAMS / "accuracy").exists(), reason="the program accuracy is not built")
def test_program_measures_each_case_once(tmp_path) -> None:
    def measure(*models: str) -> str:
        words = ["--out", str(file), "--surface", "ball:162", "--nu", "0.25", "--model", *models]
        subprocess.run([PROGRAMS / "accuracy", *words], check=True, capture_output=True)
        return file.read_text()

    file = tmp_path / "accuracy.csv"
    first = measure("uniform")
    both = measure("edge_coupled", "uniform")
    assert both.startswith(first) and measure("uniform", "edge_coupled") == both
    rows = {(r["model"], r["load"]): r for r in read_table(file)}
    assert len(both.splitlines()) == 1 + len(rows) == 1 + 2 * 6
    for model in ("uniform", "edge_coupled"):
        # A pressure works by the change of volume, exactly -3 of the volume: compliance is the share of it.
        pressed = rows[model, "pressure"]
        compliance, change = float(pressed["compliance"]), float(pressed["volume_change_error"])
        assert change == pytest.approx(-3 * (compliance - 1), rel=1e-3, abs=1e-8)
    assert abs(float(rows["uniform", "pressure"]["compliance"]) - 1) > 0.01
    assert max(float(rows["edge_coupled", load]["error_l2"]) for load in accuracy.PATCH_LOADS) < 1e-8


def test_finding_and_table_state_the_ratio_and_leave_out_what_there_is_not() -> None:
    rows = [row("edge_coupled", load, 0.2) for load in ("bending", "torsion")]
    rows += [
        row("node_averaged", "bending", 0.02),
        row("node_averaged", "torsion", 0.06),
        row("affine", "torsion", 0.6),
    ]
    rows.append(row("uniform", "bending", 0, status="refused: floppy"))
    assert finding(rows).endswith("in the median: node_averaged 0.2, affine 3.")
    head, body = table("nu", summarise(rows))
    cells = {line[0]: dict(zip(head, line, strict=True)) for line in body}
    assert (cells["node_averaged"]["median"], cells["node_averaged"]["<= 1/3"]) == ("0.200", "100%")
    assert (cells["uniform"]["median"], cells["uniform"]["refused"]) == ("-", "1")


def test_study_leaves_a_report_of_both_tables(tmp_path, monkeypatch, capsys) -> None:
    class Loads:
        def __init__(self, *_) -> None: ...

        def run(self, quick: bool) -> list[dict[str, str]]:
            assert quick
            return [row("edge_coupled", "patch", 0.4), row("affine", "patch", 0.1)]

    def run_program(file, quick: bool) -> None:
        assert quick
        file.write_text(csv_of([row("edge_coupled", "bending", 0.2), row("affine", "bending", 0.5)]))

    monkeypatch.setattr(accuracy, "Loads", Loads)
    monkeypatch.setattr(accuracy, "run_program", run_program)
    out = tmp_path / "out"
    assert main(parse_arguments(["study", "accuracy", "--quick", "--out", str(out)])) == 0
    said = capsys.readouterr().out
    assert "affine 2.5." in said and "0.250" in said
    assert {file.name for file in out.iterdir()} == {
        "accuracy.csv", "exact_by_nu.csv", "loads_by_nu.csv", "loads_by_load.csv", "ratios.svg", "convergence.svg",
        "report.html",
    }  # fmt: skip
    page = (out / "report.html").read_text()
    assert "Runs build/bin/accuracy" in page and "programs (SHA-256)" in page


def test_study_goes_without_meshes_that_are_not_there(tmp_path) -> None:
    for batch in batches(tmp_path, quick=False):
        assert batch["surface"]
        assert all(":" in name for name in batch["surface"])


def test_convergence_is_of_one_shape_seed_and_poissons_ratio_in_order_of_the_nodes() -> None:
    def at(n: int, nodes: str, error: float, **more: str) -> dict[str, str]:
        return row("affine", "torsion", error, surface=f"ball:{n}") | {"seed": "1", "n_nodes": nodes} | more

    rows = [at(642, "900", 0.1), at(162, "200", 0.4), at(2562, "9000", 0.2, status="undecided")]
    rows += [at(642, "900", 9, nu="0.49"), at(642, "900", 9, load="shear"), at(642, "900", 9, seed="2")]
    rows += [at(642, "900", 9, surface="bar:300"), at(300, "400", 9)]
    assert convergence(rows, "ball", "0.25", "torsion") == {"affine": ([200, 900], [0.4, 0.1])}


def test_ratios_are_drawn_as_shares_of_the_cases(drawn) -> None:
    rows = [row("edge_coupled", load, 0.2) for load in ("bending", "torsion", "cubic", "shear")]
    rows += [
        row("affine", load, error)
        for load, error in (("torsion", 0.4), ("bending", 0.1), ("shear", 9), ("clamp", 9))
    ]
    rows.append(row("affine", "cubic", 9, status="refused"))
    line, unity = drawn(accuracy).plot_ratios(rows).axes[0].lines
    assert list(line.get_xdata()) == pytest.approx([0.5, 2])
    assert list(line.get_ydata()) == [50, 100]
    assert list(unity.get_xdata()) == [1, 1]
