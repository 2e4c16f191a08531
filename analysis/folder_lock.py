"""A folder that one process at a time works in, as meshing/base/folder_lock.h has it."""

from __future__ import annotations

import fcntl
import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def locked(folder: Path, name: str = ".lock") -> Iterator[None]:
    """Within it, the folder is this process's; while another holds it, that is told on stderr and waited for.

    name: of the file in the folder that is locked and names who holds it. The lock ends with the process, however that ends.
    Folders must not be nested: a process waits for itself.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / name).open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            print(f"{folder} is held by {file.read()}: waiting for its end", file=sys.stderr, flush=True)
            fcntl.flock(file, fcntl.LOCK_EX)
        file.truncate(0)
        file.write(f"process {os.getpid()} ({shlex.join(sys.argv)})")
        file.flush()
        yield
