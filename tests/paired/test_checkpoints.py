"""A motion that is killed or reaches its budget goes on from its checkpoint, as if nothing had stopped it."""

import csv
import json
import signal
import subprocess
import time

import numpy as np
import pytest
from programs import ended, words_of

from analysis.runs import load_run

SCENE = """
name = "falls"
gravity = [0, -9.81, 0] # m/s2
material.E = 2e4 # Pa

[surface]
shape = "bar"
n_vertices = 60
size = [0.4, 0.1, 0.1] # m

[[supports]]
region = { box = { low = [0, 0, 0], high = [0, 1, 1] }, relative = true }

[time]
mode = "dynamic"
step = 0.002 # s
end = 0.12 # s

[reference]
degree = 1

[output]
frames_every = 7
checkpoint_every = 0.001 # s
"""
FLOOR = "obstacles=[{ plane = { point = [0, -0.01, 0], normal = [0, 1, 0] }, friction = 0.3 }]"
COLLAPSE = "collapse={ pivots = [{ point = [0, 0, 0] }], coefficient = 0.5 }"
LET_GO = "supports.0.end=0.04"
HELD = "volume={ exact = true, target = [[0, 1], [0.1, 1.1]] }"
LINEAR = ("material.law=small_strain", "material.E=1e6")
SPRINGS = {
    "linear": (*LINEAR, "time.integrator=midpoint"),
    "explicit": ("material.law=neo_hookean", "time.integrator=rk4", "time.step=0.0002", LET_GO),
    "collapse": (COLLAPSE, "time.integrator=symplectic_euler", "time.step=0.0002", FLOOR),
    "bdf2": ("time.integrator=bdf2", COLLAPSE, LET_GO),
    "barrier": ("time.integrator=minimising_euler", FLOOR, LET_GO, "self_contact.on=true"),
    "held": ("time.integrator=minimising_euler", HELD, LET_GO),
    "linearised": ("time.integrator=implicit_euler", FLOOR),
}
REFERENCE = {
    "linear": LINEAR,
    "collapse": (COLLAPSE,),
    "barrier": (FLOOR, LET_GO, "reference.integrator=minimising_euler"),
    "explicit": ("material.law=neo_hookean", "reference.integrator=central_differences", "time.step=0.0002"),
    "held": (HELD, LET_GO, "reference.integrator=minimising_euler"),
}
CASES = [("massspring", name, words) for name, words in SPRINGS.items()]
CASES += [("fem_reference", name, words) for name, words in REFERENCE.items()]
SOLVED, NOT_OK = 0, 2


def command(tmp_path, program, overrides, out, *words):
    return words_of(tmp_path, program, SCENE, overrides, out, words)


def record_of(folder):
    return json.loads((folder / "run.json").read_text())


def columns_of(folder):
    names, *rows = csv.reader((folder / "curves.csv").open())
    return names, np.array(rows, dtype=float)


def frames_of(folder):
    return {file.name: file.read_bytes() for file in sorted((folder / "frames").iterdir())}


def kill_until_it_ends(words, folder):
    """Kills the run again and again, each time some steps after the last checkpoint. Returns how often it went on."""
    n_killed = 0
    file = folder / "checkpoint.bin"
    while True:
        before = file.stat().st_mtime_ns if file.exists() else 0
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            while process.poll() is None and n_killed < 2:
                if file.exists() and file.stat().st_mtime_ns != before:
                    time.sleep(0.02)
                    process.send_signal(signal.SIGKILL)
                    break
                time.sleep(0.001)
            said = process.stderr.read().decode()
        if process.returncode != -signal.SIGKILL:
            assert process.returncode == SOLVED, said
            return n_killed
        n_killed += 1
        assert not (folder / "run.json").exists()


@pytest.mark.parametrize("program, name, overrides", CASES, ids=[f"{case[0]}-{case[1]}" for case in CASES])
def test_a_killed_motion_ends_as_one_that_was_not(tmp_path, program, name, overrides):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(tmp_path, program, overrides, "whole"), check=True)
    assert kill_until_it_ends(command(tmp_path, program, overrides, "killed"), killed) > 0
    assert not (killed / "checkpoint.bin").exists()
    assert load_run(killed).times.tolist() == load_run(whole).times.tolist()
    first, second = record_of(whole), record_of(killed)
    assert first["energy_gain"] == pytest.approx(second["energy_gain"], abs=1e-6)
    if program == "massspring":
        assert frames_of(killed) == frames_of(whole)
        assert (killed / "curves.csv").read_bytes() == (whole / "curves.csv").read_bytes()
        assert first["newton_iterations"] == second["newton_iterations"]
        assert first["linear_iterations"] == second["linear_iterations"]
        return
    names, rows = columns_of(whole)
    assert columns_of(killed)[0] == names
    sizes = np.abs(rows).max(axis=0)
    assert (np.abs(columns_of(killed)[1] - rows) <= 1e-6 * sizes + 1e-12).all()


@pytest.mark.parametrize("program", ["massspring", "fem_reference"])
def test_a_budget_stops_a_motion_that_goes_on_another_time(tmp_path, program):
    overrides = (
        *SPRINGS["explicit"],
        "time.end=1e3",
        "reference.integrator=central_differences",
        "output.curves=false",
    )

    def reached(budget, *more):
        done = ended(command(tmp_path, program, overrides, "out", "--budget", str(budget), *more))
        assert done.returncode == NOT_OK, done.stderr
        assert done.stderr.startswith("stopped_early: ")
        record = record_of(tmp_path / "out")
        assert record["status"] == "stopped_early"
        assert "frames.pvd" in record["outputs"]
        return int(record["reason"].split("after ")[1].split()[0]), record

    first, _ = reached(4)
    second, record = reached(4)
    assert 0 < first < second, "the second goes on where the first stopped"
    assert record["wall"] > 8, "both count"
    assert sum(record["seconds"].values()) > 0.75 * record["wall"]
    anew, _ = reached(1, "--force")
    assert anew < second


def test_a_budget_ends_what_does_not_come_to_the_end_of_a_step(tmp_path):
    overrides = (
        "surface.n_vertices=30000",
        "time.mode=static",
        "material.law=neo_hookean",
    )
    done = ended(command(tmp_path, "fem_reference", overrides, "out", "--budget", "0.2"))
    assert done.returncode == NOT_OK, done.stderr
    record = record_of(tmp_path / "out")
    assert record["status"] == "stopped_early"
    assert "its budget of time was spent " in record["reason"]


def test_a_damaged_or_foreign_checkpoint_is_not_gone_on_from(tmp_path):
    overrides, other = SPRINGS["linear"], (*SPRINGS["linear"], "material.nu=0.3")
    out = tmp_path / "out"

    def left_checkpoint():
        words = command(tmp_path, "massspring", (*overrides, "time.end=1e3"), "endless")
        file = tmp_path / "endless" / "checkpoint.bin"
        with subprocess.Popen(words) as process:
            while not file.exists():
                time.sleep(0.001)
            process.kill()
        return file.read_bytes()

    saved = left_checkpoint()
    subprocess.run(command(tmp_path, "massspring", other, "whole"), check=True)
    out.mkdir()
    for foreign in (saved, saved[:-9], b""):
        (out / "checkpoint.bin").write_bytes(foreign)
        subprocess.run(command(tmp_path, "massspring", other, "out", "--force"), check=True)
        assert frames_of(out) == frames_of(tmp_path / "whole")
        (out / "run.json").unlink()
        (out / "checkpoint.bin").write_bytes(foreign)
        subprocess.run(command(tmp_path, "massspring", other, "out"), check=True)
        assert frames_of(out) == frames_of(tmp_path / "whole")
        assert not (out / "checkpoint.bin").exists()
