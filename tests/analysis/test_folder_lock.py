"""A folder is one process's at a time: who comes second is told who holds it, waits, and takes what the first has left."""

import os
import signal
import subprocess
import sys
import time

import pytest
from solvers import calls, make_solvers

from analysis.paths import ROOT
from analysis.run_store import RunRequest, Store

_HOLD = """
import sys, time
from pathlib import Path
from analysis.folder_lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(float(sys.argv[2]))
"""
_STORE = """
import sys
from pathlib import Path
from analysis.run_store import RunRequest, Store
store = Store(Path(sys.argv[2]), programs=Path(sys.argv[1]))
print(store.run(RunRequest("massspring", Path(sys.argv[3]), ("material.nu=0.25",))).status)
"""


def start(code, *words):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_second_is_told_who_holds_the_folder_and_gets_it_as_that_is_killed(tmp_path):
    first = start(_HOLD, tmp_path / "out", 1000)
    assert first.stdout.readline() == "held\n"
    second = start(_HOLD, tmp_path / "out", 0)
    assert second.stderr.readline().startswith(f"{tmp_path / 'out'} is held by process {first.pid} (")
    time.sleep(0.2)
    assert second.poll() is None  # it waits
    os.kill(first.pid, signal.SIGKILL)
    assert second.communicate(timeout=60)[0] == "held\n"
    first.communicate()


def test_run_that_another_process_makes_is_waited_for_and_taken(ball, tmp_path):
    programs = make_solvers(tmp_path / "home", ball, seconds=3)
    (tmp_path / "scene.toml").write_text("")
    both = [start(_STORE, programs, tmp_path / "runs", tmp_path / "scene.toml") for _ in range(2)]
    assert [process.communicate(timeout=120)[0] for process in both] == ["ok\n", "ok\n"]
    assert len(calls(programs)) == 1


def test_run_is_that_of_the_programs_as_they_were_when_it_began(ball, tmp_path, monkeypatch):
    """A build meanwhile makes other programs; what has been run is not lost."""
    programs = make_solvers(tmp_path / "home", ball)
    (tmp_path / "scene.toml").write_text("")
    request, store = (
        RunRequest("massspring", tmp_path / "scene.toml"),
        Store(tmp_path / "runs", programs=programs),
    )
    folder, execute = store.folder / store.key(request), Store._execute

    def build_meanwhile(self, request, folder):
        outcome = execute(self, request, folder)
        with (programs / "massspring").open("a") as program:
            program.write("\n# another\n")
        return outcome

    monkeypatch.setattr(Store, "_execute", build_meanwhile)
    assert store.run(request).folder == folder
    assert store.key(request) != folder.name and not store.find(request)


@pytest.mark.parametrize("is_override", [True, False])
def test_a_surface_counts_by_name_and_content_wherever_it_lies(is_override, ball, tmp_path):
    """But for a pair: the folder of one is read for its scene."""
    store = Store(tmp_path / "runs", programs=make_solvers(tmp_path / "home", ball))

    def key(surface, content, is_of_pair=False):
        file, scene = tmp_path / surface, tmp_path / f"{surface.replace('/', '-')}.toml"
        file.parent.mkdir(exist_ok=True)
        file.write_text(content)
        line = f'surface.file="{file}"'
        scene.write_text("" if is_override else f"surface.across=0\n{line}")
        words = (line,) if is_override else ()
        return store.key(RunRequest("massspring", scene, words, is_of_pair=is_of_pair))

    first = key("one/ball.off", "OFF")
    assert key("two/ball.off", "OFF") == first
    assert len({first, key("two/ball.off", "off"), key("two/box.off", "OFF")}) == 3
    assert key("one/ball.off", "OFF", is_of_pair=True) != key("two/ball.off", "OFF", is_of_pair=True)
