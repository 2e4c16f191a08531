"""What several processes take, from their records."""

import pytest

from analysis.paths import PACKAGE
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
    row = processes.row("grows", "finite strain", several, small)
    assert row == ["grows", "finite strain", "2", "300", "7", "1.8", "7", "1.5", "9", "22"]
    assert len(row) == len(processes.HEAD)


def test_one_process_tells_nobody_anything():
    row = processes.row("grows", "small strain", record(1, [30e6]), record(1, [20e6]))
    assert row[-5:] == ["0", "0", "0", "0", "10"]


def test_one_process_that_factorises_has_no_iterations():
    solved = record(1, [30e6])
    del solved.record["linear_iterations"]
    row = processes.row("the same", "ten steps", solved, record(1, [20e6]))
    assert row[processes.HEAD.index("iterations")] == "-"


def test_bodies_that_grow_give_each_process_as_many_unknowns():
    sizes = [processes.vertices_for(n, 4000) for n in (1, 2, 4)]
    assert sizes[-1] == 4000
    assert [(size / sizes[0]) ** 1.5 for size in sizes] == pytest.approx([1, 2, 4], rel=1e-2)


def bar(cpu, messages=(0, 0), sent=(0, 0), sums=(0, 0)):
    """Of 300 unknowns in two slices, which are beside each other."""
    return record(2, [1, 1], cpu=list(cpu), messages=list(messages), bytes=list(sent), sums=list(sums))


SLICES, LEAST = bar([5.0, 3.0], [500, 700], [4e9, 6e9], [1000, 900]), bar([1.0, 1.0])


def test_blocks_of_many_processes_have_more_beside_them_than_slices():
    """Sixteen times the bar's unknowns by sixteen processes: each has twice a slice's."""
    found = processes.extrapolate(16, 16 * 300, SLICES, LEAST)
    assert found.work == pytest.approx(2 * 2.0)
    assert found.messages == pytest.approx(26 * 600 * 2e-6 + 6 * 5e9 * 2 ** (2 / 3) / 1e10)
    assert found.sums == pytest.approx(2 * 4 * 1000 * 2e-6)
    assert found.serial == pytest.approx(2.0 * 16)
    assert found.total == pytest.approx(found.work + found.messages + found.sums + found.serial)


def test_page_of_results_names_the_network_of_the_model():
    assert processes._NETWORK in (PACKAGE / "RESULTS.md").read_text()


def test_a_first_process_that_does_no_more_than_others_is_no_serial_part():
    assert processes.extrapolate(2, 300, bar([2.0, 3.0]), LEAST).serial == 0


def test_efficiency_is_beside_one_process_of_as_many_unknowns(monkeypatch):
    """One process takes 2.5 s of 300 unknowns, less 0.5 s; two slices take 2 s each."""
    monkeypatch.setattr(processes, "_COUNTS", (1, 2))
    one, least = record(1, [1]), Solved(record(1, [1]).record | {"cpu": 0.0})
    pairs = {1: (one, least), 2: (bar([3.0, 3.0]), LEAST)}
    same = processes.far_row("the same", "small strain", 8, pairs)
    grows = processes.far_row("grows", "small strain", 8, pairs)
    assert len(same) == len(processes.FAR_HEAD)
    assert same == ["the same", "small strain", "8", "300", "0.5", "0", "0", "0", "50 %"]
    assert grows == ["grows", "small strain", "8", "1200", "2", "0", "0", "0", "50 %"]


def test_one_process_of_a_smaller_body_would_take_in_proportion_to_unknowns(monkeypatch):
    """One process takes 2.5 s of 200 unknowns, so 7.5 s of the 600 that four have; each of two takes 2 s of its 150."""
    monkeypatch.setattr(processes, "_COUNTS", (1, 2))
    one = record(1, [1])
    one.record["n_dofs"] = 200
    pairs = {
        1: (one, Solved(one.record | {"cpu": 0.0, "seconds": {"start-up": 0.0}})),
        2: (bar([3.0, 3.0]), LEAST),
    }
    assert processes.far_row("grows", "small strain", 4, pairs)[-1] == "94 %"
