"""The files that take long are told from the others, and what clang-tidy finds is told apart."""

from pathlib import Path

import pytest
from tidy import findings, includes_dealii

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
