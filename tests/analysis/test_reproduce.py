"""Published tables and figures: all are in the manifest, and the cheapest come out as they are stored."""

import base64
import io
import re
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pages import PAGES, fetched
from PIL import Image

from analysis import reproduce as module
from analysis.__main__ import parse_arguments
from analysis.paths import PROGRAMS, ROOT
from analysis.report import image_figure
from analysis.reproduce import (
    Entry,
    cell_of,
    entries,
    fresh_cells,
    main,
    on_page,
    read_table,
    reproduce,
    stored_file,
    tables_of,
)
from analysis.reproduction import compare_files, compare_tables, differences, kept_in
from analysis.runs import RunError

PAGE = """# Title

## One

| a | b |
|---|---|
| explained | words |

## Two

Text.

| scene | error |
|---|---|
| `x` | 1.5 % |
| `y` | rounding |

| c | d |
|---|---|
| z | 3 |
"""


def is_measured(rows):
    """More than half of the cells behind the labels are numbers."""
    cells = [cell for row in rows for cell in row[1:]]
    numbers = sum(bool(re.fullmatch(r"[-+<]?\s*\d[\d., /()e-]*(%|s|ms)?", cell)) for cell in cells)
    return numbers > len(cells) / 2


def test_every_measured_table_is_in_the_manifest():
    known = {(entry.page, entry.heading, table) for entry in entries().values() for table in entry.tables}
    found = set()
    for file in PAGES:
        page = str(file.relative_to(ROOT))
        text = file.read_text()
        for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
            for number, (_, (_, rows)) in enumerate(tables_of(text, heading), 1):
                if is_measured(rows):
                    found.add((page, heading, number))
    assert found <= known
    assert {entry for entry in known if entry[2]} <= {
        (page, heading, n + 1)
        for page, heading, _ in known
        for n in range(len(tables_of((ROOT / page).read_text(), heading)))
    }


def test_every_figure_is_in_the_manifest():
    schemes = set(tomllib.loads(module.MANIFEST.read_text())["schemes"])
    made = {figure for entry in entries().values() for figure in entry.figures}
    for file in PAGES:
        if file.name == "GALLERY.md":  # its pictures are those of its own study
            continue
        for link in re.findall(r"!\[[^]]*\]\(([^)]*)\)", file.read_text()):
            figure = (file.parent / link).resolve()
            assert figure.exists()
            assert str(figure.relative_to(ROOT)) in made | schemes, f"{file}: {link}"


def test_tables_are_found_by_section_and_order():
    (_, first), (start, second) = tables_of(PAGE, "Two")
    assert first == (["scene", "error"], [["x", "1.5 %"], ["y", "rounding"]]) and second[1] == [["z", "3"]]
    assert PAGE.splitlines()[start] == "| c | d |"
    assert tables_of(PAGE, "Three") == []


_MADE_BY_STUDY = {
    "accuracy",
    "accuracy_by_load",
    "accuracy_equal_nodes",
    "accuracy_exact_fields",
}  # of its rows


@pytest.mark.parametrize("entry", [e for e in entries().values() if e.tables], ids=lambda entry: entry.name)
def test_cells_of_a_page_are_those_that_its_command_left(entry):
    if entry.name in _MADE_BY_STUDY:
        pytest.skip("its rows are stored: tests/analysis/studies/test_accuracy.py")
    for number in entry.tables:
        file = stored_file(entry, number)
        assert on_page(entry, number) == read_table(file)


def test_every_kind_of_published_picture_can_stand_on_the_page_of_all(tmp_path):
    for suffix in {Path(figure).suffix for entry in entries().values() for figure in entry.figures} - {
        ".svg"
    }:
        picture = tmp_path / f"picture{suffix}"
        picture.write_bytes(b"bytes")
        assert f"data:image/{suffix[1:]};base64," in image_figure(picture, "a caption")


def test_no_stored_figures_are_left_over():
    files = {stored_file(entry, number) for entry in entries().values() for number in entry.tables}
    assert set(module.PUBLISHED.glob("*")) <= files


@pytest.mark.parametrize(
    "stored, fresh, found",
    [
        ("1.5 %", "1.6 %", []),
        ("1.5 %", "1.8 %", ["1.5 % -> 1.8 %"]),
        ("rounding", "rounding", []),
        ("rounding", "2 %", ["rounding -> 2 %"]),
        ("1.2 / 3.0 %", "1.2 / 4.0 %", ["1.2 / 3.0 % -> 1.2 / 4.0 %"]),
        ("not converged", "3 %", ["not converged -> 3 %"]),
        ("54 800", "54 900", []),
        ("", "1", ["nothing -> 1"]),
    ],
)
def test_cells_differ_in_words_or_beyond_the_tolerance(stored, fresh, found):
    assert differences([stored], [fresh], 0.1) == found


def test_a_cell_is_a_count_a_share_or_the_word_for_it():
    values = {
        "reference": {"estimated_error_l2": None},
        "models": {"a": {"status": "ok", "e": 0.0123, "n": 7, "tiny": 1e-12}, "b": {"status": "diverged"}},
    }
    keys = (
        "models.a.e",
        "models.a.n",
        "models.a.tiny",
        "models.b.e",
        "models.c.e",
        "reference.estimated_error_l2",
        "",
    )
    assert [cell_of(values, key) for key in keys] == ["1.2 %", "7", "rounding", "not converged", "", "-", ""]


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A project of one page, whose runs give 1.6 % and rounding."""
    (tmp_path / "PAGE.md").write_text(PAGE)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "OUT", tmp_path / "out")
    monkeypatch.setattr(module, "STORED", tmp_path / "stored.json")
    monkeypatch.setattr(module, "describe", lambda _: {"commit": "abc", "processor": "a"})
    monkeypatch.setattr(module, "PUBLISHED", tmp_path / "published")
    fresh = {"x": ["1.9 %"], "y": ["rounding"]}
    monkeypatch.setattr(module, "fresh_cells", lambda entry, row: fresh[row["label"][0]])
    return tmp_path / "PAGE.md"


def said(entry, is_written=False, **more):
    found = reproduce(entry, is_written, is_quiet=True, **more)
    return [line for compared in found for line in compared.differences]


ENTRY = Entry(
    "two", "PAGE.md", "Two", 1, (1,), head=("scene", "error"), columns=("e",), rows=({"label": ["x"]}, {"label": ["y"]})
)  # fmt: skip


def test_a_table_of_runs_is_compared_and_written_in_its_place(page):
    assert said(ENTRY) == ["x: 1.5 % -> 1.9 %"]
    assert page.read_text() == PAGE
    reproduce(ENTRY, is_written=True, is_quiet=True)
    assert on_page(ENTRY, 1) == (["scene", "error"], [["x", "1.9 %"], ["y", "rounding"]])
    assert on_page(ENTRY, 1) == read_table(stored_file(ENTRY, 1))
    assert on_page(ENTRY, 2) == (["c", "d"], [["z", "3"]]), "no other table is touched"
    assert said(ENTRY) == []
    assert '"commit": "abc"' in module.STORED.read_text()


def test_a_table_of_other_rows_is_refused(page):
    with pytest.raises(RunError, match="expected a table of 1 rows"):
        reproduce(replace(ENTRY, rows=ENTRY.rows[:1]), is_written=False, is_quiet=True)
    with pytest.raises(RunError, match="'Two' has 2 tables, expected 3"):
        reproduce(replace(ENTRY, tables=(3,)), is_written=False, is_quiet=True)


@pytest.fixture
def on_its_own(page, monkeypatch):
    """The same project, its second row of a body that is not on this machine. Returns the lines of a command."""
    entry = replace(ENTRY, rows=({"label": ["x"]}, {"label": ["y"], "surface": "bunny.obj"}))
    monkeypatch.setattr(module, "entries", lambda: {"two": entry})
    monkeypatch.setattr(module, "MESHES", page.parent / "meshes")

    def run(*words, commit="abc"):
        monkeypatch.setattr(module, "describe", lambda _: {"commit": commit, "processor": "a"})
        return main(parse_arguments(["reproduce", *words, "--quiet"]))

    return run


def test_rows_without_their_body_are_left_out_and_it_is_said_where_that_is(on_its_own, page, capsys):
    page.write_text(PAGE.replace("1.5 %", "1.9 %").replace("rounding", "7 %"))
    assert on_its_own() == 0
    printed = capsys.readouterr().out
    assert re.search(
        rf"{page.parent}/meshes:\n  bunny.obj: objects/bunny/bunny.obj of https://github.com/odedstein/meshes at commit "
        r"83521327, SHA-256 [0-9a-f]{64}\n",
        printed,
    )
    assert "two (stored of an unknown commit): as stored, 1 of 2 rows left out\n" in printed
    (page.parent / "meshes").mkdir()
    (page.parent / "meshes" / "bunny.obj").write_text("of another commit")
    on_its_own()
    assert "1 of 2 rows left out" in capsys.readouterr().out
    before = page.read_text()
    assert on_its_own("--write") == 1
    assert "not written without bunny.obj" in capsys.readouterr().out and page.read_text() == before


@pytest.mark.parametrize("commit", ["abc-dirty", "unknown"])
def test_nothing_is_written_but_of_a_commit(commit, on_its_own):
    with pytest.raises(RunError, match=f"the tree is {commit}, expected a commit"):
        on_its_own("--write", commit=commit)


def test_every_body_of_a_row_has_a_source():
    wanted = {row["surface"] for entry in entries().values() for row in entry.rows if "surface" in row}
    meshes = tomllib.loads(module.MANIFEST.read_text())["meshes"]
    assert wanted == set(meshes)
    assert set(module.missing_meshes(entries().values())) == {
        name for name in wanted if not (module.MESHES / name).exists()
    }, "those that are here are the files that the manifest names"


def test_figures_of_a_command_are_compared_and_copied(page):
    (page.parent / "old.svg").write_text("old")
    entry = Entry("f", "PAGE.md", "Two", 1, command="printf new > new.svg", figures={"old.svg": "new.svg"})
    assert said(entry) == ["old.svg has changed"]
    reproduce(entry, is_written=True, is_quiet=True)
    assert (page.parent / "old.svg").read_text() == "new"
    with pytest.raises(RunError, match="ended with 3"):
        reproduce(replace(entry, command="exit 3"), is_written=False, is_quiet=True)


def test_tables_of_a_study_are_compared_and_written(page):
    """Its columns without a name and a cell are left out, and those that the manifest names are picked."""
    made = page.parent / "made.csv"
    made.write_text("c,error,\n`bar_sag`,4,\na/to_p-of_A_top.stl,5,\n")
    entry = Entry("s", "PAGE.md", "Two", 1, (2,), command="true", sources=("made.csv",))
    assert said(entry) == ["columns c, d -> c, error"]
    picked = replace(entry, columns=("c",))
    assert said(picked) == ["columns c, d -> c"]
    reproduce(entry, is_written=True, is_quiet=True)
    assert (
        "| c | error |\n| --- | --- |\n| `bar_sag` | 4 |\n| a/to_p-of_A_top.stl | 5 |\n" in page.read_text()
    )
    assert stored_file(entry, 2).read_text() == "c,error\nbar_sag,4\na/to_p-of_A_top.stl,5\n"
    made.write_text("c,error,\nbar_sag,4.2,\na/to_p-of_A_top.stl,7,\n")
    assert said(entry) == ["a/to_p-of_A_top.stl: 5 -> 7"]
    made.write_text("c,error,\nz,5,\n")
    assert said(entry) == ["2 rows -> 1"]
    with pytest.raises(RunError, match="no column 'd', expected one of c, error"):
        reproduce(replace(entry, columns=("d",)), is_written=False, is_quiet=True)


@pytest.mark.parametrize("has_pictures", [False, True])
def test_a_page_that_a_killed_study_has_written_is_compared_with_that_of_the_commit(has_pictures, page):
    """And its pictures, which a second entry of the same command finds different, too."""
    (page.parent / "ball.jpg").write_bytes(_picture(1))
    page.write_text(PAGE.replace("Text.", "![ball](ball.jpg)"))
    git = ["git", "-C", page.parent, "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "a"]):
        subprocess.run([*git, *words], check=True)
    entry = Entry("s", "PAGE.md", "Two", 1, (2,), command="true")
    page.write_text(page.read_text().replace("z | 3", "z | 4"))
    (page.parent / "ball.jpg").write_bytes(_picture(2 if has_pictures else 1))
    changed = ["z: 3 -> 4", "PAGE.md has changed", *["ball.jpg has changed"] * has_pictures]
    assert said(entry) == changed


def _picture(grey):
    """PNG of 4 pixels, the last of which is of that grey."""
    file = io.BytesIO()
    Image.fromarray(np.array([[0, 0], [0, grey]], dtype=np.uint8)).save(file, "PNG")
    return file.getvalue()


def test_a_page_that_a_study_writes_itself_is_told_of(page):
    entry = Entry("s", "PAGE.md", "Two", 1, (2,), command="sed -i 's/z | 3/z | 4/' PAGE.md")
    assert said(entry) == ["z: 3 -> 4", "PAGE.md has changed"]
    assert said(replace(entry, command="true")) == [], "without git a page is compared with itself before"


def test_how_far_a_table_is_off_counts_its_cells_and_names_the_largest_difference():
    stored = (["a", "b"], [["x", "1.00 %"], ["y", "20 of 40"], ["z", "word"]])
    fresh = (["a", "b"], [["x", "1.05 %"], ["y", "20 of 30"], ["z", "words"]])
    found = compare_tables(3, stored, fresh, 0.1)
    assert (found.name, found.n, found.largest) == ("table 3", 6, pytest.approx(0.25))
    assert found.differences == ["y: 20 of 40 -> 20 of 30", "z: word -> words"]
    assert compare_tables(3, stored, stored, 0.1).largest == 0


def test_how_far_a_figure_is_off_is_a_part_of_its_pixels_or_lines(tmp_path):
    new = tmp_path / "new.png"
    new.write_bytes(_picture(7))
    assert compare_files("old.png", _picture(7), new, tmp_path).differences == []
    found = compare_files("old.png", _picture(6), new, tmp_path)
    assert (found.largest, found.differences) == (0.25, ["old.png has changed"])
    assert [Path(file).read_bytes() for file in found.pictures] == [_picture(6), _picture(7)]
    drawn = tmp_path / "new.svg"
    drawn.write_text("a\nb\nc\nd\n")
    assert compare_files("old.svg", b"b\nc\nd\ne\nf\n", drawn, tmp_path).largest == 0.25
    assert compare_files("old.svg", None, drawn, tmp_path).largest == 1


def test_one_page_lists_all_that_is_published_over_several_calls(page, monkeypatch):
    """What fails, what has not been made again, and figures that differ, which are both shown."""
    (page.parent / "old.svg").write_text("<svg>old</svg>")
    listed = {
        "two": ENTRY,
        "fails": Entry("fails", "PAGE.md", "Two", 1, (2,), command="exit 3", sources=("made.csv",)),
        "drawn": Entry(
            "drawn",
            "PAGE.md",
            "Two",
            1,
            command="echo '<svg>new</svg>' > new.svg",
            figures={"old.svg": "new.svg"},
        ),
    }
    monkeypatch.setattr(module, "entries", lambda: listed)
    report = page.parent / "out" / "reproduce" / "report.html"

    def after(name):
        assert main(parse_arguments(["reproduce", name, "--quiet"])) == 1
        text = report.read_text()
        cells = [re.findall("<td>(.*?)</td>", row) for row in re.findall("<tr>(.*?)</tr>", text)]
        return text, [[row[0], row[2], *row[5:9]] for row in cells if len(row) == 10]

    text, rows = after("two")
    assert rows == [
        ["two", "table 1", "4", "1", "21.1 %", "differ"],
        ["fails", "table 2", "-", "-", "-", "not made again"],
        ["drawn", "old.svg", "-", "-", "-", "not made again"],
    ]
    assert "1 differ, 2 not made again" in text and "x: 1.5 % -&gt; 1.9 %" in text and not fetched(text)
    _, rows = after("drawn")
    assert rows[2] == ["drawn", "old.svg", "1", "1", "100 %", "differ"]
    text, rows = after("fails")
    assert [row[-1].partition(":")[0] for row in rows] == ["differ", "failed", "differ"]
    shown = [base64.b64decode(data).decode().strip() for data in re.findall('svg.xml;base64,([^"]*)"', text)]
    assert shown == ["<svg>new</svg>", "<svg>old</svg>"]
    assert kept_in(report.parent)["two"]["commit"] == "abc"


@pytest.mark.parametrize(
    "words, ending, n_runs", [((), "true", 1), ((), "exit 3", 2), (("--write",), "true", 2)]
)
def test_a_command_of_neighbours_is_run_once_unless_it_fails_or_may_read_what_was_published(
    words, ending, n_runs, page, monkeypatch
):
    (page.parent / "made.csv").write_text("c,d\nz,3\n")
    command = f"echo >> runs; {ending}"
    entry = Entry("a", "PAGE.md", "Two", 1, (2,), command=command, sources=("made.csv",))
    monkeypatch.setattr(module, "entries", lambda: {"a": entry, "b": replace(entry, name="b")})
    assert main(parse_arguments(["reproduce", "--quiet", *words])) == (ending != "true")
    assert (page.parent / "runs").read_text() == "\n" * n_runs


def test_a_cluster_is_told_to_the_studies_of_a_command_alone(page):
    testbed = page.parent / "testbed"
    testbed.write_text('#!/bin/sh\necho "$@" >> said\n')
    testbed.chmod(0o755)
    (page.parent / "made.csv").write_text("c,d\nz,3\n")
    command = "./testbed study one && ./testbed study two --quick && ./testbed view three"
    entry = Entry("s", "PAGE.md", "Two", 1, (2,), command=command, sources=("made.csv",))
    reproduce(entry, is_written=False, is_quiet=True, cluster="tcp://a:1")
    assert (page.parent / "said").read_text().splitlines() == [
        "study --cluster tcp://a:1 one", "study --cluster tcp://a:1 two --quick", "view three",
    ]  # fmt: skip


def test_rows_are_of_the_reference_as_the_scene_has_it(tmp_path, monkeypatch):
    """However fine the one is that a verdict needs."""
    values = {True: {"n_nodes": 5, "displacement_error_l2": 0.25}, False: {"n_nodes": 7}}
    asked = []

    def comparison(_, is_as_in_scene=False):
        return SimpleNamespace(as_json=lambda: values[is_as_in_scene])

    for name, stand_in in {
        "OUT": tmp_path,
        "run_solvers": lambda *words, **_: asked.append(words),
        "compare": comparison,
    }.items():
        monkeypatch.setattr(module, name, stand_in)
    entry = Entry("a", "PAGE.md", "Two", 1, columns=("n_nodes", "displacement_error_l2"))
    row = {"label": ["x"], "scene": "bar_sag.toml", "set": ["material.nu=0.3"]}
    assert fresh_cells(entry, row) == ["5", "25 %"]
    ((scene, _, surface, overrides),) = asked
    assert (scene.name, surface, overrides) == ("bar_sag.toml", None, ["material.nu=0.3"])


@pytest.mark.skipif(not (PROGRAMS / "fem_reference").exists(), reason="needs the built programs")
@pytest.mark.parametrize("name, labels", [("readme", ["bar_sag.toml", "ball_collapse.toml"])])
def test_the_cheapest_rows_come_out_as_they_are_stored(name, labels, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "OUT", tmp_path)
    entry = entries()[name]
    for row, stored in zip(entry.rows, on_page(entry, 1)[1], strict=True):
        if row["label"][0] in labels:
            fresh = fresh_cells(entry, row)
            assert differences(stored[-len(fresh) :], fresh, entry.tolerance) == []
