"""The description of programs and machine, against what other programs say of them."""

import os
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from analysis.execute import execute
from analysis.machine import describe, has_waited

CACHE = """// a comment
CMAKE_BUILD_TYPE:STRING=Release
CMAKE_CXX_COMPILER:FILEPATH=/bin/echo
CMAKE_CXX_FLAGS:STRING=-Wall
CMAKE_CXX_FLAGS_DEBUG:STRING=-g
CMAKE_CXX_FLAGS_RELEASE:STRING=-O3 -DNDEBUG
"""


def test_programs_are_named_by_what_they_hold(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("DEAL_II_NUM_THREADS", raising=False)
    (tmp_path / "bin").mkdir()
    for name in ("massspring", "gmsh_worker", "test_springs"):
        (tmp_path / "bin" / name).write_text(f"program {name}")
    described = describe(tmp_path / "bin")
    sums = subprocess.run(
        ["sha256sum", "massspring", "gmsh_worker"],
        cwd=tmp_path / "bin",
        capture_output=True,
        text=True,
        check=True,
    )
    expected = {line.split()[1]: line[:16] for line in sums.stdout.splitlines()}
    assert described["programs (SHA-256)"] == expected
    assert described["threads"] == {"OMP_NUM_THREADS": "7", "DEAL_II_NUM_THREADS": "not set"}
    assert described["compiler"] == "unknown" and "flags" not in described
    kilobytes = re.search(r"MemTotal:\s*(\d+) kB", Path("/proc/meminfo").read_text())[1]
    assert abs(described["memory (GB)"] - int(kilobytes) * 1024 / 1e9) < 0.1


def test_seconds_of_a_processor_are_the_programs_and_the_systems(monkeypatch):
    wait, usage = os.wait4, SimpleNamespace(ru_utime=1.5, ru_stime=0.25)
    monkeypatch.setattr(os, "wait4", lambda *given: (*wait(*given)[:2], usage))
    assert execute(["true"]).cpu == 1.75


def test_flags_are_those_of_the_build(tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "CMakeCache.txt").write_text(CACHE)
    described = describe(tmp_path / "bin")
    assert described["flags"] == "Release -Wall -O3 -DNDEBUG"
    assert described["compiler"].startswith("echo")


@pytest.mark.parametrize("share, waited", [(0.91, False), (0.89, True)])
def test_a_run_has_waited_if_a_tenth_of_its_time_is_missing(share, waited):
    assert has_waited(share * 20, 20) == waited
