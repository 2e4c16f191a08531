"""A virtual screen, on which windows open as on a real one."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def screen() -> Iterator[dict[str, str]]:
    """The environment of a program that opens windows on it. Skips a test where Xvfb is not installed."""
    if not shutil.which("Xvfb"):
        pytest.skip("Xvfb is not installed: ./testbed test installs it")
    read, write = os.pipe()
    command = [
        "Xvfb",
        "-displayfd",
        str(write),
        "-screen",
        "0",
        "1600x1000x24",
        "-nolisten",
        "tcp",
        "-noreset",
    ]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        with os.fdopen(read) as told:
            number = told.readline().strip()
        try:
            yield os.environ | {
                "DISPLAY": f":{number}",
                "VTK_DEFAULT_OPENGL_WINDOW": "vtkXOpenGLRenderWindow",
            }
        finally:
            server.terminate()
