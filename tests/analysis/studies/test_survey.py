"""The survey: which bodies it takes, and how it counts what became of them."""

from collections import Counter
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from scipy.stats import binomtest

from analysis.__main__ import parse_arguments
from analysis.run_store import Outcome
from analysis.runs import RunError
from analysis.studies import survey
from analysis.studies.survey import (
    Bench,
    Case,
    cases,
    end_of,
    far_slower,
    finding,
    interval,
    pictures_of_failures,
    read_sources,
    row_of,
    study,
    table,
    table_of_agreement,
    table_of_failures,
)


def test_sources_are_many_and_of_each_repository_ten_at_most():
    sources = read_sources().values()
    of = Counter(row["repository"] for row in sources)
    assert len(sources) >= 150 and len(of) >= 20 and max(of.values()) == 10
    assert all(200 <= int(row["vertices"]) <= 20_000 for row in sources)
    assert all(len(row["commit"]) == 40 and len(row["sha256"]) == 64 for row in sources)
    assert len({row["commit"] for row in sources}) == len(of)


def write_bodies(folder, n=40):
    folder.mkdir()
    digests = []
    for number in range(n):
        text = f"solid {number}"
        (folder / f"{number}.STL").write_text(text)
        digests.append(sha256(text.encode()).hexdigest())
    (folder / "notes.txt").write_text("no surface")
    return sorted(digests)


def test_half_of_the_bodies_is_held_out_by_hash(tmp_path):
    digests = write_bodies(tmp_path / "bodies")
    few, all_ = (cases(tmp_path / "bodies", has_held_out, is_quick=True) for has_held_out in (False, True))
    assert [case.digest for case in all_] == digests
    assert [case.digest for case in few] == [digest for digest in digests if int(digest[:2], 16) % 2 == 0]
    assert 10 < len(few) < 30
    remeshed = cases(tmp_path / "bodies", has_held_out=True, is_quick=False)
    assert [case.is_remeshed for case in remeshed] == [False] * 40 + [True] * 40
    drawn = cases(tmp_path / "bodies", has_held_out=False, is_quick=False, count=3)
    assert [case.digest for case in drawn] == 2 * [case.digest for case in few[:3]]
    assert [case.is_remeshed for case in drawn] == [False] * 3 + [True] * 3


def test_a_folder_without_a_surface_is_refused(tmp_path):
    with pytest.raises(RunError, match=r"no surface, expected files that end in \.obj, \.off"):
        cases(tmp_path, has_held_out=False, is_quick=False)


@pytest.mark.parametrize(
    "outcome, end",
    [
        (Outcome("ok", "", 100, 59, 0), "ok"),
        (Outcome("ok", "", 100, 61, 0), "out of time"),
        (Outcome("failed", "exit status -24", 70, 60.1, 0), "out of time"),
        (Outcome("time limit", "", 600, 2, 0), "out of time"),
        (Outcome("not_converged", "it stands still", 1, 1, 0), "failed"),
        (Outcome("failed", "exit status -11", 1, 1, 0), "failed"),
        (Outcome("failed", "no mesher fills it: ./testbed run --remesh", 1, 1, 0), "refused"),
        (Outcome("failed", "no mesher fills it: ./testbed run --remesh", 30, 11, 0), "failed"),
    ],
)
def test_a_run_ends_as_its_time_status_and_message_say(outcome, end):
    assert end_of(outcome) == end


def row(body, program, end, seconds, **more):
    place = {"body": body, "program": program, "surface": "as it is", "load": "sag", "half": "development"}
    return {
        **place,
        "end": end,
        "seconds": str(seconds),
        "estimate": "",
        "price": "",
        "message": "why",
    } | more


ROWS = [
    row("a", "massspring", "ok", 2, estimate="0.05"),
    row("a", "fem_reference", "ok", 21),
    row("b", "massspring", "ok", 4, estimate="0.2"),
    row("b", "fem_reference", "out of time", 60),
    row("c", "massspring", "failed", 1),
    row("c", "fem_reference", "refused", 70),
    row("d", "massspring", "ok", 0.1),
    row("d", "fem_reference", "ok", 5),
]


def test_runs_of_remeshed_surfaces_do_not_count_as_runs_of_bodies_as_they_are():
    remeshed = [row("a", program, "ok", 2, surface="remeshed") for program in ("massspring", "fem_reference")]
    assert finding([*ROWS, *remeshed]) == "Of 4 bodies as they are, 62 % of 8 runs end ok."


def test_runs_are_slower_than_those_under_the_same_load_alone():
    """The other program, ok in 2 s in sag, is out of time under the free load, as this one is."""
    rows = [row("a", program, "out of time", 60, load="free") for program in ("massspring", "fem_reference")]
    rows += [row("a", "massspring", "ok", 2), row("a", "fem_reference", "ok", 3)]
    assert far_slower(rows) == []


def test_runs_are_counted_by_their_ends():
    head, lines = table(ROWS, ["program"])
    assert head[1:6] == ["runs", "ok", "refused", "failed", "out of time"]
    assert lines == [
        ["fem_reference", "4", "2", "1", "0", "1", "50 %", "15 % to 85 %", "13", "19", "21", "-", "2"],
        ["massspring", "4", "3", "0", "1", "0", "75 %", "30 % to 95 %", "2", "3.6", "4", "20 %", "0"],
    ]
    assert finding(ROWS) == "Of 4 bodies as they are, 62 % of 8 runs end ok."


@pytest.mark.parametrize("n_good, n", [(0, 5), (1, 1), (7, 9), (48, 60), (60, 60)])
def test_the_interval_of_a_share_is_wilsons(n_good, n):
    expected = binomtest(n_good, n).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(interval(n_good, n), expected, atol=1e-6)


def test_far_slower_is_what_takes_ten_times_as_long_and_not_a_few_seconds():
    seven_times = [row("d", "massspring", "ok", 3), row("d", "fem_reference", "ok", 20)]
    assert [(row["body"], row["program"]) for row in far_slower(ROWS + seven_times)] == [
        ("a", "fem_reference"),
        ("b", "fem_reference"),
    ]


def test_what_does_not_end_ok_is_named_with_its_source():
    sources = {"b": {"repository": "someone/something", "path": "parts/b.stl"}}
    _, lines = table_of_failures(ROWS, sources)
    assert [line[0] for line in lines] == ["b", "c", "c"]
    assert lines[0][1] == "someone/something: parts/b.stl" and lines[1][1] == "-"
    assert lines[0][-2:] == ["60", "why"]
    told = row(
        "b",
        "massspring",
        "refused",
        1,
        message="failed: /out/b.toml: /out/runs/b-remeshed.off:3: 7/s, not /x/c.off",
    )
    assert table_of_failures([told], sources)[1][0][-1] == "failed: SCENE.toml: FILE:3: 7/s, not c.off"


def test_runs_on_one_surface_that_end_alike_are_a_line():
    of_a = [row("a", "massspring", "refused", 1), row("a", "massspring", "refused", 3, load="free")]
    of_a.append(row("a", "fem_reference", "refused", 2, load="free"))
    apart = [row("a", "massspring", "refused", 1, surface="remeshed"), row("a", "massspring", "failed", 1)]
    unmeshed = row("b", "massspring", "failed", 1)
    del unmeshed["seconds"]
    head, lines = table_of_failures([*of_a, *apart, unmeshed], {})
    assert len(head) == len(lines[0])
    assert lines[0] == [
        "a",
        "-",
        "as it is",
        "massspring sag, free; fem_reference free",
        "refused",
        "3",
        "why",
    ]
    assert [line[2:6] for line in lines[1:]] == [
        ["remeshed", "massspring sag", "refused", "1"],
        ["as it is", "massspring sag", "failed", "1"],
        ["as it is", "massspring sag", "failed", "-"],
    ]


def test_programs_agree_where_their_displacements_do_by_what_springs_expect():
    rows = [
        row(name, program, "ok", 1, displacement=size)
        | ({"estimate": estimate, "price": price} if program == "massspring" else {})
        for name, estimate, price, sizes in [
            ("a", "0.05", "1", ("0.9", "1")),
            ("b", "0.1", "2", ("3", "2.5")),
            ("c", "0.2", "0.5", ("1", "2")),
            ("d", "", "", ("0.25", "1")),
        ]
        for program, size in zip(("massspring", "fem_reference"), sizes, strict=True)
    ]
    rows += [row("e", "massspring", "ok", 1, displacement="1"), row("e", "fem_reference", "failed", 1)]
    rows += [
        row("d", program, "ok", 1, load="free", displacement="2")
        for program in ("massspring", "fem_reference")
    ]
    head, lines = table_of_agreement(rows)
    assert len(set(head)) == len(head) == len(lines[0])
    assert lines == [
        ["sag", "up to 10 %", "2", "1", "15 %", "19 %", "20 %", "1.5", "1.9"],
        ["sag", "above 10 %", "1", "0", "50 %", "50 %", "50 %", "0.5", "0.5"],
        ["sag", "none", "1", "0", "75 %", "75 %", "75 %", "-", "-"],
        ["free", "none", "1", "1", "0 %", "0 %", "0 %", "-", "-"],
    ]


class Recording:
    """A store that runs nothing."""

    def __init__(self, folder):
        self.requests, self.folder = [], folder
        (folder / "curves.csv").write_text("time,max_displacement\n0,0\n1,0.5\n")

    def run(self, request):
        self.requests.append(request)
        record = {"n_nodes": 7, "tetrahedra": {"min_radius_ratio": 0.25}}
        record |= {"estimated_error": 0.02, "seconds": {"solve": 4, "estimate": 3}}
        return Outcome("ok", "", 3, 2, 0, self.folder, record)


def test_a_body_is_centred_scaled_and_run_by_both_programs_under_both_loads(tmp_path, ball):
    X, F = ball
    file = tmp_path / "ball.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in 40 * X * [1, 0.5, 0.25] + 7] + [
        f"f {a} {b} {c}" for a, b, c in F + 1
    ]
    file.write_text("\n".join(lines))
    store = Recording(tmp_path)
    bench = Bench(tmp_path, store)
    rows = bench.measure(Case(file, "0123456789abcdef", is_remeshed=False), ("sag", "free"))
    assert [(r["load"], r["program"], r["end"], r["n_nodes"]) for r in rows] == [
        (load, program, "ok", "7") for load in ("sag", "free") for program in ("massspring", "fem_reference")
    ]
    assert rows[0]["min_radius_ratio"] == "0.25" and rows[0]["half"] == "held-out"
    assert rows[0]["displacement"] == "0.5"
    assert rows[0]["estimate"] == "0.02" and rows[0]["price"] == "0.75"
    assert {request.prefix for request in store.requests} == {("prlimit", "--cpu=60")}
    new, points, _ = bench.surface_of(Case(file, "0123456789abcdef", is_remeshed=False))
    assert f"surface.file={new}" in store.requests[0].overrides
    assert "network.estimate=true" in store.requests[2].overrides
    assert str(new) in Path(store.requests[-1].scene).read_text()
    np.testing.assert_allclose(np.ptp(points, axis=0).max(), 1)
    np.testing.assert_allclose(points.min(axis=0) + points.max(axis=0), 0, atol=1e-12)


def test_a_body_of_which_a_run_is_not_ok_is_drawn(tmp_path, ball):
    """Once; one that cannot be repaired has no surface."""

    class Surfaces:
        folder = tmp_path

        def surface_of(self, case):
            if case.name == "b" * 12:
                raise RunError("no surface")
            return (case.file, *ball)

    wanted = [
        Case(Path(f"{name}.stl"), 20 * name, is_remeshed) for name in "abcd" for is_remeshed in (False, True)
    ]
    rows = [
        row(12 * name, "massspring", end, 1)
        for name, end in zip("abcdd", ["ok", "failed", "refused", "ok", "out of time"], strict=True)
    ]
    figures = pictures_of_failures(rows, Surfaces(), wanted)
    assert list(figures) == [12 * "c", 12 * "d"]
    file, caption = figures[12 * "d"]
    assert caption == f"{12 * 'd'}, its {len(ball[1])} triangles"
    image = pv.read(file)["PNGImage"]
    assert len(np.unique(image, axis=0)) > 3, "edges, faces and background"


def test_the_report_shows_bodies_beside_the_table_of_what_does_not_end_ok(tmp_path, ball, monkeypatch):
    write_bodies(tmp_path / "bodies", 2)

    class StandIn:
        def __init__(self, folder):
            self.folder = folder

        def measure(self, case, loads):
            place = {"surface": case.surface, "half": "development", "message": "", "estimate": ""}
            return [row(case.name, "massspring", "refused", 1, **place) for _ in loads]

        def surface_of(self, case):
            return (case.file, *ball)

    monkeypatch.setattr(survey, "Bench", StandIn)
    words = ["study", "survey", "--quick", "--quiet", "--held-out", "--bodies", str(tmp_path / "bodies")]
    result = study(parse_arguments(words), tmp_path)
    names = [line[0] for line in result.sections[-1].tables["failures"][1]]
    assert len(names) == 2 and list(result.sections[-1].figures) == names


def test_a_row_tells_the_message_of_what_is_not_ok_alone(tmp_path):
    assert row_of(Recording(tmp_path).run(None))["message"] == ""
    assert row_of(Outcome("failed", "no such thing", 3, 2, 0))["message"] == "failed: no such thing"


def test_seconds_of_a_row_are_those_of_computing(tmp_path):
    """Of three seconds on a busy machine the run had a core for two."""
    assert row_of(Recording(tmp_path).run(None))["seconds"] == "2"
