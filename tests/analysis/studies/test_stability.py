from pathlib import Path

import pytest
from matplotlib.colors import to_hex

from analysis.__main__ import parse_arguments
from analysis.outputs import forget
from analysis.runs import RunError
from analysis.studies import stability
from analysis.studies.command import main


def rows_of(*outcomes: str) -> list[stability.Row]:
    return [
        {"method": "m", "is_papers": "0", "start": "rest", "E": str(10**i), "h": "1", "outcome": o}
        for i, o in enumerate(outcomes)
    ]


def test_finding_counts_what_is_not_sound():
    assert stability.finding(rows_of("ok", "diverged", "diverged", "short")).endswith("4 cells, 2 diverged.")
    assert stability.finding(rows_of("ok")).endswith("1 cells, all sound.")


def test_finding_tells_the_papers_schemes_from_ours():
    papers = [{**row, "is_papers": "1"} for row in rows_of("diverged", "ok")]
    assert stability.finding([*papers, *rows_of("ok")]) == (
        "The paper's schemes: 2 cells, 1 diverged. Ours: 1 cells, all sound."
    )


def test_table_has_every_outcome_of_every_method():
    head, lines = stability.table(rows_of("ok", "inverted", "ok"))
    assert dict(zip(head, lines[0], strict=True))["sound"] == "2"
    assert dict(zip(head, lines[0], strict=True))["inverted"] == "1"


CELLS = [
    "m,1,rest,1e3,1,diverged,0,2",
    "m,1,rest,1e4,1,ok,1,1",
    "n,0,rest,1e3,1,ok,1,1",
    "n,0,rest,1e4,1,ok,1,1",
]


def test_other_seeds_have_cells_of_their_own_and_are_counted_by_start(tmp_path: Path):
    program = tmp_path / "program"
    head = "method,is_papers,start,E,h,outcome,t,energy_ratio,least_patch"
    program.write_text(
        f"#!/bin/sh\n[ $1 = 0 ] || exit 0\necho {head}\necho n,0,rest,1,1,ok,1,1,0.5\n"
        "echo n,0,random,1,1,inverted,1,1,0.$2\necho n,0,random,2,1,inverted,1,1,-1\n"
    )
    program.chmod(0o755)
    rows = [row for seed in (1, 2, 1) for row in stability.measure(tmp_path, program, seed=seed)]
    assert [row["least_patch"] for row in rows[1::3]] == ["0.1", "0.2", "0.1"]
    assert stability.table_of_seeds(rows)[1] == [["n", "rest", "3", "0", "0"], ["n", "random", "6", "6", "3"]]
    assert stability.measure(tmp_path, write_program(program))[0]["method"] == "m"


def test_seeds_are_those_of_the_command_line(tmp_path: Path, monkeypatch):
    asked = []

    def measure(folder, program, n_cells, is_quiet, seed=None):
        asked.append((seed, n_cells))
        return [{**row, "least_patch": "1"} for row in rows_of("ok", "inverted")]

    monkeypatch.setattr(stability, "measure", measure)
    words = ["study", "stability", "--seeds", "3,11", "--quick", "--out", str(tmp_path)]
    assert main(parse_arguments(words)) == 0
    assert asked == [(3, 210), (11, 210)]
    assert "m,rest,4,2,2" in (tmp_path / "seeds.csv").read_text()


def test_candidates_are_counted_by_law_and_springs(tmp_path: Path, monkeypatch):
    program = tmp_path / "stability_candidates"
    head = "candidate,method,start,E,h,seed,outcome,newton_iterations,bend_error,squash_error"
    rows = [
        f'"J, 1",minimising_{springs},random,1,1,1,{end},{n},{bend},0.5'
        for springs, end, n, bend in [
            ("a", "inverted", 7, 0.25),
            ("a", "ok", 4, 0.25),
            ("b", "not_converged", 1, 0.1),
        ]
    ]
    program.write_text("\n".join(["#!/bin/sh", *(f"echo '{row}'" for row in [head, *rows]), ""]))
    program.chmod(0o755)
    monkeypatch.setattr(stability, "PROGRAMS", tmp_path)
    words = ["study", "stability", "--candidates", "--out", str(tmp_path / "out")]
    assert main(parse_arguments(words)) == 0
    assert "Of 1 laws 0 leave no body inverted." in (tmp_path / "out" / "report.html").read_text()
    lines = (tmp_path / "out" / "candidates.csv").read_text().splitlines()[1:]
    assert lines == ['"J, 1",a,25 %,50 %,2,1,0,11', '"J, 1",b,10 %,50 %,1,0,1,1']


def write_program(file: Path, end: str = "exit 1") -> Path:
    """Writes the cells without the first $1, and lists its calls in log.txt."""
    lines = ["#!/bin/sh", f"echo $1 >> {file.parent}/log.txt"]
    lines += ['[ "$1" = 0 ] && echo method,is_papers,start,E,h,outcome,t,energy_ratio']
    for number, cell in enumerate(CELLS):
        lines.append(f'[ "$1" -le {number} ] && printf {cell[:9]} && echo {cell[9:]}')
    file.write_text("\n".join([*lines, end, ""]))
    file.chmod(0o755)
    return file


def test_measure_reads_the_cells_and_plot_draws_them(tmp_path: Path):
    rows = stability.measure(tmp_path / "out", write_program(tmp_path / "program"))
    assert [row["outcome"] for row in rows] == ["diverged", "ok", "ok", "ok"]
    assert stability.OUTCOMES["diverged"][0].lower() in stability.plot(rows[:2]).lower()


def test_plot_has_stiffness_along_and_steps_up(drawn):
    cells = [("1e3", "1", "ok"), ("1e4", "1", "diverged"), ("1e3", "2", "inverted"), ("1e4", "2", "short")]
    rows = [{"method": "m", "start": "rest", "E": E, "h": h, "outcome": o} for E, h, o in cells]
    (axes,) = drawn(stability).plot(rows).axes
    colours = axes.collections[0].to_rgba(axes.collections[0].get_array())[..., :3]
    expected = [["ok", "diverged"], ["inverted", "short"]]  # a line for each step
    for line, names in zip(colours, expected, strict=True):
        for colour, name in zip(line, names, strict=True):
            assert to_hex(colour) == stability.OUTCOMES[name][0].lower()


def test_killed_map_continues_behind_its_last_whole_row(tmp_path: Path):
    program = write_program(tmp_path / "program")
    whole = stability.measure(tmp_path / "whole", program)
    (tmp_path / "killed").mkdir()
    (file,) = (tmp_path / "whole").glob("cells-*.csv")
    text = file.read_text()
    for cut in (0, 10, text.index("\n") + 1, text.index("rest,1e4"), len(text) - 1):
        (tmp_path / "killed" / file.name).write_text(text[:cut])
        assert stability.measure(tmp_path / "killed", program) == whole
        assert (tmp_path / "killed" / file.name).read_text() == text
    assert (tmp_path / "log.txt").read_text().split() == ["0", "0", "0", "0", "1", "3"]


def test_first_cells_are_enough_to_try_it_out(tmp_path: Path):
    program = write_program(tmp_path / "program")
    assert len(stability.measure(tmp_path, program, n_cells=2)) == 2
    assert len(stability.measure(tmp_path, program)) == 4


def test_program_that_breaks_down_is_no_map(tmp_path: Path):
    with pytest.raises(RunError, match="exit status 3 after 4 cells"):
        stability.measure(tmp_path, write_program(tmp_path / "program", end="exit 3"))


def test_what_forget_takes_away_are_the_cells_too(tmp_path):
    """--force: cells would be taken for measured ones."""
    kept, cells = (tmp_path / name for name in ("cells.toml", "cells-uniform.csv"))
    for file in (kept, cells):
        file.touch()
    forget(tmp_path)
    assert [file.exists() for file in (kept, cells)] == [True, False]
