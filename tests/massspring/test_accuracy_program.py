"""The program that measures spring models against exact fields: its table's columns agree with each other."""

import csv
import subprocess

import pytest

from analysis.experiment import PROGRAMS


def test_change_of_volume_is_what_the_work_of_a_pressure_says(tmp_path):
    table = tmp_path / "accuracy.csv"
    words = ["--surface", "bar:100", "--seed", "0", "--nu", "0.25", "--model", "affine", "van_gelder", "edge_coupled"]
    subprocess.run([PROGRAMS / "accuracy", "--out", table, *words], check=True, capture_output=True)
    rows = [row for row in csv.DictReader(table.open()) if row["load"] == "pressure"]
    errors = {row["model"]: float(row["volume_change_error"]) for row in rows}
    assert errors["affine"] < -1
    assert errors["van_gelder"] < -0.1
    # A pressure's work is that times the change of volume, which is -3 V in the exact field u = -x.
    works = {row["model"]: float(row["compliance"]) for row in rows}
    assert errors == pytest.approx({model: -3 * (work - 1) for model, work in works.items()}, rel=1e-4, abs=1e-12)
