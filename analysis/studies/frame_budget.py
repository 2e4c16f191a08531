"""What a frame budget buys: the smallest error of motion that every method reaches within it, over all its surfaces and steps."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from ..methods import label_of
from ..report import Table
from ..wording import percent, significant
from .race import Measurement, SceneStudy
from .result import Section

#: Budget -> steps a second that it asks for; 0: as much simulated time as time passes.
BUDGETS = {"60 frames/s": 60.0, "30 frames/s": 30.0, "5 frames/s": 5.0, "real time": 0.0}
_USES = {"a game": "60 frames/s", "a preview in an editor": "5 frames/s", "a surgery trainer": "real time"}
_USABLE = 0.3  # what is further off is no answer

_WORDS = [
    "A frame is one step, as in the paper's table 1: a budget of 60 frames a second allows a sixtieth of a second to solve it. "
    "Real time asks that the whole motion takes no longer to solve than it lasts.",
    "Each cell is the smallest error of the displacement over the whole motion within the budget, with nodes and step; no "
    "error counts as less than the reference's own. "
    "Meshing and set-up come before the first frame and are left out.",
]


def meets(m: Measurement, budget: str, end: float) -> bool:
    """Whether a rung's median solution keeps within a budget; end: s, of the motion."""
    seconds, rate = median(m.seconds("solve")), BUDGETS[budget]
    return seconds <= end if rate == 0 else seconds / m.outcomes[0].record["n_steps"] <= 1 / rate


def best_within(scene: SceneStudy, budget: str, method: str | None = None) -> Measurement | None:
    """The measurement of the smallest error within a budget, of one method or of all; None where none is usable."""
    end = scene.scene["time"]["end"]
    fits = [
        m
        for m in scene.measurements
        if m.proven is not None
        and m.proven <= _USABLE
        and (method is None or m.method.name == method)
        and meets(m, budget, end)
    ]
    return min(fits, key=lambda m: (m.proven or 0, m.error or 0), default=None)


def _cell(scene: SceneStudy, m: Measurement | None) -> str:
    if not m:
        return "-"
    step = m.rung.step * scene.scene["time"]["step"]
    return (
        f"{percent(m.proven, 2)} ({m.outcomes[0].record['n_nodes']} nodes, {significant(1e3 * step, 2)} ms)"
    )


def frame_budget(studies: Sequence[SceneStudy]) -> Section:
    """Tables of every method over the budgets, and of what to use where."""
    rows = []
    for scene in studies:
        for method in dict.fromkeys(m.method for m in scene.measurements):
            cells = [_cell(scene, best_within(scene, budget, method.name)) for budget in BUDGETS]
            rows.append([scene.name, label_of(method.name), *cells])
    table: Table = (["scene", "method", *BUDGETS], rows)
    uses = []
    for scene in studies:
        for use, budget in _USES.items():
            best = best_within(scene, budget)
            uses.append(
                [use, budget, scene.name, label_of(best.method.name) if best else "-", _cell(scene, best)]
            )
    advice: Table = (["for", "budget", "scene", "use", "error"], uses)
    return Section("At a frame budget", _WORDS, {}, {"frame_budget": table, "use_when": advice})
