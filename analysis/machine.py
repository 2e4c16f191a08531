"""What a result's seconds and digits depend on beside its inputs: programs, libraries, flags and the machine."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import subprocess
import tempfile
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

#: Held by the timed study or the worker whose timed runs are made on this machine.
LOCK = Path(tempfile.gettempdir()) / "testbed-timed-study.lock"
THREADS = ("OMP_NUM_THREADS", "DEAL_II_NUM_THREADS")
_WAITED = 0.1  # of its time: a run that waits longer tells nothing on seconds
_PROGRAMS = {
    "massspring",
    "fem_reference",
    "gmsh_worker",
    "tetgen_worker",
    "vtk_worker",
    "stability",
    "bench_step",
}
# Debian packages that the programs are linked with.
_LIBRARIES = (
    "libdeal.ii-dev", "libgmsh-dev", "libtet1.5-dev", "libcgal-dev", "libvtk9-dev", "libeigen3-dev", "libsuitesparse-dev",
    "libopenblas0-pthread",
)  # fmt: skip


@cache
def describe(programs: Path) -> dict[str, Any]:
    """Everything by name; programs: the folder of the built programs, within that of the build."""
    files = sorted(file for file in programs.iterdir() if file.name in _PROGRAMS)
    here = str(Path(__file__).parent)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": _output("git", "-C", here, "describe", "--always", "--dirty", "--abbrev=12"),
        **_compiler(programs.parent / "CMakeCache.txt"),
        "libraries": _output("dpkg-query", "-W", "-f", "${Package} ${Version}, ", *_LIBRARIES).rstrip(", "),
        "python": platform.python_version(),
        **{f"python, {name}": version(name) for name in ("numpy", "matplotlib", "pyvista", "vtk")},
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory (GB)": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "threads": {name: os.environ.get(name, "not set") for name in THREADS},
        "programs (SHA-256)": {
            file.name: hashlib.sha256(file.read_bytes()).hexdigest()[:16] for file in files
        },
    }


def kind() -> str:
    """Of this machine, so far as seconds depend on it: processor and cores."""
    return f"{_processor()}, {os.cpu_count()} cores"


def has_waited(cpu: float, wall: float) -> bool:
    """Whether a run of so many seconds waited for a core or a disk for more than a tenth of them; cpu: s of the cores it had."""
    return cpu < (1 - _WAITED) * wall


def _output(*command: str) -> str:
    """What a command prints; "unknown" where that is nothing or the command is not there."""
    try:
        return (
            subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
        )
    except OSError:
        return "unknown"


def _compiler(cache_file: Path) -> dict[str, str]:
    """The compiler and its flags, as CMake keeps them."""
    if not cache_file.exists():
        return {"compiler": "unknown"}
    cached = dict(re.findall(r"^(\w+):\w+=(.*)$", cache_file.read_text(), re.MULTILINE))
    kind = cached["CMAKE_BUILD_TYPE"]
    flags = [kind, cached["CMAKE_CXX_FLAGS"], cached[f"CMAKE_CXX_FLAGS_{kind.upper()}"]]
    compiler = _output(cached["CMAKE_CXX_COMPILER"], "--version").partition("\n")[0]
    return {"compiler": compiler, "flags": " ".join(flags)}


def _processor() -> str:
    found = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
    return found[1] if found else platform.machine()
