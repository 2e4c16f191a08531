from pathlib import Path

from analysis import stability


def rows_of(*outcomes: str) -> list[stability.Row]:
    return [
        {"method": "m", "is_papers": "0", "start": "rest", "E": str(10**i), "h": "1", "outcome": o}
        for i, o in enumerate(outcomes)
    ]


def test_finding_counts_what_is_not_sound():
    assert stability.finding(rows_of("ok", "diverged", "diverged", "short")).endswith("4 cells, 2 diverged.")
    assert stability.finding(rows_of("ok")).endswith("1 cells, all sound.")


def test_table_has_every_outcome_of_every_method():
    head, lines = stability.table(rows_of("ok", "inverted", "ok"))
    assert dict(zip(head, lines[0], strict=True))["ok"] == "2"
    assert dict(zip(head, lines[0], strict=True))["inverted"] == "1"


def test_measure_reads_a_finished_map_and_plot_draws_it(tmp_path: Path):
    text = "method,is_papers,start,E,h,outcome,t,energy_ratio\nm,1,rest,1e3,1,diverged,0,2\n"
    (tmp_path / "stability.csv").write_text(text)
    rows = stability.measure(tmp_path)
    assert rows[0]["outcome"] == "diverged"
    assert stability.OUTCOMES["diverged"][0].lower() in stability.plot(rows).lower()
