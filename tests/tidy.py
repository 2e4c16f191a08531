"""Runs clang-tidy on the project's own C++ sources, by the commands that a build folder holds, on all cores.

Most of its time goes to headers, so the sources of a library are read together, as the build joins them.
Files that include deal.II take half a minute each, and are left out unless they are asked for.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def includes_dealii(source: Path, root: Path = ROOT, seen: set[Path] | None = None) -> bool:
    """By itself or by headers of the project."""
    seen = set() if seen is None else seen
    seen.add(source)
    text = source.read_text()
    if re.search(r"^#include <deal\.II/", text, re.MULTILINE):
        return True
    headers = [root / name for name in re.findall(r'^#include "([^"]+)"', text, re.MULTILINE)]
    return any(includes_dealii(h, root, seen) for h in headers if h.exists() and h not in seen)


def third_of(source: Path) -> int:
    """Of the tests in three parts, as tests/CMakeLists.txt divides them."""
    return int(hashlib.md5(source.stem.encode()).hexdigest()[:6], 16) % 3


def sources_of(command: dict[str, str], build: Path) -> list[Path]:
    """The file that a command compiles, or those that it includes where CMake has joined them."""
    file = Path(command["file"])
    if build not in file.parents:
        return [file]
    return [Path(name) for name in re.findall(r'^#include "(/[^"]+)"', file.read_text(), re.MULTILINE)]


def join(commands: list[dict[str, str]], build: Path, wanted: Callable[[Path], bool]) -> list[dict[str, str]]:
    """Commands for what is wanted of their files, each source once: by itself, or included with others by one file."""
    folder = build / "joined"
    folder.mkdir(exist_ok=True)
    seen: set[Path] = set()
    joined: list[dict[str, str]] = []
    for command in commands:
        sources = [s for s in sources_of(command, build) if s not in seen and wanted(s)]
        if not sources:
            continue
        seen.update(sources)
        unit = sources[0]
        if len(sources) > 1:
            unit = folder / f"{len(joined)}.cpp"
            lines = [f'#include "{s}" // NOLINT(bugprone-suspicious-include)\n' for s in sources]
            unit.write_text("".join(lines))
        flags = command["command"].partition(" -o ")[0]
        joined.append({"directory": str(folder), "file": str(unit), "command": f"{flags} -c {unit}"})
    return joined


def findings(output: str) -> list[str]:
    """Each warning or error with the lines that show its place."""
    return re.split(r"^(?=\S+:\d+:\d+: (?:warning|error): )", output, flags=re.MULTILINE)[1:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("build", type=Path, help="folder that holds compile_commands.json")
    parser.add_argument("--clang-tidy", default="clang-tidy")
    parser.add_argument(
        "--reference", action="store_true", help="files that include deal.II, instead of the others"
    )
    parser.add_argument("--third", type=int, help="of the tests, one of three parts: 0, 1 or 2")
    arguments = parser.parse_args()

    commands = json.loads((arguments.build / "compile_commands.json").read_text())

    build = arguments.build.resolve()

    def is_wanted(source: Path) -> bool:
        own = ROOT in source.parents and build not in source.parents
        is_chosen = (
            arguments.third is None
            or ROOT / "tests" not in source.parents
            or third_of(source) == arguments.third
        )
        return own and is_chosen and includes_dealii(source) == arguments.reference

    joined = join(commands, build, is_wanted)
    database = build / "joined"
    (database / "compile_commands.json").write_text(json.dumps(joined))
    # clang comes without OpenMP's header; the compiler's own are looked at last.
    compiler_headers = subprocess.run(
        ["c++", "-print-file-name=include"], capture_output=True, text=True, check=True
    ).stdout.strip()

    def check(source: str) -> str:
        command = [
            arguments.clang_tidy,
            "--quiet",
            "-p",
            database,
            f"--extra-arg=-idirafter{compiler_headers}",
        ]
        run = subprocess.run([*command, source], cwd=ROOT, capture_output=True, text=True, check=False)
        return (
            run.stdout
            if run.returncode == 0 or findings(run.stdout)
            else f"{source}:1:1: error: {run.stderr}"
        )

    shown: set[str] = set()  # a header's findings come with each file that includes it
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for output in pool.map(check, [command["file"] for command in joined]):
            for finding in findings(output):
                if finding not in shown:
                    print(finding.replace(f"{ROOT}/", ""), end="", flush=True)
                shown.add(finding)
    print(f"clang-tidy: {len(joined)} files, {len(shown)} findings")
    return 1 if shown or not joined else 0


if __name__ == "__main__":
    sys.exit(main())
