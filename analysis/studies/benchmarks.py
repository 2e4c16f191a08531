"""What programs of Google Benchmark measure."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}


def benchmarks_of(program: Path, filter_: str) -> list[dict[str, Any]]:
    """What a program of Google Benchmark measures, with its counters."""
    command = [
        str(program),
        f"--benchmark_filter={filter_}",
        "--benchmark_format=json",
        "--benchmark_min_time=0.2",
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    if "Failed to match any benchmarks" in done.stdout + done.stderr:
        return []
    measured: list[dict[str, Any]] = json.loads(done.stdout)["benchmarks"]
    return [
        benchmark
        for benchmark in measured
        if benchmark["run_type"] == "iteration" and not benchmark.get("error_occurred")
    ]


def cpu_seconds(benchmark: dict[str, Any]) -> float:
    """Of one iteration."""
    return float(benchmark["cpu_time"]) * _UNITS[benchmark["time_unit"]]
