"""The tutorial runs, and what its text says is what its cells give."""

import json
import time

import nbformat
import pytest
from nbclient import NotebookClient

from analysis.paths import PACKAGE, ROOT

FILE = PACKAGE / "tutorial.ipynb"
VALUES = """
import json
of = experiment.to_dataframe()
print(json.dumps({
    "errors": of["displacement_error_l2"].dropna().to_dict(),
    "own": of.loc["fem_reference", "estimated_error_l2"],
    "along": nodes.groupby(nodes["x"].round(1))["error"].mean().to_list(),
    "sweep": table.groupby("network.calibration")["displacement_error_l2"].max().to_dict(),
    "status": sorted(set(table["status"])),
}))
"""


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory):
    """The notebook as it is stored, and as it runs now, with results in a folder of its own."""
    stored = nbformat.read(FILE, as_version=4)
    out = tmp_path_factory.mktemp("tutorial")
    setup = f"import pathlib, analysis.session; analysis.session.ROOT = pathlib.Path({str(out)!r})"
    cells = [
        nbformat.v4.new_code_cell(setup),
        *stored.copy().cells,
        nbformat.v4.new_code_cell(VALUES),
    ]
    run = nbformat.v4.new_notebook(cells=[nbformat.from_dict(dict(cell)) for cell in cells])
    start = time.perf_counter()
    NotebookClient(
        run, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}
    ).execute()
    print(f"executed in {time.perf_counter() - start:.1f} s")
    return stored, run.cells[1:-1], json.loads(run.cells[-1].outputs[0].text)


def kinds(cell):
    return [(output.output_type, sorted(output.get("data", {}))) for output in cell.get("outputs", [])]


def test_stored_cells_show_what_they_show_when_run(tutorial):
    stored, run, _ = tutorial
    assert [kinds(cell) for cell in stored.cells] == [kinds(cell) for cell in run]
    assert sum(bool(kinds(cell)) for cell in run) == 6
    assert FILE.stat().st_size < 200_000


def test_text_of_the_tutorial_is_true(tutorial):
    _, _, values = tutorial
    averaged, uniform = values["errors"]["node_averaged"], values["errors"]["uniform"]
    assert averaged < 0.015 and 0.15 < uniform < 0.25  # about a hundredth and about a fifth
    assert values["own"] > averaged / 10
    assert values["along"] == sorted(values["along"])  # grows from the clamped face to the tip
    assert values["status"] == ["ok"]
    assert values["sweep"]["node_averaged"] < values["sweep"]["uniform"] / 10
