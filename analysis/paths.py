"""Where the project's parts are, and how a file is written."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parent
SCENES = PACKAGE / "scenes"
OUT = ROOT / "out"
PROGRAMS = ROOT / "build" / "bin"
THUMBNAIL = "thumbnail.jpg"  #: of the bodies, or of the film's frames, beside a report
VIEW = "view.html"  #: of the same bodies, to be turned
MESHES = ROOT.parent / "shared" / "meshes"  #: real meshes, which the project does not ship


def write_text(file: Path, text: str) -> None:
    """Writes to a temporary name, then renames."""
    write_bytes(file, text.encode())


def write_bytes(file: Path, data: bytes) -> None:
    """As write_text."""
    temporary = file.with_name(f"{file.name}.{os.getpid()}.tmp")  # others may write the same
    temporary.write_bytes(data)
    temporary.replace(file)
