"""What the reference solves its equations with."""

from analysis.paths import SCENES
from analysis.run_store import RunRequest, Store


def test_rounding_that_ends_iterations_factorises_nothing_more(tmp_path):
    """Iterations in single precision end above the tolerance that Newton's last steps ask for, here in the fourth."""
    size = ("surface.n_vertices=162", "reference.refine=1", "output.frames_every=0")
    outcome = Store(tmp_path).run(RunRequest("fem_reference", SCENES / "ball_collapses_far.toml", size))
    assert outcome.status == "ok"
    assert "two levels" in outcome.record["solver"]
    assert outcome.record["newton_iterations"] <= 15
