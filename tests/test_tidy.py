"""The files that take long are told from the others, and what clang-tidy finds is told apart."""

import json
import subprocess
from pathlib import Path

import pytest
from tidy import ROOT, findings, includes_dealii, join, third_of

TREE = {
    "a.cpp": '#include "room/a.h"\n',
    "room/a.h": '#include "room/b.h"\n#include <vector>\n',
    "room/b.h": '#include "room/a.h"\n#include <deal.II/base/point.h>\n',
    "c.cpp": '#include "c.h"\n// unlike deal.II, and unlike #include <deal.II/base/point.h>\n',
    "c.h": '#include "generated.h"\n',
}


@pytest.mark.parametrize("source,expected", [("a.cpp", True), ("room/a.h", True), ("c.cpp", False)])
def test_dealii_is_found_through_headers_of_the_project(source: str, expected: bool, tmp_path: Path) -> None:
    for name, text in TREE.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert includes_dealii(tmp_path / source, tmp_path) is expected


def test_findings_keep_the_lines_that_explain_them() -> None:
    first = "/a.h:1:2: error: no name [check]\n    1 | x\n/b.h:5:1: note: from here\n"
    second = "/b.h:3:4: warning: no use [check]\n"
    assert findings(f"2 warnings generated.\n{first}{second}") == [first, second]
    assert findings("2 warnings generated.\n") == []


def test_sources_are_read_together_as_the_build_joins_them(tmp_path: Path) -> None:
    build = tmp_path / "build"
    a, b, c, d = (tmp_path / name for name in ("a.cpp", "b.cpp", "c.cpp", "d.cpp"))
    unity = build / "unity_0.cxx"
    build.mkdir()
    unity.write_text(f'/* joined */\n#include "{a}"\n#include "{b}"\n#include "{c}"\n')
    commands = [
        {"file": str(unity), "command": f"c++ -O3 -o a.o -c {unity}"},
        {"file": str(d), "command": f"c++ -O1 -o d.o -c {d}"},
        {"file": str(a), "command": f"c++ -O2 -o again.o -c {a}"},  # read already
    ]
    first, second = join(commands, build, lambda source: source != b)
    lines = Path(first["file"]).read_text().splitlines()
    assert [line.split()[1] for line in lines] == [f'"{a}"', f'"{c}"']
    assert first["command"] == f"c++ -O3 -c {first['file']}"
    assert (second["file"], second["command"]) == (str(d), f"c++ -O1 -c {d}")
    (alone,) = join(commands, build, lambda source: source == c)
    assert alone["file"] == str(c)


def test_a_third_of_the_tests_is_that_of_their_labels() -> None:
    words = ["ctest", "--test-dir", ROOT / "build", "--show-only=json-v1", "--label-regex", "_[012]$"]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    tests = json.loads(said)["tests"]
    if not tests:
        pytest.skip("no tests are built")
    for test in tests:
        (labels,) = [one["value"] for one in test["properties"] if one["name"] == "LABELS"]
        # Tests of one name share their labels.
        assert str(third_of(Path(test["command"][0]))) in [label.rpartition("_")[2] for label in labels]
