"""Every rung of the ladder ends in a class, and none is silently wrong, crashes or hangs."""

import pytest

from tests.stability import stress

RUNGS = list(stress.rungs())
BAD = ("silent", "crash", "hang")


@pytest.mark.parametrize("program", stress.BOTH)
@pytest.mark.parametrize(
    "rung", [rung for rung in RUNGS if rung.is_quick], ids=[rung.name for rung in RUNGS if rung.is_quick]
)
def test_quick_rung(program, rung, tmp_path):
    outcome = stress.outcome_of(program, rung, tmp_path)
    assert outcome.kind not in BAD, outcome.said


@pytest.mark.parametrize("program", stress.BOTH)
@pytest.mark.parametrize("rung", RUNGS, ids=[rung.name for rung in RUNGS])
def test_whole_ladder(program, rung, tmp_path):
    outcome = stress.outcome_of(program, rung, tmp_path)
    assert outcome.kind not in BAD, outcome.said


def test_quick_names_of_rungs_differ():
    assert len({rung.name for rung in RUNGS}) == len(RUNGS)
