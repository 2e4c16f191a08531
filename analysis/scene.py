"""Scenes made in Python: the keys of a scene file, written as TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .paths import write_text
from .runs import RunError


class Scene(dict[str, Any]):
    """The keys of a scene file, tables as dicts and arrays of tables as lists of dicts.

    Scene(surface={"shape": "bar"}, gravity=[0, -9.81, 0]); what the keys mean stands in meshing/README.md. Values may be
    numpy's. Files are taken from the current folder.
    """

    def to_toml(self) -> str:
        """The text of a scene file. Raises RunError for a value that TOML has no form for."""
        plain = _plain(self, "")
        lines = [f"{_key(key)} = {_text(value)}" for key, value in plain.items() if not _is_table(value)]
        for key, value in plain.items():
            if isinstance(value, dict):
                lines += ["", f"[{_key(key)}]", *_lines(value)]
            elif _is_table(value):
                for part in value:
                    lines += ["", f"[[{_key(key)}]]", *_lines(part)]
        return "\n".join(lines).lstrip() + "\n"

    def write(self, file: Path | str) -> Path:
        """Writes the scene's file, its folder too where it is missing. Raises RunError as to_toml does."""
        file = Path(file)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, self.to_toml())
        return file


def toml_of(value: Any, key: str) -> str:
    """One value as TOML, in one line; key: where it stands. Raises RunError as to_toml does."""
    return _text(_plain(value, key))


_DEEPEST = 100  # tables and lists within each other: what holds itself has no end


def _plain(value: Any, place: str, depth: int = 0) -> Any:
    """The same of TOML's own types, without keys that have no value."""
    if depth > _DEEPEST:
        raise RunError(f"{place[:60]}... lies {depth} deep, expected tables and lists of an end")
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str) or not _is_text(key):
                raise RunError(f"{place or 'scene'} has the key {key!r}, expected text")
        inner = f"{place}." if place else ""
        return {
            key: _plain(part, f"{inner}{key}", depth + 1) for key, part in value.items() if part is not None
        }
    if isinstance(value, list | tuple):
        return [_plain(part, f"{place}[{index}]", depth + 1) for index, part in enumerate(value)]
    if isinstance(value, Path | str) and not _is_text(str(value)):
        raise RunError(f"{place} = {str(value)!r}, expected text of Unicode without NUL")
    if isinstance(value, Path) or (isinstance(value, str) and value and place.endswith(".file")):
        return str(Path(value).resolve())
    if isinstance(value, bool | int | float | str):
        return value
    raise RunError(
        f"{place} is a {type(value).__name__}, expected a number, text, bool, list, dict or array of these"
    )


def _is_text(text: str) -> bool:
    return "\0" not in text and not any("\ud800" <= letter <= "\udfff" for letter in text)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(part, dict) for part in value)
    )


def _lines(table: dict[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_text(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quoted(key)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON allows it, TOML does not


def _text(value: Any) -> str:
    """In one line: tables within others are inline."""
    if isinstance(value, dict):
        inner = ", ".join(_lines(value))
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list):
        return f"[{', '.join(_text(part) for part in value)}]"
    return (
        _quoted(value)
        if isinstance(value, str)
        else str(value).lower()
        if isinstance(value, bool)
        else repr(value)
    )
