"""The index page lists every run of the output folder, and no more."""

import json
import os
import re

from pages import fetched
from PIL import Image

from analysis.index import write_index


def make_run(folder, finding, written, conclusion=("Use a < b here.", "It saves 4 s.")):
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("")
    file = folder / "comparison.json"
    file.write_text(json.dumps({"finding": finding, "conclusion": conclusion} if finding else {}))
    os.utime(file, (written, written))
    return folder


def test_index_lists_every_run_with_its_verdict_and_finding_the_newest_first(tmp_path):
    make_run(tmp_path / "bar", "bar: 3 < 4", 1)
    ball = make_run(tmp_path / "ball", "ball: fine", 3, ["No model is shown to serve here."])
    make_run(tmp_path / "sweeps" / "one", "one of many", 2)
    Image.new("RGB", (40, 20)).save(ball / "thumbnail.jpg")
    page = write_index(tmp_path).read_text()
    assert re.findall("<b>([a-z/]*)</b>", page) == ["ball", "sweeps/one", "bar"]
    assert re.findall('<a href="([^"]*)"><b>', page) == [
        f"{n}/report.html" for n in ("ball", "sweeps/one", "bar")
    ]
    assert "bar: 3 &lt; 4" in page and "3 runs, the newest first" in page
    assert page.count("<b>Use a &lt; b here.</b>") == page.count(" It saves 4 s.</p>") == 2
    assert (
        "<b>No model is shown to serve here.</b></p>" in page.split("<b>ball</b>")[1].split("</article>")[0]
    )
    assert fetched(page) == ["ball/thumbnail.jpg"]
    assert len(page) < 5000
    assert not list(tmp_path.glob("*.tmp"))


def test_index_leaves_out_what_is_half_written_or_older_than_findings(tmp_path):
    make_run(tmp_path / "old", None, 1)
    (make_run(tmp_path / "torn", "x", 1) / "comparison.json").write_text('{"find')
    (make_run(tmp_path / "without", "x", 1) / "report.html").unlink()
    page = write_index(tmp_path).read_text()
    assert "<article>" not in page and "0 runs" in page
