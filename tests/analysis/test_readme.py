"""What the README shows works: its notebook lines run, its pictures and scenes are there."""

import re

from synthetic import write_run

import analysis
from analysis.paths import ROOT

README = (ROOT / "README.md").read_text()


def test_notebook_lines_run(ball, tmp_path):
    write_run(tmp_path / "massspring" / "node_averaged", *ball, lambda X: -0.012 * X)
    write_run(tmp_path / "fem_reference", *ball, lambda X: -0.01 * X)
    code = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
    names = {}
    exec(code.replace("out/ball_pressure", str(tmp_path)), names)
    assert names["displacement_error"] is analysis.displacement_error
    assert len(names["reference"].last.u) == len(ball[0])


def test_everything_exported_is_there_and_documented():
    for name in analysis.__all__:
        assert getattr(analysis, name).__doc__, name


def test_pictures_are_there_and_small():
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", README)
    assert pictures
    assert all(0 < (ROOT / picture).stat().st_size < 300_000 for picture in pictures)


def test_scenes_are_there():
    names = set(re.findall(r"`(\w+\.toml)`", README)) - {"scene.toml"}
    assert names
    assert all((ROOT / "analysis" / "scenes" / name).exists() for name in names)
