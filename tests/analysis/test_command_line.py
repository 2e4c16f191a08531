"""The command line: help without set-up, one line for an error, and a run that is stopped by hand."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from contextlib import suppress
from pathlib import Path

import pytest
from solvers import calls, make_solvers
from synthetic import write_run

from analysis import __main__ as command_line
from analysis.__main__ import parse_arguments
from analysis.paths import ROOT

# As ./testbed starts it, with stand-ins in place of the solvers.
_MAIN = """
import sys
from pathlib import Path
from analysis import experiment, run_store
experiment.PROGRAMS = Path(sys.argv.pop(1))
run_store.Store.__init__.__defaults__ = (3600, experiment.PROGRAMS)
from analysis.__main__ import main
sys.exit(main())
"""
# What sets up, and where it would leave its traces.
_SET_UP = ("apt-get", "dpkg-query", "sudo", "cmake", "ninja", "python3")
_COMMANDS = re.findall(r"^  \./testbed (\w+)", (ROOT / "testbed").read_text(), re.MULTILINE)


@pytest.fixture
def bare_tree(tmp_path):
    """A tree in which nothing has been set up; calls of what would set it up are listed in calls.txt."""
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in _SET_UP:
        (tools / name).write_text(f'#!/bin/sh\necho {name} "$@" >>{tmp_path}/calls.txt\nexit 1\n')
        (tools / name).chmod(0o755)
    for name in ("testbed", "CITATION.cff"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def in_tree(tree, *words):
    path = f"{tree / 'tools'}:/usr/bin:/bin"
    return subprocess.run(
        [tree / "testbed", *words], env={"PATH": path}, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("words", [[], ["--version"], *([name, "--help"] for name in _COMMANDS)])
def test_help_and_version_set_up_nothing(words, bare_tree):
    done = in_tree(bare_tree, *words)
    assert done.returncode == 0 and done.stdout and not done.stderr
    assert {file.name for file in bare_tree.iterdir()} == {"tools", "testbed", "CITATION.cff"}


def test_what_runs_does_set_up(bare_tree):
    in_tree(bare_tree, "run")
    assert "apt-get" in (bare_tree / "calls.txt").read_text()


def test_version_is_that_of_the_citation(bare_tree):
    stated = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1]
    assert in_tree(bare_tree, "--version").stdout.split()[-1] == stated
    package = tomllib.loads((ROOT / "pyproject.toml").read_text()).get("project", {})
    assert package.get("version", stated) == stated


def command(programs: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", _MAIN, programs, *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )


def error_line(said: str) -> str:
    """The only line that is not what a run tells of its size and stage."""
    told = ("162 vertices, about ", "finite elements")
    (line,) = [line for line in said.splitlines() if line and not line.startswith(told)]
    return line


def scene_in(folder: Path) -> str:
    file = folder / "scene.toml"
    file.write_text('name = "synthetic"\n')
    return str(file)


@pytest.mark.parametrize("options", [[], ["--quiet"]])
def test_error_that_a_solver_has_told_is_not_told_again(options, ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball)
    words = ["--set", "material.nu=0.6", "--out", str(tmp_path / "out"), *options]
    running = command(programs, "run", scene_in(tmp_path), *words)
    _, errors = running.communicate()
    assert running.returncode == 1
    assert error_line(errors) == "error: scene.toml: material.nu = 0.6, expected less than 0.5"


def test_solver_that_dies_without_a_word_is_told(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball)
    (programs / "fem_reference").write_text("#!/bin/sh\nkill -KILL $$\n")
    running = command(programs, "run", scene_in(tmp_path), "--out", str(tmp_path / "out"))
    _, errors = running.communicate()
    assert running.returncode == 1
    assert error_line(errors) == "error: fem_reference gave no result (exit status -9)"


def n_alive(home: Path) -> int:
    """Processes whose command line names the folder of the stand-ins as their program's."""
    n = 0
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has just ended
            n += str(home / "bin").encode() + b"/" in file.read_bytes()
    return n


@pytest.mark.parametrize("words", [["run"], ["sweep", "--set", "material.nu=0.25,0.3"]])
def test_stopped_by_hand_it_says_how_to_continue_and_leaves_no_child(words, ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball, seconds=60)
    name, *more = words
    line = [name, scene_in(tmp_path), *more, "--out", str(tmp_path / "out")]
    running = command(programs, *line)
    while not calls(programs):
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate()
    assert running.returncode == 130
    assert error_line(errors) == f"stopped; to continue: ./testbed {' '.join(line)}"
    until = time.monotonic() + 10
    while n_alive(programs.parent) and time.monotonic() < until:
        time.sleep(0.01)
    assert n_alive(programs.parent) == 0


def test_what_a_run_is_told_reaches_its_solvers(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(command_line, "run_solvers", lambda *words, **more: asked.append((words, more)))
    monkeypatch.setattr(command_line, "results_of", lambda *_: {"status": "ok"})
    monkeypatch.setattr(command_line, "text_of", lambda _: "")
    words = [
        "run", "scene.toml", "--surface", "a.stl", "--up", "z", "--units", "mm", "--set", "material.nu=0.3",
        "--out", str(tmp_path), "--time-limit", "5", "--budget", "7", "--quiet",
    ]  # fmt: skip
    assert command_line.run(parse_arguments(words)) == 0
    overrides = ["material.nu=0.3", 'surface.up="z"', 'surface.unit="mm"']
    assert asked == [((Path("scene.toml"), tmp_path, Path("a.stl"), overrides, True, 5), {"budget": 7})]


def test_a_pipe_that_is_closed_ends_it_without_a_word(ball, tmp_path):
    runs = [write_run(tmp_path / name, *ball, lambda X: 0.01 * X) for name in "ab"]
    closed, end = os.pipe()
    os.close(closed)
    words = ["compare", *runs, "--out", tmp_path / "out"]
    done = subprocess.run(
        [sys.executable, "-m", "analysis", *words],
        cwd=ROOT, stdout=end, stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    os.close(end)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_run_whose_reference_was_stopped_early_returns_2_without_a_report(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball)
    (tmp_path / "home" / "fem_reference_late" / "scene.toml").write_text("[network]\n[comparison]\n")
    (tmp_path / "scene.toml").write_text("")
    words = [
        "run",
        tmp_path / "scene.toml",
        "--out",
        tmp_path / "out",
        "--set",
        "material.nu=late",
        "--budget",
        "5",
    ]
    command = [sys.executable, "-c", _MAIN, programs, *words, "--quiet"]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: ") and "stopped_early, after 2 of 5 steps" in done.stderr
    assert not (tmp_path / "out" / "report.html").exists()
