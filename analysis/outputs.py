"""The files of a result, as its record lists them: name -> bytes and CRC-32 (written by meshing/run/record.h, too)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

#: Of what makes a folder count as finished: run.json of a run, outcome.json of a stored one, comparison.json of a pair, and
#: the cells that the study of stability keeps.
_RECORDS = ("run.json", "outcome.json", "comparison.json", "cells-*.csv")


def stamp_of(file: Path) -> dict[str, Any]:
    """What a record says of a file."""
    data = file.read_bytes()
    return {"bytes": len(data), "crc32": f"{zlib.crc32(data):08x}"}


def list_of(folder: Path, names: Iterable[str]) -> dict[str, Any]:
    """What a record says of files in its folder."""
    return {name: stamp_of(folder / name) for name in names}


def is_as_written(folder: Path, name: str, outputs: dict[str, Any]) -> bool:
    """Whether a file is there and is the one that the record lists."""
    file = folder / name
    return name in outputs and file.is_file() and stamp_of(file) == outputs[name]


def are_as_written(folder: Path, outputs: dict[str, Any]) -> bool:
    """Whether all files of a record are."""
    return all(is_as_written(folder, name, outputs) for name in outputs)


def forget(folder: Path) -> None:
    """Takes the records of all results in a folder away: what is asked for next is made anew."""
    for pattern in _RECORDS:
        for record in folder.rglob(pattern):
            record.unlink(missing_ok=True)
