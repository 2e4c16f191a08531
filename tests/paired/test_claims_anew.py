"""A cheap part of the table of claims, run anew."""

from analysis.paths import PACKAGE, SCENES
from analysis.run_store import Store
from analysis.studies import claims


def test_cheapest_claim_repeats_what_the_page_says(tmp_path):
    """Floppy motions, and what bodies and steps are solved, of the network's first seed."""
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
    anew = {claim.claim: claim for claim in claims.of_bodies(seeds)}
    for name in (
        "PCP fills any closed mesh",
        "implicit solvers take linear time",
        "implicit steps may be longer",
    ):
        assert rows[name][5] == anew[name].verdict, name
    first, *_ = rows["implicit solvers take linear time"][3].split(": ")[1].split(";")
    low, *high = first.split(" to ")
    iterations = float(anew["implicit solvers take linear time"].measured.split(": ")[1].split(";")[0])
    assert float(low) <= iterations <= float((high or [low])[0])
    assert {cells[5].split(" within")[0] for cells in rows.values()} <= {
        "verdict", "---", claims.HOLDS, claims.FAILS, "not testable"
    }  # fmt: skip
