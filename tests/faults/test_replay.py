"""The lists of faults can be planted, and the script that plants them tells caught from survived."""

import re
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import replay
from replay import (
    CAUGHT,
    ROOT,
    SURVIVED,
    Copy,
    Fault,
    ListError,
    find,
    is_python,
    read_lists,
    read_sources,
    summarise,
    target_of,
)

FAULTS = read_lists()


def test_text_of_every_fault_is_found_once():
    sources = read_sources(ROOT)
    for fault in FAULTS:
        file, content = find(fault, sources)
        assert content != sources[file], fault.name


def test_lists_are_long_enough_and_no_name_stands_twice():
    names = [(fault.part, fault.name) for fault in FAULTS]
    assert len(set(names)) == len(names) >= 120
    assert sum(fault.blind for fault in FAULTS) >= 40


def test_tests_named_are_there():
    tests = ROOT / "tests"
    made = "\n".join(file.read_text() for file in tests.rglob("CMakeLists.txt"))
    for fault in FAULTS:
        assert fault.tests, fault.name
        for test in fault.tests:
            if is_python(test):
                file, _, name = test.partition("::")
                assert (ROOT / file).exists(), test
                assert not name or f"def {name.partition('[')[0]}(" in (ROOT / file).read_text(), test
            else:
                assert re.search(rf"\b{target_of(test)}\b", made) or list(
                    tests.rglob(f"{target_of(test)}.cpp")
                ), test


def fault(text, replacement="1", **more):
    return Fault("a fault", text, replacement, ("test_x",), **more)


def test_text_that_is_missing_or_stands_twice_is_refused():
    sources = {ROOT / "a.cpp": "int a = 2;\nint b = 2;\n"}
    with pytest.raises(ListError, match="found 0 times"):
        find(fault("int c = 2"), sources)
    with pytest.raises(ListError, match="found 2 times"):
        find(fault("= 2"), sources)


def test_white_space_of_a_text_matches_any_other():
    (_, content) = find(fault("f(a, b)"), {ROOT / "a.cpp": "x = f(a,\n      b);"})
    assert content == "x = 1;"


def test_the_place_keeps_its_indentation():
    (_, content) = find(fault("    b = 2", replacement="    b = 3"), {Path("a.py"): "if a:\n  b = 2\n"})
    assert content == "if a:\n  b = 3\n"


def test_what_python_cannot_read_is_refused():
    with pytest.raises(ListError, match=r"a\.py:2: expected an indented block"):
        find(fault("b = 2", replacement="# b"), {Path("a.py"): "if a:\n  b = 2\n"})


class WithoutBuilds(Copy):
    """A folder whose one file is the program and its test: it passes as long as it holds a 2."""

    def __init__(self, folder, complaint=""):
        self.folder, self.passed, self.complaint = folder, {}, complaint

    def make(self, targets, jobs=1):
        return self.complaint if "2" not in (self.folder / "a.cpp").read_text() else ""

    def passes(self, test):
        return "2" in (self.folder / "a.cpp").read_text()


@pytest.mark.parametrize(
    "before, after, complaint, verdict",
    [
        ("a = 2", "a = 1", "", CAUGHT),
        ("a = 2", "a = 22", "", SURVIVED),
        ("a = 2", "a = 1", "no semicolon", "does not compile: no semicolon"),
        ("a = 3", "a = 2", "", "test_x fails without the fault, too"),
    ],
)
def test_verdicts(before, after, complaint, verdict, tmp_path):
    (tmp_path / "a.cpp").write_text(before)
    copy = WithoutBuilds(tmp_path, complaint)
    assert copy.replay(fault("a"), "a.cpp", after) == verdict
    assert (tmp_path / "a.cpp").read_text() == before


def test_a_test_that_hangs_notices_the_fault_and_leaves_nothing_at_work(tmp_path, monkeypatch):
    monkeypatch.setattr(replay, "TIME_LIMIT", 5)
    (tmp_path / "test_hangs.py").write_text(
        "import pathlib, subprocess\n"
        "def test_hangs():\n"
        "    child = subprocess.Popen(['sleep', '60'])\n"
        f"    pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(child.pid))\n"
        "    child.wait()\n"
    )
    assert not Copy.passes(SimpleNamespace(folder=tmp_path, build=tmp_path), "test_hangs.py")
    status = Path("/proc", (tmp_path / "pid").read_text(), "status")

    def is_at_work():
        try:
            return "State:\tZ" not in status.read_text()
        except OSError:
            return False

    end = time.monotonic() + 10  # what is killed ends once it has its turn on a busy machine
    while is_at_work() and time.monotonic() < end:
        time.sleep(0.05)
    assert not is_at_work()


def test_summary_counts_each_list_and_all():
    verdicts = {
        fault("a", part="one"): CAUGHT,
        fault("b", part="one"): SURVIVED,
        fault("c", part="two", harmless="same result"): SURVIVED,
    }
    assert summarise(verdicts).splitlines()[2:] == [
        "| one | 2 | 1 | 1 | 0 |",
        "| two | 1 | 0 | 1 | 1 |",
        "| all | 3 | 1 | 2 | 1 |",
    ]
