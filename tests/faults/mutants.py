"""Changes the code that every figure rests on in many small ways, one at a time, and says which changes no test notices.

    python tests/faults/mutants.py [FOLDER] [--sample N]

Works on a copy of the tree, in FOLDER or a temporary one, never on the tree itself. A folder keeps its verdicts: what is
done is not done again there. Needs analysis/requirements.txt and the requirements.txt beside this file.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Module of the analysis -> its tests.
TESTS = {
    "compare": "test_compare.py",
    "drawing/warp": "drawing/test_warp.py",
    "run_store": "test_sweep.py",
    "studies/race": "studies/test_work_precision.py",
}
# Looks and words of a command line are for eyes to judge, and most changes to them are harmless.
NOT_SAMPLED = re.compile(r"x_(plot|main)__")
# A picture drawn in one process leaves threads that a fork of it lacks, and waits for: hence the server, which draws none.
CONFIGURATION = f"""
[tool.mutmut]
process_isolation = "forkserver"
source_paths = ["analysis"]
only_mutate = {json.dumps([f"analysis/{module}.py" for module in TESTS])}
also_copy = ["README.md"]
pytest_add_cli_args = ["-q", "-p", "no:cacheprovider", "-k", "not killed"]
pytest_add_cli_args_test_selection = {json.dumps([f"tests/analysis/{test}" for test in TESTS.values()])}
"""


def mutmut(folder: Path, *words: str) -> str:
    environment = {
        "PYTHONPATH": "", "VTK_DEFAULT_OPENGL_WINDOW": "vtkOSOpenGLRenderWindow", "OMP_NUM_THREADS": "1"
    }  # fmt: skip
    run = subprocess.run(
        [sys.executable, "-m", "mutmut", *words],
        cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if run.returncode != 0:
        sys.exit(f"error: mutmut {words[0]}: {(run.stdout + run.stderr)[-2000:]}")
    return run.stdout


def sample(folder: Path, n: int) -> list[str]:
    """At most n changes of each module, always the same."""
    names = []
    for module in TESTS:
        verdicts = json.loads((folder / "mutants" / "analysis" / f"{module}.py.meta").read_text())
        known = sorted(name for name in verdicts["exit_code_by_key"] if not NOT_SAMPLED.search(name))
        names += random.Random(1).sample(known, min(n, len(known)))
    return names


def measure(folder: Path, n: int) -> bool:
    """Prints the verdicts; whether every change of the sample was noticed."""
    for part in ("analysis", "tests"):
        shutil.copytree(
            ROOT / part, folder / part, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    shutil.copy(ROOT / "README.md", folder)
    (folder / "pyproject.toml").write_text(CONFIGURATION)
    mutmut(folder, "run", "--max-children", "1", "analysis.compare.x_volume__mutmut_1")  # makes them all
    names = sample(folder, n)
    mutmut(folder, "run", "--max-children", "1", *names)
    verdicts = dict(re.findall(r"(\S+): (.+)", mutmut(folder, "results", "--all", "true")))
    missed = [name for name in names if verdicts[name] in ("survived", "no tests")]
    for name in missed:
        print(f"{verdicts[name]}: {mutmut(folder, 'show', name)}")
    for module in TESTS:
        count = Counter(
            verdicts[name] for name in names if name.startswith(f"analysis.{module.replace('/', '.')}.")
        )
        print(f"{module}: {', '.join(f'{number} {verdict}' for verdict, number in sorted(count.items()))}")
    return not missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="keeps the copy and its verdicts")
    parser.add_argument("--sample", type=int, default=40, metavar="N", help="changes of each module (40)")
    arguments = parser.parse_args()
    if arguments.folder:
        arguments.folder.mkdir(parents=True, exist_ok=True)
        return 0 if measure(arguments.folder, arguments.sample) else 1
    with tempfile.TemporaryDirectory() as folder:
        return 0 if measure(Path(folder), arguments.sample) else 1


if __name__ == "__main__":
    sys.exit(main())
