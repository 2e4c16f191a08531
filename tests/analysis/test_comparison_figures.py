"""What a comparison draws."""

from types import SimpleNamespace

import pytest
from synthetic import write_run

from analysis import comparison_figures
from analysis.runs import load_run


@pytest.mark.parametrize(
    "kept, drawn",
    [({"volume"}, ["area"]), ({"area"}, ["volume"]), (set(), ["volume", "area"]), ({"volume", "area"}, [])],
)
def test_change_of_what_the_reference_keeps_is_left_out(kept, drawn, ball, tmp_path, monkeypatch):
    panels = []
    monkeypatch.setattr(comparison_figures, "plot_curves", lambda given, _label: panels.extend(given))
    monkeypatch.setattr(comparison_figures, "_plot_tip", lambda *_: "")
    comparison_figures.plot(
        SimpleNamespace(
            methods={"uniform": load_run(write_run(tmp_path / "run", *ball, lambda X: 0.01 * X))},
            models={},
            of_reference=SimpleNamespace(
                keeps_volume="volume" in kept, keeps_area="area" in kept, estimated_error_l2=None
            ),
            experiment=SimpleNamespace(is_static=True),
        )
    )
    assert [panel.label.split()[0] for panel in panels] == drawn
