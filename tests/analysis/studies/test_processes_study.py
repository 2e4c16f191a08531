"""What several processes take, from their records."""

import pytest

from analysis.studies import processes
from analysis.studies.processes import Solved


def record(n, memory, **of):
    found = {
        "processes": n,
        "n_dofs": 300,
        "linear_iterations": 7,
        "cpu": 2.0,
        "seconds": {"start-up": 0.5},
        "peak_memory": max(memory),
    }
    return Solved(found | ({"of_processes": of | {"peak_memory": memory}} if n > 1 else {}))


def test_seconds_and_memory_are_those_beyond_a_small_body():
    several = record(2, [30e6, 42e6], cpu=[1, 1.5], messages=[3, 4], bytes=[1e6, 5e5], sums=[9, 9])
    small = record(2, [20e6, 19e6], cpu=[0.5, 0.25], messages=[0, 0], bytes=[0, 0], sums=[0, 0])
    row = processes.row("grows", "finite", several, small)
    assert row == ["grows", "finite", "2", "300", "7", "1.8", "7", "1.5", "9", "22"]
    assert len(row) == len(processes.HEAD)


def test_one_process_tells_nobody_anything():
    row = processes.row("grows", "small", record(1, [30e6]), record(1, [20e6]))
    assert row[-5:] == ["0", "0", "0", "0", "10"]


def test_bodies_that_grow_give_each_process_as_many_unknowns():
    sizes = [processes.vertices_for(n, 4000) for n in (1, 2, 4)]
    assert sizes[-1] == 4000
    assert [(size / sizes[0]) ** 1.5 for size in sizes] == pytest.approx([1, 2, 4], rel=1e-2)
