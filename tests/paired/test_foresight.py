"""What programs tell before they solve: as many nodes as there are, once, and nothing of what is not run."""

import json
import re
import shutil
import subprocess

import pytest
import pyvista as pv

from analysis.paths import PROGRAMS, SCENES

BOTH = ("massspring", "fem_reference")


def said_by(program, scene, folder, *words):
    command = [PROGRAMS / program, SCENES / f"{scene}.toml", "--out", folder, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stderr.splitlines(), folder / "run.json"


@pytest.mark.parametrize("program", BOTH)
def test_nodes_are_those_that_are_solved_for_and_are_told_once_meshed(program, tmp_path):
    said, file = said_by(program, "own_body", tmp_path)
    record = json.loads(file.read_text())
    (told,) = [line for line in said if " nodes" in line]
    number, amount = re.fullmatch(rf"{program}: (\d+) nodes, some (\d+) (?:s|min|h)", told).groups()
    assert int(number) == record["n_nodes"] and int(amount) > 0
    assert record["foreseen_seconds"] > 0
    began = [line.endswith("mesh ...") or line.endswith("solve ...") for line in said]
    assert began.index(True) < said.index(told) < len(began) - 1 - began[::-1].index(True)
    again, _ = said_by(program, "own_body", tmp_path)
    assert again == [], "what is kept takes no time"


def foreseen(program, scene, folder, *settings):
    """Nodes of a small run, and the seconds that it was foreseen to take."""
    words = ["surface.n_vertices=60", "output.curves=false", *settings]
    _, file = said_by(program, scene, folder, *(part for word in words for part in ("--set", word)))
    record = json.loads(file.read_text())
    return record["n_nodes"], record["foreseen_seconds"]


@pytest.mark.parametrize("program", BOTH)
@pytest.mark.parametrize(
    "scene, keys",
    [("bar_swing", ("time.end=0.0{}", "time.step=0.005")), ("bar_bend", ("time.load_steps={}",))],
)
def test_every_step_is_foreseen_to_take_as_long(program, scene, keys, tmp_path):
    """Of motions and of load steps at large strain; before them comes what the springs spend once."""
    _, *seconds = (
        foreseen(program, scene, tmp_path / str(n), *(key.format(n) for key in keys))[1] for n in (1, 1, 2, 4)
    )
    assert seconds[2] - seconds[1] == pytest.approx(2 * (seconds[1] - seconds[0])) and seconds[1] > seconds[0]
    if program == "fem_reference":
        assert seconds == pytest.approx([seconds[0], 2 * seconds[0], 4 * seconds[0]])


def test_a_linear_reference_is_foreseen_to_take_as_long_for_every_node(tmp_path):
    few, many = (
        foreseen("fem_reference", "bar_sag", tmp_path / degree, f"reference.degree={degree}")
        for degree in "12"
    )
    assert many[0] > 3 * few[0] and many[1] / few[1] == pytest.approx(many[0] / few[0])


def test_nothing_is_told_of_a_side_that_does_not_run(tmp_path):
    said, _ = said_by(
        "fem_reference", "torus_implodes", tmp_path, "--set", "reference.integrator=central_differences"
    )
    assert not [line for line in said if "nodes" in line or "some" in line]


def test_a_step_that_the_body_decides_has_no_seconds(tmp_path):
    words = [
        "time.mode=dynamic",
        "time.integrator=symplectic_euler",
        "time.end=1e-4",
        "surface.n_vertices=100",
    ]
    said, _ = said_by(
        "massspring", "own_body", tmp_path, *(part for word in words for part in ("--set", word))
    )
    assert [line for line in said if re.fullmatch(r"massspring: \d+ nodes", line)]


def test_a_surface_that_is_too_thin_for_its_cuts_is_told_of_in_plain_words(tmp_path):
    file = tmp_path / "sheet.ply"
    pv.Box((0, 1, 0, 1, 0, 0.005)).triangulate().clean().save(file)
    words = [f"surface.file={file}", "surface.shape=", "reference.degree=1"]
    words = [part for word in words for part in ("--set", word)]
    told = "the surface is too thin in parts for surface.across = 1: it is cut to 5"
    said, record = said_by("fem_reference", "own_body", tmp_path, *words)
    assert sum(line.startswith(told) for line in said) == 1
    assert json.loads(record.read_text())["is_cut_bounded"]
    said, _ = said_by("fem_reference", "own_body", tmp_path, "--checked", "--force", *words)
    assert not [line for line in said if "too thin" in line]


THIN = ("surface.shape=bar", "surface.n_vertices=8", "surface.size=[10, 1, 1]", "reference.degree=1")


def beside_failing_meshers(program, n_failures, tmp_path):
    """The program, whose meshers fail so many times first."""
    shutil.copy(PROGRAMS / program, tmp_path)
    failures = tmp_path / "failures"
    failures.mkdir()
    for name in ("gmsh_worker", "tetgen_worker"):
        worker = tmp_path / name
        worker.write_text(
            f"#!/bin/sh\n[ $(ls {failures} | wc -l) -lt {n_failures} ] && mktemp -p {failures} && exit 1\n"
            f'exec {PROGRAMS / name} "$@"\n'
        )
        worker.chmod(0o755)
    return tmp_path / program


@pytest.mark.parametrize(
    "program, n_failures, n_refused",
    [("massspring", 4, 1), ("massspring", 8, 2), ("fem_reference", 2, 1), ("fem_reference", 4, 2)],
)
def test_a_surface_that_no_mesher_fills_is_cut_less(program, n_failures, n_refused, tmp_path):
    """Two attempts on each surface; of springs with their own nodes inside, then with the mesher's."""
    words = [part for word in THIN for part in ("--set", word)]
    _, record = said_by(program, "own_body", tmp_path / "usual", *words)
    usual = json.loads(record.read_text())
    failing = beside_failing_meshers(program, n_failures, tmp_path)
    command = [failing, SCENES / "own_body.toml", "--out", tmp_path / "out", *words]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "ok" and "cuts_refused" not in usual
    assert [reason.startswith("no mesher fills") for reason in record["cuts_refused"]] == [True] * n_refused
    assert said.count("cannot be filled: it is cut less") == n_refused
    assert ("n_cut" in record) == (n_refused == 1)
    assert record.get("n_cut", 0) < usual["n_cut"] / 2


def test_a_surface_of_as_many_cuts_as_are_allowed_is_not_filled_twice(tmp_path):
    file = tmp_path / "sheet.ply"
    pv.Box((0, 1, 0, 1, 0, 0.005)).triangulate().clean().save(file)
    words = [f"surface.file={file}", "surface.shape=", "reference.degree=1"]
    words = [part for word in words for part in ("--set", word)]
    failing = beside_failing_meshers("fem_reference", 2, tmp_path)
    command = [failing, SCENES / "own_body.toml", "--out", tmp_path / "out", "--quiet", *words]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert len(record["cuts_refused"]) == 1 and "n_cut" not in record


@pytest.mark.parametrize("program, n_hanging", [("massspring", 2), ("fem_reference", 1)])
def test_a_surface_whose_meshers_take_too_long_is_not_cut(program, n_hanging, tmp_path):
    """The first mesher computes for ever; of springs with their own nodes inside, then without. The other one fails."""
    shutil.copy(PROGRAMS / program, tmp_path)
    called = tmp_path / "called"
    called.touch()
    hangs = f"[ $(wc -l <{called}) -lt {n_hanging} ] && echo >>{called} && while :; do :; done"
    for name, does in (
        ("gmsh_worker", f'{hangs}\nexec {PROGRAMS / "gmsh_worker"} "$@"'),
        ("tetgen_worker", "exit 1"),
    ):
        worker = tmp_path / name
        worker.write_text(f"#!/bin/sh\n{does}\n")
        worker.chmod(0o755)
    words = [part for word in THIN for part in ("--set", word)]
    command = [tmp_path / program, SCENES / "own_body.toml", "--out", tmp_path / "out", *words]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "ok" and "n_cut" not in record
    assert len(record["cuts_refused"]) == 1 and "stopped after" in record["cuts_refused"][0]
    assert said.count("cannot be filled in time: it is not cut") == 1
