"""Measurements of a race whose seconds and errors are given."""

from __future__ import annotations

from analysis.run_store import Outcome
from analysis.studies.race import SMALL, Measurement, Rung, methods_of


def timed(cpu: float = 1.0, memory: float = 0, n_steps: int = 1, **seconds: float) -> Outcome:
    """A run of a second, by its stages."""
    record = {"seconds": seconds, "peak_memory": memory, "n_steps": n_steps, "n_nodes": 6}
    return Outcome("ok", "", 1.0, cpu, 0.0, record=record)


def measurement(*outcomes: Outcome, method: str = "uniform", rung: Rung | None = None, **more) -> Measurement:
    """One rung of a method of statics at small strain."""
    found = next(m for m in methods_of({}, SMALL) if m.name == method)
    return Measurement(found, rung or Rung(1), list(outcomes), list(outcomes), **more)
