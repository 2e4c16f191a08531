"""Curves of the network's error over the paper's parameters, from runs whose errors are known."""

import pytest
from synthetic import write_run

from analysis.run_store import Outcome
from analysis.runs import RunError
from analysis.studies import network_curves
from analysis.studies.claims import Seeds


class Known:
    """A store of runs: springs are off by their seed in per cent, and of two seeds the second fails with k = 50."""

    def __init__(self, folder, surface, status="ok"):
        self.folder, self.surface, self.status = folder, surface, status
        self.asked = []

    def run(self, request):
        settings = dict(word.split("=", 1) for word in request.overrides)
        seed = int(settings.get("network.seed", 0))
        if request.program == "massspring":
            self.asked.append({key: settings[key] for key in sorted(settings) if key != "network.seed"})
        if seed == 2 and settings.get("network.k") == "50":
            return Outcome("not_converged", "", 1, 1, 0)
        folder = self.folder / f"{seed}"
        if not folder.exists():
            program = request.program
            write_run(folder, *self.surface, lambda X: (1 + seed / 100) * X, program=program, is_free=False)
        status = self.status if request.program == "fem_reference" else "ok"
        return Outcome(status, "", 1, 1, 0, folder, {"n_nodes": 100 * seed})


def test_every_value_is_measured_on_both_networks_over_all_seeds(ball, tmp_path):
    store = Known(tmp_path, ball)
    rows = network_curves.measure(Seeds(store, 2))
    values = sum(len(ladder.values) for ladder in network_curves.LADDERS)
    assert len(rows) == 2 * values and len(store.asked) == 4 * values
    assert {row.network for row in rows} == {"pcp", "completed_pcp"}
    for row in rows:
        is_short = (row.ladder.key, row.value) == ("network.k", 50)
        assert row.errors == pytest.approx([1] if is_short else [1, 2])
        keys = {"network.connectivity": row.network, row.ladder.key: str(row.value)}
        assert any(keys.items() <= asked.items() for asked in store.asked)
    section = network_curves.section(rows)
    head, lines = section.tables["network_curves"]
    line = dict(zip(head, next(line for line in lines if line[1] == "100"), strict=True))
    assert (line["runs"], line["error"], line["from"], line["to"]) == ("2", "1.5 %", "1 %", "2 %")
    assert "projective multiplicity" in section.figures["network_curves"][0]


def test_without_a_reference_there_are_no_errors(ball, tmp_path):
    with pytest.raises(RunError, match="the reference ended with not_converged"):
        network_curves.measure(Seeds(Known(tmp_path, ball, "not_converged"), 1))
