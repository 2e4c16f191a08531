"""The gallery shows every scene with its command, and says of it what its file says first."""

from argparse import Namespace
from pathlib import Path

from pages import n_words

from analysis.paths import PACKAGE, SCENES, THUMBNAIL
from analysis.studies import gallery
from analysis.studies.gallery import PAGE, sentence_of, write_page

SCENE_FILES = sorted(SCENES.glob("*.toml"))


def test_every_scene_has_a_small_picture_and_its_command():
    text = PAGE.read_text()
    for scene in SCENE_FILES:
        picture = f"figures/gallery/{scene.stem}.jpg"
        assert f"![{scene.stem}]({picture})" in text
        assert 2000 < (PACKAGE / picture).stat().st_size <= 60_000, picture
        assert f"./testbed run analysis/scenes/{scene.name}" in text
    assert text.count("./testbed run") == len(SCENE_FILES)


def test_page_is_what_the_scenes_say_now(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.studies.gallery.PAGE", tmp_path / "page.md")
    write_page(SCENE_FILES)
    assert (tmp_path / "page.md").read_text() == PAGE.read_text()


def test_scenes_run_as_their_commands_say(tmp_path, monkeypatch):
    asked = {}

    def run_solvers(scene, out, surface, overrides, **_):
        asked[scene.name] = overrides
        out.mkdir()
        (out / THUMBNAIL).write_bytes(b"")

    for name, value in {
        "PACKAGE": tmp_path,
        "PAGE": tmp_path / "page.md",
        "run_solvers": run_solvers,
    }.items():
        monkeypatch.setattr(gallery, name, value)
    monkeypatch.setattr(gallery, "results_of", lambda _: None)
    gallery.study(Namespace(quick=False, quiet=True), tmp_path)
    commands = [
        line.split() for line in (tmp_path / "page.md").read_text().splitlines() if "run" in line[:14]
    ]
    told = {Path(words[2]).name: words[4::2] for words in commands}
    assert told == asked and any(asked.values())


def test_a_scene_says_first_what_it_shows(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text("# A bar, 0.4 m long,\n# bends: far. It is soft.\n\n# not this\n")
    assert sentence_of(scene) == "A bar, 0.4 m long, bends: far."
    scene.write_text("# Any body bends:\n#   ./testbed run x\n")
    assert sentence_of(scene) == "Any body bends."
    for file in SCENE_FILES:
        assert 4 < n_words(sentence_of(file)) <= 30
