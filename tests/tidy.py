"""Runs clang-tidy on the project's own C++ sources, by the commands that a build folder holds, on all cores.

Files that include deal.II take half a minute each, and are left out unless they are asked for.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
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
    arguments = parser.parse_args()

    commands = json.loads((arguments.build / "compile_commands.json").read_text())
    built = {Path(command["file"]) for command in commands}
    sources = sorted(
        source
        for source in built
        if ROOT in source.parents
        and arguments.build.resolve() not in source.parents
        and includes_dealii(source) == arguments.reference
    )
    # clang comes without OpenMP's header; the compiler's own are looked at last.
    compiler_headers = subprocess.run(
        ["c++", "-print-file-name=include"], capture_output=True, text=True, check=True
    ).stdout.strip()

    def check(source: Path) -> str:
        command = [
            arguments.clang_tidy,
            "--quiet",
            "-p",
            arguments.build,
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
        for output in pool.map(check, sources):
            for finding in findings(output):
                if finding not in shown:
                    print(finding.replace(f"{ROOT}/", ""), end="", flush=True)
                shown.add(finding)
    print(f"clang-tidy: {len(sources)} files, {len(shown)} findings")
    return 1 if shown or not sources else 0


if __name__ == "__main__":
    sys.exit(main())
