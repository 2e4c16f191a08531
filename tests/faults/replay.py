"""Plants the faults of the lists beside this file one at a time in copies of the tree, and tells which the tests notice.

A fault is a text of the sources, its replacement, and the tests that must fail with it. The text is looked for in all C++
and Python files outside tests/, so that moving code does not lose it; any white space stands for any other.
"""

from __future__ import annotations

import argparse
import ast
import csv
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

HOME = Path(__file__).resolve().parent
ROOT = HOME.parents[1]
TIME_LIMIT = 300  # s: a test that takes longer hangs, and so has noticed the fault
CAUGHT, SURVIVED = "caught", "survived"


class ListError(Exception):
    """A fault that cannot be planted, or a test that is not there."""


@dataclass(frozen=True)
class Fault:
    """One entry of a list."""

    name: str
    text: str
    replacement: str
    tests: tuple[str, ...]  #: "target", "target:gtest filter" or "tests/.../test_x.py[::test]"
    programs: tuple[str, ...] = ()  #: targets that a Python test starts
    blind: bool = False  #: written by someone other than the author of its tests
    harmless: str = ""  #: why no test can notice it; "": one must
    part: str = ""  #: name of its list

    @property
    def pattern(self) -> re.Pattern[str]:
        return re.compile(r"\s+".join(re.escape(word) for word in self.text.split()))

    @property
    def targets(self) -> list[str]:
        """What is to be built for its tests."""
        return [*self.programs, *(target_of(test) for test in self.tests if not is_python(test))]


def is_python(test: str) -> bool:
    return ".py" in test


def target_of(test: str) -> str:
    return test.partition(":")[0]


def read_lists(folder: Path = HOME) -> list[Fault]:
    return [
        Fault(
            **{**entry, "tests": tuple(entry["tests"]), "programs": tuple(entry.get("programs", ()))},
            part=file.stem,
        )
        for file in sorted(folder.glob("*.toml"))
        for entry in tomllib.loads(file.read_text())["fault"]
    ]


def tracked(root: Path) -> list[Path]:
    words = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split("\0")
    return [Path(name) for name in names if name and (root / name).exists()]


def read_sources(root: Path) -> dict[Path, str]:
    """Texts of the C++ and Python files outside tests/."""
    files = (f for f in tracked(root) if f.suffix in {".cpp", ".h", ".py"} and f.parts[0] != "tests")
    return {file: (root / file).read_text() for file in files}


def find(fault: Fault, sources: dict[Path, str]) -> tuple[Path, str]:
    """The one file that holds the fault's text, and its content with the fault. Raises ListError where there is none, or
    where Python cannot read it: any test would notice that."""
    places = [(file, at) for file, text in sources.items() for at in fault.pattern.finditer(text)]
    if len(places) != 1:
        where = ", ".join(str(file) for file, _ in places) or "nowhere"
        raise ListError(
            f"{fault.part}.toml: '{fault.name}': its text is found {len(places)} times ({where}), expected once"
        )
    file, at = places[0]
    content = sources[file][: at.start()] + fault.replacement.lstrip() + sources[file][at.end() :]
    if file.suffix == ".py":
        try:
            ast.parse(content)
        except SyntaxError as error:
            raise ListError(
                f"{fault.part}.toml: '{fault.name}': {file}:{error.lineno}: {error.msg}, expected Python"
            ) from error
    return file, content


class Copy:
    """A copy of the tree with a build folder of its own; what has not changed since the last replay is kept."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.build = folder, folder / "build"
        files = tracked(ROOT)
        for file in files:
            content, there = (ROOT / file).read_bytes(), folder / file
            if not there.exists() or there.read_bytes() != content:
                there.parent.mkdir(parents=True, exist_ok=True)
                there.write_bytes(content)
                shutil.copymode(ROOT / file, there)
        for file in set(tracked_before(folder)) - set(files):
            (folder / file).unlink()
        meshes = ROOT.parent / "shared" / "meshes"
        self.call(["cmake", "-S", str(folder), "--preset", "release", f"-DMESH_FOLDER={meshes}"])
        self.passed: dict[str, bool] = {}

    def call(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.run(words, capture_output=True, text=True, check=False)

    def make(self, targets: Iterable[str], jobs: int = 1) -> str:
        """Builds; the compiler's complaint, empty where there is none."""
        names = list(dict.fromkeys(targets))
        if not names:
            return ""
        made = self.call(["ninja", "-C", str(self.build), "-j", str(jobs), *names])
        return made.stdout + made.stderr if made.returncode else ""

    def passes(self, test: str) -> bool:
        """Raises ListError where there is no such test."""
        if is_python(test):
            words = [
                sys.executable,
                "-m",
                "pytest",
                "-q",
                "-x",
                "-p",
                "no:cacheprovider",
                str(self.folder / test),
            ]
            no_such_test = r"no tests ran|ERROR: (file or directory )?not found"
        else:
            target, _, pattern = test.partition(":")
            words = [
                str(self.build / "bin" / target),
                f"--gtest_filter={pattern or '*'}",
                "--gtest_fail_fast",
            ]
            no_such_test = r"Running 0 tests"
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
        with (
            tempfile.TemporaryDirectory() as elsewhere,
            subprocess.Popen(
                words,
                cwd=elsewhere,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            ) as ran,
        ):
            try:
                said, _ = ran.communicate(timeout=TIME_LIMIT)
            except subprocess.TimeoutExpired:
                os.killpg(ran.pid, signal.SIGKILL)  # with what it has started, which holds its output open
                return False
        if re.search(no_such_test, said):
            raise ListError(f"there is no test {test}")
        return ran.returncode == 0

    def replay(self, fault: Fault, file: Path, content: str) -> str:
        """What becomes of the fault: caught, survived or what is wrong with its entry."""
        if any(test not in self.passed for test in fault.tests):
            if complaint := self.make(fault.targets):
                return f"its tests do not build: {complaint[-300:]}"
            self.passed |= {test: self.passes(test) for test in fault.tests}
        if failing := [test for test in fault.tests if not self.passed[test]]:
            return f"{failing[0]} fails without the fault, too"
        place = self.folder / file
        original = place.read_bytes()
        place.write_text(content)
        try:
            if complaint := self.make(fault.targets):
                return f"does not compile: {complaint[-300:]}"
            return SURVIVED if all(self.passes(test) for test in fault.tests) else CAUGHT
        finally:
            place.write_bytes(original)


def tracked_before(folder: Path) -> list[Path]:
    """Sources of an older copy; its build folder apart."""
    files = (f.relative_to(folder) for f in folder.rglob("*") if f.is_file())
    return [
        f
        for f in files
        if f.parts[0] != "build" and not f.parts[0].startswith(".venv") and "__pycache__" not in f.parts
    ]


def replay_all(faults: list[Fault], folder: Path, jobs: int) -> dict[Fault, str]:
    """Faults of one file go to one copy, one after the other; as many copies as jobs."""
    sources = read_sources(ROOT)
    by_file: dict[Path, list[tuple[Fault, str]]] = {}
    for fault in faults:
        file, content = find(fault, sources)
        by_file.setdefault(file, []).append((fault, content))
    copies: Queue[Copy] = Queue()
    for n in range(min(jobs, len(by_file))):
        copies.put(Copy(folder / str(n)))
    verdicts: dict[Fault, str] = {}

    def replay_file(file: Path) -> None:
        copy = copies.get()
        try:
            for fault, content in by_file[file]:
                try:
                    verdicts[fault] = copy.replay(fault, file, content)
                except ListError as error:
                    verdicts[fault] = str(error)
                print(
                    f"{len(verdicts):4} of {len(faults)}  {verdicts[fault]:10} {fault.part}: {fault.name}",
                    flush=True,
                )
        finally:
            copies.put(copy)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(replay_file, sorted(by_file, key=lambda file: -len(by_file[file]))))
    return verdicts


def summarise(verdicts: dict[Fault, str]) -> str:
    """A table of counts, a row for each list."""
    rows = ["| list | faults | caught | survived | of these harmless |", "|---|---|---|---|---|"]
    parts = [*sorted({fault.part for fault in verdicts}), "all"]
    for part in parts:
        of_part = {f: v for f, v in verdicts.items() if part in (f.part, "all")}
        survivors = [f for f, v in of_part.items() if v == SURVIVED]
        n_caught = sum(v == CAUGHT for v in of_part.values())
        n_harmless = sum(bool(f.harmless) for f in survivors)
        rows.append(f"| {part} | {len(of_part)} | {n_caught} | {len(survivors)} | {n_harmless} |")
    return "\n".join(rows)


def is_right(fault: Fault, verdict: str) -> bool:
    return verdict == (SURVIVED if fault.harmless else CAUGHT)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="regular expression on 'list: name'")
    parser.add_argument("--sample", type=int, help="so many of those that must be caught, chosen by --seed")
    parser.add_argument("--seed", default="", help="by default, the commit's hash")
    parser.add_argument(
        "--folder",
        type=lambda name: Path(name).resolve(),
        default=ROOT / "build" / "faults",
        help="of the copies and the table",
    )
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    arguments = parser.parse_args()

    faults = [f for f in read_lists() if re.search(arguments.only, f"{f.part}: {f.name}")]
    if arguments.sample:
        commit = subprocess.run(
            ["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True, text=True, check=False
        )
        stream = random.Random(arguments.seed or commit.stdout.strip())
        faults = stream.sample([f for f in faults if not f.harmless], arguments.sample)
    try:
        verdicts = replay_all(faults, arguments.folder, arguments.jobs)
    except ListError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    with (arguments.folder / "table.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["list", "fault", "blind", "verdict", "tests", "harmless"])
        for fault in faults:
            row = [
                fault.part,
                fault.name,
                fault.blind,
                verdicts[fault],
                " ".join(fault.tests),
                fault.harmless,
            ]
            table.writerow(row)
    print(summarise(verdicts))
    wrong = [fault for fault in faults if not is_right(fault, verdicts[fault])]
    for fault in wrong:
        print(f"{fault.part}.toml: '{fault.name}': {verdicts[fault]}", file=sys.stderr)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
