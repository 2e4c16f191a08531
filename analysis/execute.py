"""One run of a program: started, stopped when its time is over, with all that it said and took."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

_ERROR, _WARNING = "error: ", "warning: "


@dataclass(frozen=True)
class Ended:
    """A run that has ended. What it printed is known of one that was quiet."""

    status: int  #: of its exit; negative: the signal that ended it
    is_late: bool  #: it was stopped as its time was over
    output: str  #: on stdout
    said: str  #: on stderr
    wall: float  #: s
    cpu: float  #: s
    load: float  #: load average of the machine as it began

    @property
    def errors(self) -> str:
        return "".join(line.removeprefix(_ERROR) for line in self._lines if line.startswith(_ERROR)).strip()

    @property
    def warnings(self) -> list[str]:
        """Without their mark."""
        return [line.removeprefix(_WARNING).strip() for line in self._lines if line.startswith(_WARNING)]

    @property
    def remarks(self) -> str:
        """All on stderr that is no error."""
        return "".join(line for line in self._lines if not line.startswith(_ERROR))

    @property
    def _lines(self) -> list[str]:
        return self.said.splitlines(keepends=True)


def solver(
    program: Path, scene: Path, out: Path, overrides: tuple[str, ...] = (), options: tuple[str, ...] = ()
) -> list[str]:
    """Words that run a solver on a scene; overrides: KEY=VALUE."""
    settings = (word for override in overrides for word in ("--set", override))
    return [str(program), str(scene), "--out", str(out), *options, *settings]


def execute(command: list[str], is_quiet: bool = True, limit: float | None = None) -> Ended:
    """Runs a program, which dies with this process. One that is quiet shows nothing; limit: s, after which it is stopped."""
    is_late = threading.Event()
    with TemporaryFile() as output, TemporaryFile() as said:
        load, start = os.getloadavg()[0], time.perf_counter()
        process = subprocess.Popen(
            ["setpriv", "--pdeathsig", "KILL", *command, *(["--quiet"] if is_quiet else [])],
            stdout=output if is_quiet else None,
            stderr=said if is_quiet else None,
        )

        def stop() -> None:
            is_late.set()
            process.kill()

        timer = threading.Timer(limit or 0, stop)
        timer.daemon = True
        if limit:
            timer.start()
        _, wait_status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(wait_status)
        for file in (output, said):
            file.seek(0)
        return Ended(
            process.returncode,
            is_late.is_set(),
            output.read().decode(errors="replace"),
            said.read().decode(errors="replace"),
            wall,
            usage.ru_utime + usage.ru_stime,
            load,
        )
