"""A cheap part of the table of claims, run anew."""

from analysis.paths import PACKAGE, SCENES
from analysis.points import Store
from analysis.studies import claims


def test_cheapest_claim_repeats_what_the_page_says(tmp_path):
    """Lemma 1's blocks and the floppy motions, of the network's first seed."""
    page = (PACKAGE / "CLAIMS.md").read_text()
    rows = {
        cells[2]: cells
        for cells in ([c.strip() for c in line.split("|")] for line in page.splitlines())
        if len(cells) > 5
    }
    seeds = claims.Seeds(Store(tmp_path), 1)
    keys = ("surface.n_vertices=300", "network.calibration=uniform", "network.connectivity=pcp")
    (floppy,) = seeds.values(SCENES / "bar_sag.toml", keys, lambda o: o.record["n_floppy_motions"])
    low, high = rows["PCP makes a solid of a shell"][3].split(": ")[1].split(";")[0].split(" to ")
    assert float(low) <= floppy <= float(high) and floppy > 0
    assert rows["PCP makes a solid of a shell"][5] == claims.FAILS
    assert {cells[5].split(" within")[0] for cells in rows.values()} <= {
        "verdict", "---", claims.HOLDS, claims.FAILS, "not testable", "holds from rest alone"
    }  # fmt: skip
