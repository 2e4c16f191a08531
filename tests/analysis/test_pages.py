"""The check of pages finds what it is there to find."""

import base64
import re
import shutil
import subprocess

import pytest
from pages import fetched

from analysis.report import page

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
