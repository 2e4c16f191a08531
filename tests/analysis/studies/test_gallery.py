"""The gallery shows every scene with its command, and says of it what its file says first."""

from pages import n_words

from analysis.paths import PACKAGE, SCENES
from analysis.studies.gallery import PAGE, sentence_of, write_page

SCENE_FILES = sorted(SCENES.glob("*.toml"))


def test_every_scene_has_a_small_picture_and_its_command():
    text = PAGE.read_text()
    for scene in SCENE_FILES:
        picture = f"figures/gallery/{scene.stem}.jpg"
        assert f"![{scene.stem}]({picture})" in text
        assert 2000 < (PACKAGE / picture).stat().st_size <= 60_000, picture
        assert f"./testbed run analysis/scenes/{scene.name}\n" in text
    assert text.count("./testbed run") == len(SCENE_FILES)


def test_page_is_what_the_scenes_say_now(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.studies.gallery.PAGE", tmp_path / "page.md")
    write_page(SCENE_FILES)
    assert (tmp_path / "page.md").read_text() == PAGE.read_text()


def test_a_scene_says_first_what_it_shows(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text("# A bar, 0.4 m long,\n# bends: far. It is soft.\n\n# not this\n")
    assert sentence_of(scene) == "A bar, 0.4 m long, bends: far."
    scene.write_text("# Any body bends:\n#   ./testbed run x\n")
    assert sentence_of(scene) == "Any body bends."
    for file in SCENE_FILES:
        assert 4 < n_words(sentence_of(file)) <= 30
