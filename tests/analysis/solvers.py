"""Programs that stand in for the solvers: each copies a ready run, writes down that it has run, and exits as they do.

material.nu chooses the run: a number, or how a run ends that is not ok. The springs refuse 0.1.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from synthetic import write_run

from analysis.run_store import Here

_PROGRAM = """#!{python} -SE
import json, os, shutil, sys, time
name, home = os.path.basename(sys.argv[0]), {home!r}
out = sys.argv[sys.argv.index("--out") + 1]
settings = dict(word.split("=", 1) for word in sys.argv if "=" in word)
nu = settings.get("material.nu", "0.25")
if "--check" in sys.argv:
    print('{{"models": ["affine"], "law": "small_strain"}}')
    sys.exit(nu == "0.1")
with open(home + "/log.txt", "a") as log:
    budget = sys.argv[sys.argv.index("--budget") + 1 :][:1] if "--budget" in sys.argv else []
    log.write(" ".join([name, str(sorted(settings.items())), *budget]) + "\\n")
time.sleep({seconds})
if nu == "0.6":
    sys.exit("error: scene.toml: material.nu = 0.6, expected less than 0.5")
source = home + "/" + name + "_" + nu
if name == "fem_reference" and not os.path.isdir(source):
    source = home + "/" + name
refined = source + "_refine_" + settings.get("reference.refine", "")
if os.path.isdir(refined):
    source = refined
shutil.copytree(source, out, dirs_exist_ok=True)
with open(out + "/run.json") as record:
    status = json.load(record)["status"]
sys.exit(dict(ok=0, not_solved=3).get(status, 2))
"""

ENDS = {
    "massspring_diverge": {"status": "diverged"},
    "massspring_stuck": {"status": "not_converged", "reason": "step 2 of 5"},
    "fem_reference_far": {"status": "not_converged"},
    "fem_reference_late": {"status": "stopped_early", "reason": "after 2 of 5 steps"},
    "massspring_late": {"status": "stopped_early", "reason": "after 2 of 5 steps"},
    "fem_reference_touched": {
        "status": "not_solved",
        "reason": "reference.inertia_relief: for static scenes at small strain",
    },
}

ERRORS = {"0.25": 0.1, "0.3": 0.2, "0.45": 0.4}  # of the stand-in for the springs


def make_solvers(home: Path, ball: tuple[np.ndarray, np.ndarray], seconds: float = 0) -> Path:
    """A folder of programs; their calls are listed in its log.txt."""
    home.mkdir()
    few = np.linspace(0, 1, 2)
    more = {
        "is_free": False,
        "n_tetrahedra": 1,
        "convergence": {"status": "ok", "estimated_error_l2_finest": 0.01, "error_ratio": 2},
    }
    write_run(home / "fem_reference", *ball, lambda X: 0.01 * X, few, program="fem_reference", **more)
    for nu, error in ERRORS.items():
        write_run(
            home / f"massspring_{nu}",
            *ball,
            lambda X, error=error: 0.01 * (1 + error) * X,
            few,
            calibration="affine",
        )
    for name, record in ENDS.items():
        (home / name).mkdir()
        (home / name / "run.json").write_text(json.dumps(record))
    programs = home / "bin"
    programs.mkdir()
    for name in ("fem_reference", "massspring", "gmsh_worker", "tetgen_worker"):
        file = programs / name
        file.write_text(_PROGRAM.format(python=sys.executable, home=str(home), seconds=seconds))
        file.chmod(0o755)
    return programs


def wait_for_calls(programs: Path, n: int, more: float) -> None:
    """Returns that many seconds after n programs have been called."""
    while len(calls(programs)) < n:
        time.sleep(0.005)
    time.sleep(more)


def calls(programs: Path) -> list[str]:
    log = programs.parent / "log.txt"
    return log.read_text().splitlines() if log.exists() else []


class Backwards(Here):
    """An engine that makes the last first."""

    def each(self, function, items):
        return reversed([function(item) for item in reversed(list(items))])
