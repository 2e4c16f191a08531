"""What a large body takes of memory for each node."""

import json
import subprocess

from analysis.paths import PROGRAMS, SCENES


def test_coupled_springs_at_small_strain_hold_no_matrix(tmp_path):
    """A matrix of their patches would take 5 kB of each node, once."""
    nodes, memory = [], []
    for vertices in (3000, 5000):
        folder = tmp_path / str(vertices)
        settings = [
            f"surface.n_vertices={vertices}",
            "network.k=100000000",
            "network.estimate=false",
            "time.load_steps=1",
            "output.curves=false",
            "output.frames_every=0",
        ]
        subprocess.run(
            [PROGRAMS / "massspring", SCENES / "bar_sag.toml", "--no-diagnostics", "--out", folder]
            + [part for word in settings for part in ("--set", word)],
            check=True,
            capture_output=True,
        )
        record = json.loads((folder / "run.json").read_text())
        nodes.append(record["n_nodes"])
        memory.append(record["peak_memory"])
    assert nodes[1] - nodes[0] > 4000
    assert memory[1] - memory[0] < 10e3 * (nodes[1] - nodes[0])
