"""Pages keep to their rules, and the checks of pages find what they are there to find."""

import base64
import re
import shutil
import subprocess

import pytest
from pages import PAGES, anchors, citations, fetched, links, n_words, references, sentences

from analysis.drawing.style import _STYLES
from analysis.experiment import ROOT
from analysis.methods import FEM_P1, FEM_P2, REFERENCE
from analysis.report import page
from analysis.reproduce import tables_of

SVG = base64.b64encode(
    b'<svg xmlns="http://www.w3.org/2000/svg"><image xlink:href="http://a.org/b.png"/></svg>'
).decode()


@pytest.mark.parametrize(
    "page",
    [
        '<img src="http://a.org/b.png">',
        '<img src="b.png">',
        '<link rel="stylesheet" href="b.css">',
        '<script src="https://a.org/b.js"></script>',
        "<style>@import 'b.css';</style>",
        "<style>p { background: url(http://a.org/b.png) }</style>",
        "<script>fetch('https://a.org')</script>",
        f'<img src="data:image/svg+xml;base64,{SVG}">',
    ],
)
def test_what_is_fetched_is_found(page):
    assert fetched(page)


def test_links_namespaces_and_data_are_not_fetched():
    plain = base64.b64encode(
        b'<svg xmlns="http://www.w3.org/2000/svg"><path clip-path="url(#p)"/></svg>'
    ).decode()
    assert not fetched(
        f'<p>see http://a.org <a href="http://a.org">there</a> <img src="data:image/svg+xml;base64,{plain}"></p>'
    )


# A table as a browser has it, of which the script of reports sorts the rows.
_BROWSER = """
const cell = textContent => ({ textContent });
const body = { rows: [], append(row) { this.rows = [...this.rows.filter(r => r != row), row]; } };
for (const row of ["x 10%", "y -", "z 9.5%", "b 1.2e-05%"])
  body.rows.push({ cells: row.split(" ").map(cell), parentNode: body });
const table = { dataset: {}, get rows() { return [{ cells: ["", "error"].map(cell) }, ...body.rows]; } };
const heads = [0, 1].map(cellIndex => ({ cellIndex, closest: () => table }));
global.document = { querySelectorAll: () => heads };
"""
_CLICKS = """
for (const column of [1, 1, 0, 0]) {
  heads[column].onclick();
  console.log(body.rows.map(row => row.cells[0].textContent).join(""));
}
"""


@pytest.mark.skipif(not shutil.which("node"), reason="needs node to run the page's script")
def test_click_on_a_head_sorts_the_table():
    script = re.search("<script>(.*)</script>", page("Title", "Finding.", [], {}), re.DOTALL)[1]
    run = subprocess.run(
        ["node", "-e", f"{_BROWSER}{{{script}}}{_CLICKS}"], capture_output=True, text=True, check=True
    )
    # Numbers as such, words last; a second click turns the order round.
    assert run.stdout.split() == ["bzxy", "xzby", "bxyz", "zyxb"]


every_page = pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(ROOT)))


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


@every_page
def test_no_sentence_is_long(file):
    assert [s for s in sentences(file.read_text()) if n_words(s) > 25] == []


@every_page
def test_links_lead_somewhere(file):
    for path, anchor in links(file.read_text()):
        target = (file.parent / path).resolve() if path else file
        assert target.exists(), path
        assert ROOT in [target, *target.parents], path
        assert not anchor or anchor in anchors(target.read_text()), f"{path}#{anchor}"


@every_page
def test_nothing_outside_the_repository_is_mentioned(file):
    assert re.findall(r"shared/|\b(?:method|accuracy|solvers|design)\.md|paper\.txt", file.read_text()) == []


@every_page
def test_equations_are_numbered_in_order(file):
    numbers = [int(n) for n in re.findall(r"\\tag\{(\d+)\}", file.read_text())]
    assert numbers == list(range(1, len(numbers) + 1))


def _sources():
    for folder in ("meshing", "massspring", "fem_reference", "analysis", "tests"):
        for pattern in ("*.h", "*.cpp", "*.py"):
            for file in (ROOT / folder).rglob(pattern):
                if file.parent != ROOT / "tests" / "analysis":  # where citations are examples
                    yield file


def test_what_is_cited_is_listed_and_what_is_listed_is_cited():
    listed = {key for file in PAGES for key in references(file.read_text())}
    body = [file.read_text().partition("\n## References\n")[0] for file in PAGES]
    cited = {key for text in [*body, *(file.read_text() for file in _sources())] for key in citations(text)}
    assert len(listed) > 30
    assert cited == listed


@every_page
def test_references_have_a_title_and_all_authors(file):
    for (author, _), text in references(file.read_text()).items():
        key, _, title = text.partition("] ")
        assert title.endswith(".")
        assert ("et al." in key) == (", " in title.partition(":")[0] and author in title), text


def _table(file, head):
    """First cells of the rows of the table whose head begins so."""
    rows = file.read_text().partition(f"\n| {head} |")[2].split("\n\n")[0].splitlines()[2:]
    return [row.split(" | ")[0].strip("| ") for row in rows]


def test_the_readme_repeats_the_results():
    places = (("README.md", "What it finds"), ("analysis/RESULTS.md", "1 Statics at small strain"))
    tables = [tables_of((ROOT / page).read_text(), heading)[0][1] for page, heading in places]
    of_readme, of_results = ({row[0]: row[1:6] for row in rows} for _, rows in tables)
    both = [scene for scene in of_readme if scene in of_results]
    assert len(both) >= 3
    assert [of_readme[scene] for scene in both] == [of_results[scene] for scene in both]


def test_estimates_are_as_near_as_the_readme_says():
    assert (
        "at small strain within a factor two on [bodies drawn at random]" in (ROOT / "README.md").read_text()
    )
    *_, (_, (head, rows)) = tables_of(
        (ROOT / "analysis/RESULTS.md").read_text(), "3 Accuracy of the spring models"
    )
    near = [row[head.index("within two")] for row in rows if row[head.index("asked")] == "estimate"]
    assert len(near) == 2 and all(float(share.rstrip(" %")) >= 95 for share in near)


def test_the_models_are_those_that_are_drawn():
    names = [name.strip("`") for name in _table(ROOT / "massspring" / "README.md", "name")]
    assert names == [name for name in _STYLES if name not in (REFERENCE, FEM_P1, FEM_P2)]


def _keys_of_the_scene():
    (file,) = (ROOT / "meshing").rglob("scene_keys.h")
    return file.read_text()


def test_the_sections_are_those_of_the_scene():
    described = _keys_of_the_scene().partition("Scene& s) {")[2].partition("\n}")[0]
    names = list(dict.fromkeys(re.findall(r'v(?:\.\w+)?\("(\w+)"', described)))  # a check names its key again
    cells = " ".join(_table(ROOT / "meshing" / "README.md", "section"))
    assert re.findall(r"`\[*(\w+)\]*`", cells) == names


@every_page
def test_keys_that_are_named_are_known(file):
    keys = _keys_of_the_scene()
    text = re.sub(r"```python.*?```", "", file.read_text(), flags=re.DOTALL)
    for section, key in re.findall(
        r"\b(surface|material|loads\.\d|supports\.\d|collapse|volume|skin|time|network|reference|comparison|playback|output)"
        r"\.([a-z]\w+)",
        text,
    ):
        if f"{section}.{key}" not in ("output.fields", "comparison.json"):  # a key that is gone, a file
            assert f'"{key}"' in keys, f"{section}.{key}"


def _commands():
    """Of the script, by its usage."""
    usage = (ROOT / "testbed").read_text().partition("<<'HELP'\n")[2].partition("\nHELP\n")[0]
    return {
        name
        for names in re.findall(r"^  \./testbed ([\w|]+)", usage, re.MULTILINE)
        for name in names.split("|")
    }


def test_the_commands_of_the_usage_are_those_that_the_script_knows():
    script = (ROOT / "testbed").read_text().partition("\ncase $command in\n")[2]
    heads = re.findall(r"^  ([a-z][\w |]*)\)$", script, re.MULTILINE)
    assert {name for head in heads for name in head.split(" | ")} == _commands()


@every_page
def test_commands_that_are_named_exist(file):
    named = set(re.findall(r"\./testbed ([a-z]\w*)", file.read_text()))
    gone = {"accuracy"} if file.name == "CHANGELOG.md" else set()
    assert named - _commands() <= gone


def test_the_tests_of_the_guarantees_exist():
    named = set(re.findall(r"`(test_\w+|[A-Z]\w+\.[A-Z]\w+)`", (ROOT / ".github/GUARANTEES.md").read_text()))
    files = [*(ROOT / "tests").rglob("*.cpp"), *(ROOT / "tests").rglob("*.py")]
    text = "\n".join(file.read_text() for file in files)
    there = set(re.findall(r"^def (test_\w+)", text, re.MULTILINE))
    there |= {
        f"{suite}.{name}"
        for suite, name in re.findall(r"^TEST(?:_[FP])?\((\w+), (\w+)\)", text, re.MULTILINE)
    }
    assert len(named) > 30
    assert named <= there, named - there


def test_long_sentences_are_found_and_code_is_not():
    long = "word " * 30 + "word."
    page = f"# Head\n\nShort one. {long}\n\n- {long}\n\n| {long} |\n\n    {long}\n\n```\n{long}\n```\n"
    assert [n_words(s) for s in sentences(page)] == [2, 31, 31]
    assert [n_words(s) for s in sentences("Of `a b c` and $x + y$, see [the page](a.md).")] == [7]


def test_links_and_anchors_are_found():
    page = "# 1 A: head\n\n[a](b.md#1-a-head) ![c](d.png) [e](#f) [g](https://a.org)\n"
    assert links(page) == [("b.md", "1-a-head"), ("d.png", ""), ("", "f")]
    assert anchors(page) == {"1-a-head"}


def test_citations_are_found_over_lines_and_in_company():
    text = """
    // By [Van Oosterom & Strackee 1983], and by others [paper 3.3, Hirota et
    // al. 1999]. [van der Vorst 1992; Smith, de Goes & Kim 2019, 4.2] x[2000]
    """
    assert citations(text) == {
        ("Van Oosterom", "1983"), ("Hirota", "1999"), ("van der Vorst", "1992"), ("Smith", "2019"),
    }  # fmt: skip
    assert references("# A\n\n## References\n\n- [Smith et al. 2019] Smith, Kim: Title.\n") == {
        ("Smith", "2019"): "[Smith et al. 2019] Smith, Kim: Title."
    }
