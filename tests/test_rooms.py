"""The rooms of the C++ sources may include what stands below them, and nothing else."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOPS = ("meshing", "massspring", "fem_reference")

# What each room may include besides itself; "meshing" stands for all of it but its programs' room `run`.
BELOW = {
    "meshing/base": [],
    "meshing/algebra": ["meshing/base"],
    "meshing/surface": ["meshing/base"],
    "meshing/tetrahedra": ["meshing/base", "meshing/surface"],
    "meshing/scene": ["meshing/base", "meshing/algebra", "meshing/surface"],
    "meshing/network": ["meshing/base", "meshing/surface", "meshing/tetrahedra", "meshing/scene"],
    "meshing/surface_energies": ["meshing/base", "meshing/algebra", "meshing/surface", "meshing/scene"],
    "meshing/run": ["meshing/base", "meshing/surface", "meshing/tetrahedra", "meshing/scene"],
    "massspring/kernels": ["meshing/algebra"],
    "massspring/energies": ["massspring/kernels", "meshing/algebra", "meshing/base", "meshing/surface"],
    "massspring/model": ["massspring/energies", "massspring/kernels", "meshing"],
    "massspring/contact": ["massspring/model", "massspring/kernels", "meshing"],
    "massspring/time": [
        "massspring/contact", "massspring/model", "massspring/energies", "massspring/kernels", "meshing",
    ],
    "massspring/statics": ["massspring/model", "massspring/energies", "meshing"],
    "massspring/calibrations": [
        "massspring/statics", "massspring/model", "massspring/energies", "massspring/kernels", "meshing",
    ],
    "massspring/choices": ["massspring/calibrations", "massspring/time", "meshing"],
    "fem_reference/base": ["meshing/base"],
    "fem_reference/elements": ["fem_reference/base", "meshing"],
    "fem_reference/solvers": ["fem_reference/base", "fem_reference/elements", "meshing/algebra"],
    "fem_reference/solid": ["fem_reference", "meshing"],
}  # fmt: skip


def includes_of(text: str) -> list[str]:
    return re.findall(r'^#include "([^"]+)"', text, re.MULTILINE)


def is_allowed(room: str, included: str) -> bool:
    target = str(Path(included).parent)
    return any(
        target == allowed
        or ("/" not in allowed and target.startswith(allowed + "/") and target != "meshing/run")
        for allowed in [room, *BELOW[room]]
    )


def test_every_folder_of_sources_is_a_room() -> None:
    rooms = {
        str(folder.relative_to(ROOT)) for top in TOPS for folder in (ROOT / top).iterdir() if folder.is_dir()
    }
    assert rooms - {"massspring/examples", "massspring/viewer"} == set(BELOW)


@pytest.mark.parametrize("room", BELOW)
def test_a_room_includes_only_what_stands_below_it(room: str) -> None:
    sources = [file for file in (ROOT / room).iterdir() if file.suffix in (".h", ".cpp")]
    assert sources
    for file in sources:
        for included in includes_of(file.read_text()):
            assert is_allowed(room, included), f"{file.relative_to(ROOT)} includes {included}"


def arrows_of(page: str) -> set[tuple[str, str]]:
    return {(a, b) for a, b in re.findall(r"^  (\S+) --> (\S+)$", page, re.MULTILINE)}


def includes() -> set[tuple[str, str]]:
    """(room, room that it includes); the programs' main.cpp are a room of the top folder's name."""
    drawn = [*BELOW, "massspring", "fem_reference", "massspring/viewer"]
    return {
        (room, below)
        for room in drawn
        for file in (ROOT / room).iterdir()
        if file.suffix in (".h", ".cpp")
        for included in includes_of(file.read_text())
        if (below := str(Path(included).parent)) not in (room, ".")
    }


def reached(start: str, arrows: set[tuple[str, str]]) -> set[str]:
    found = {b for a, b in arrows if a == start}
    return found.union(*(reached(below, arrows) for below in found))


def test_the_picture_of_the_rooms_is_true_and_has_no_arrow_too_many() -> None:
    arrows = arrows_of((ROOT / ".github" / "CONTRIBUTING.md").read_text())
    assert arrows <= includes()
    for room, below in includes():
        assert below in reached(room, arrows), f"{room} includes {below}"
    for room, below in arrows:
        assert below not in reached(room, arrows - {(room, below)}), f"{room} --> {below} follows from others"


FILES = r'^#include (?:<fstream>|<filesystem>|"meshing/base/files.h")'


@pytest.mark.parametrize("room", [room for room in BELOW if not room.startswith("meshing/")])
def test_no_room_of_a_program_opens_files(room: str) -> None:
    """But that of what a machine has, which is asked by files."""
    opens = {
        file.name
        for file in (ROOT / room).iterdir()
        if file.suffix in (".h", ".cpp") and re.search(FILES, file.read_text(), re.MULTILINE)
    }
    assert opens == ({"memory.cpp"} if room == "fem_reference/base" else set())


def test_forbidden_includes_are_seen() -> None:
    text = '#include <vector>\n#include "massspring/energies/springs.h"\n'
    assert includes_of(text) == ["massspring/energies/springs.h"]
    assert not is_allowed("meshing/algebra", "massspring/energies/springs.h")
    assert not is_allowed("massspring/energies", "meshing/scene/scene.h")
    assert not is_allowed("massspring/model", "massspring/contact/contact.h")
    assert not is_allowed("massspring/model", "meshing/run/record.h")
    assert is_allowed("massspring/model", "meshing/scene/scene.h")
