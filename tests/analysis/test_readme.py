"""What the pages show works: the README's lines run, pictures and scenes are there."""

import re

from pages import PAGES
from synthetic import write_run

import analysis
from analysis.paths import ROOT
from analysis.reproduce import tables_of

README = (ROOT / "README.md").read_text()
PYTHON = (ROOT / "analysis" / "PYTHON.md").read_text()


def test_notebook_lines_run(ball, tmp_path):
    write_run(tmp_path / "massspring" / "node_averaged", *ball, lambda X: -0.012 * X)
    write_run(tmp_path / "fem_reference", *ball, lambda X: -0.01 * X)
    code = re.findall(r"```python\n(.*?)```", PYTHON, re.DOTALL)[-1]
    names = {}
    exec(code.replace("out/ball_pressure", str(tmp_path)), names)
    assert names["displacement_error"] is analysis.displacement_error
    assert len(names["reference"].last.u) == len(ball[0])


def test_everything_exported_is_there_and_documented():
    for name in analysis.__all__:
        assert getattr(analysis, name).__doc__, name


def test_pictures_are_there_and_small():
    pictures = [
        page.parent / picture
        for page in PAGES
        for picture in re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text())
    ]
    assert len(pictures) > 5
    most = {".webp": 1_500_000}  # of a film
    assert all(0 < picture.stat().st_size < most.get(picture.suffix, 300_000) for picture in pictures)


def test_scenes_are_there():
    text = "".join(page.read_text() for page in PAGES)
    names = set(re.findall(r"\b(\w+\.toml)\b", text)) - {
        "scene.toml",
        "manifest.toml",
        "pyproject.toml",
        "ruff.toml",
        "SCENE.toml",
    }
    assert len(names) > 10
    assert all((ROOT / "analysis" / "scenes" / name).exists() for name in names)


def test_every_scene_is_in_the_readme():
    scenes = {scene.name for scene in (ROOT / "analysis" / "scenes").glob("*.toml")}
    assert scenes <= set(re.findall(r"`(\w+\.toml)`", README))


def test_words_of_a_first_time_reader_are_explained_in_the_readme():
    words, rest = README.partition("## Words\n")[2].split("\n## ")[0], README.partition("## Words\n")[0]
    named = re.findall(r"\*([A-Za-z 0-9]+)\*", words) + re.findall(r"`(\w+)`", words)
    for word in ("calibration", "patch", "floppy motion", "refined reference", "cut", "level", "frame budget", "planted fault",
                 "figure 11", "node_averaged", "edge_coupled", "affine", "uniform"):  # fmt: skip
        assert word in [name.lower() for name in named], word
    assert (
        "*projective cascading\npropagation* (PCP) links" in rest
        and "title and authors are not known" in rest
    )
    assert "sqrt(sum a |u - v|^2 / sum a |v|^2)" in rest and "*At worst* is the largest |u - v|" in rest
    assert len(README.splitlines()) <= 150


def test_the_sentence_on_seconds_counts_what_its_table_does():
    text = README
    head, rows = tables_of(text, "What it finds")[1][1]
    sums = [
        sum(int(row[head.index(name)]) for row in rows)
        for name in ("comparisons", "springs lose", "springs win")
    ]
    said = re.search(r"Of (\d+) comparisons .*, they lose (\d+) and win (\d+)", " ".join(text.split()))
    assert [int(number) for number in said.groups()] == sums


def test_the_sentences_on_random_bodies_have_the_medians_of_their_page():
    text = " ".join(README.split())
    page = (ROOT / "analysis" / "ACCURACY.md").read_text()
    (left,) = re.findall(r"ACCURACY.md\) ([\d.]+) of linear elements' error is left in the median", text)
    assert f"in the median: {left} at nu = 0.25" in page
    (free,) = re.findall(r"they have ([\d.]+) of the error of `node_averaged`, in the median", text)
    (held,) = re.findall(r"Where supports hold a body they have ([\d.]+) times its error\.", text)
    assert f"in the median: {free} under free loads, {held} where supports hold the body." in page


def test_the_sentence_on_large_strain_has_the_figures_of_its_run():
    """Those of the default pair, as comparison tables of large strain have them."""
    text = " ".join(README.split())
    (off,) = re.findall(
        r"`torus_inflates.toml` blows a torus up, where `node_averaged` is off by ([\d.]+ %)", text
    )
    head, rows = tables_of((ROOT / "analysis" / "RESULTS.md").read_text(), "4 Large strain")[0][1]
    (row,) = (row for row in rows if row[0].startswith("torus_inflates.toml"))
    assert row[head.index("node_averaged")] == off
