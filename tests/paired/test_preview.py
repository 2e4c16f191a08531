"""A preview: its steps are those of a batch run, values change on the way, and its window ends cleanly."""

import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "analysis"))
from screen import screen

from analysis.paths import PROGRAMS, ROOT, SCENES
from analysis.runs import RunError, load_run
from massspring.viewer.preview import Engine, Rates, main

BAR = SCENES / "bar_falls.toml"
SHORT = ["time.end=0.02", "surface.n_vertices=60"]


def told(engine, is_so, seconds=30):
    """The first moment of which something holds."""
    until = time.monotonic() + seconds
    while not is_so(engine.latest.head):
        assert time.monotonic() < until, engine.latest.head
        time.sleep(0.01)
    return engine.latest


@pytest.fixture
def engine():
    started = Engine(BAR, SHORT)
    yield started
    started.end()


def test_its_steps_are_those_of_a_batch_run(engine, tmp_path):
    words = [word for value in SHORT for word in ("--set", value)]
    command = [PROGRAMS / "massspring", BAR, *words, "--quiet", "--no-diagnostics", "--out", tmp_path]
    subprocess.run(command, check=True)
    last = load_run(tmp_path).last
    engine.say("run")
    moment = told(engine, lambda head: head["has_ended"])
    assert moment.head["n_steps"] == 5
    np.testing.assert_array_equal(engine.F, last.F)
    np.testing.assert_array_equal(moment.u, last.u.astype(np.float32))  # every bit that is told


def test_it_goes_on_with_other_values_and_begins_again(engine):
    engine.say("step")
    first = told(engine, lambda head: head["n_steps"] == 1)
    assert not first.head["is_running"] and np.abs(first.u).max() > 0
    engine.say("set material.E=2e5")
    told(engine, lambda head: tomllib.loads(head["scene"])["material"]["E"] == 2e5)
    assert engine.latest.head["n_steps"] == 1
    engine.say("reset")
    assert np.abs(told(engine, lambda head: head["n_steps"] == 0).u).max() == 0
    engine.say("step")
    softer = told(engine, lambda head: head["n_steps"] == 1)
    other = Engine(BAR, [*SHORT, "material.E=2e5"])
    other.say("step")
    np.testing.assert_array_equal(softer.u, told(other, lambda head: head["n_steps"] == 1).u)
    other.end()
    assert (softer.u != first.u).any()


@pytest.mark.parametrize(
    "command, message",
    [
        ("set network.calibration=uniform", "network.calibration changes in a run, expected a new run"),
        ("set material.E=-1", "material.E = -1, expected from"),
        ("jump", "unknown command 'jump'"),
    ],
)
def test_what_cannot_be_is_told_and_changes_nothing(engine, command, message):
    engine.say("step")
    before = told(engine, lambda head: head["n_steps"] == 1)
    engine.say(command)
    after = told(engine, lambda head: message in head["message"])
    assert after.head["scene"] == before.head["scene"]
    np.testing.assert_array_equal(after.u, before.u)


def test_a_saved_session_is_one_that_a_batch_run_repeats(engine, tmp_path):
    steps = iter(range(1, 6))

    def step():
        engine.say("step")
        number = next(steps)
        return told(engine, lambda head: head["n_steps"] == number)

    step()
    engine.say("set gravity=[0, -3, 0]")
    engine.say("set handles=[{vertex = 7, stiffness = 50.0, motion = [[0.0, 0.1, 0.2, 0.0]]}]")
    step()
    engine.say("set material.E=2e5")
    step()
    engine.say("set handles=[]")
    step()
    last = step()
    engine.say(f"save {tmp_path / 'session.toml'}")
    told(engine, lambda head: "saved" in head["message"])
    run = tmp_path / "run"
    command = [
        PROGRAMS / "massspring",
        tmp_path / "session.toml",
        "--quiet",
        "--no-diagnostics",
        "--out",
        run,
    ]
    subprocess.run(command, check=True)
    np.testing.assert_array_equal(last.u, load_run(run).last.u.astype(np.float32))  # every bit that is told
    assert load_run(run).curves["work_of_events"][-1] != 0
    saved = tomllib.loads((tmp_path / "session.toml").read_text())
    assert [event["key"] for event in saved["events"]] == ["gravity", "handles", "material.E", "handles"]
    engine.say("reset")
    engine.say(f"save {tmp_path / 'again.toml'}")
    told(engine, lambda head: "again" in head["message"])
    again = tomllib.loads((tmp_path / "again.toml").read_text())
    assert "events" not in again and again["material"]["E"] == 2e5, "a session begins with the values of now"


def memory_of(engine):
    """Resident (kB)."""
    status = Path(f"/proc/{engine._process.pid}/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])


@pytest.mark.parametrize("minutes", [pytest.param(0.1, id="quick"), pytest.param(10, id="soak")])
def test_a_hand_that_never_rests_leaves_memory_flat(minutes, engine):
    engine.say("run")
    angle, kept = 0.0, []
    end = time.monotonic() + 60 * minutes
    while time.monotonic() < end:
        angle += 0.1
        way = f"0.0, {0.3 * np.cos(angle)}, {0.3 * np.sin(angle)}, 0.0"
        engine.say(f"set handles=[{{vertex = 7, stiffness = 50.0, motion = [[{way}]]}}]")
        if engine.latest.head["has_ended"]:
            engine.say("reset")
        time.sleep(0.05)
        kept.append(memory_of(engine))
        assert not engine.latest.head["message"], engine.latest.head
    assert max(kept[-10:]) < 1.1 * max(kept[: len(kept) // 4]), "it grows"


def test_rates_count_the_last_seconds_and_begin_anew():
    rates = Rates()
    assert rates.add(10, 0, 0) == (0, 0)
    assert rates.add(11, 20, 0.5) == (20, 0.5)
    rates.add(12, 100, 1)
    assert rates.add(13, 120, 1.5) == (50, 0.5)  # since 11 s
    assert rates.add(13.5, 0, 0) == (0, 0)


def test_a_scene_that_is_refused_is_told_of_once(capfd):
    with pytest.raises(RunError) as refusal:
        Engine(BAR, ["material.E=-1"])
    assert refusal.value.is_told
    assert capfd.readouterr().err.count("material.E = -1") == 1


def test_without_a_display_a_run_is_offered(monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert main([str(BAR)]) == 1
    assert "no display" in (said := capsys.readouterr().err) and f"./testbed run {BAR} draws a film" in said


SESSION = """
import sys, time
from pathlib import Path
import numpy as np
from massspring.viewer.preview import Preview

preview = Preview(Path(sys.argv[1]), sys.argv[2:])
window = preview.window
window.open()

def press(key):
    interactor = window.plotter.iren.interactor
    interactor.SetKeySym(key)
    interactor.InvokeEvent("KeyPressEvent")

def told(is_so):
    until = time.monotonic() + 60
    while not is_so(preview.engine.latest.head):
        assert time.monotonic() < until, preview.engine.latest.head
        time.sleep(0.01)
    preview.draw(0)

press("Right")
told(lambda head: head["n_steps"] == 1)
slider = preview.sliders["material.E"]
slider.GetRepresentation().SetValue(5.0)
slider.InvokeEvent("EndInteractionEvent")
told(lambda head: preview.scene["material"]["E"] == 1e5)
renderer = window.plotter.renderers[0]
renderer.SetWorldPoint(*preview.skin.mesh.center, 1)
renderer.WorldToDisplay()
window.plotter.iren.interactor.SetEventPosition(*(int(x) for x in renderer.GetDisplayPoint()[:2]))
press("g")
told(lambda head: len(preview.scene.get("handles", [])) == 1)
before = preview.scene["handles"][0]["motion"][0]
preview.handle.SetCenter(np.array(preview.handle.GetCenter()) + [0.1, 0, 0])
preview.handle.InvokeEvent("InteractionEvent")
told(lambda head: abs(preview.scene["handles"][0]["motion"][0][1] - before[1] - 0.1) < 1e-6)
press("g")
told(lambda head: not preview.scene.get("handles"))
press("i")
told(lambda head: preview.scene["time"]["integrator"] == "bdf2")
press("o")
told(lambda head: len(preview.scene.get("obstacles", [])) == 1)
assert "floor" in window.plotter.renderers[0].actors
press("o")
told(lambda head: not preview.scene.get("obstacles"))
press("c")
preview.draw(0)
press("m")
assert preview.scene["network"]["calibration"] == "uniform" and preview.scene["material"]["E"] == 1e5
press("space")
told(lambda head: head["has_ended"])
window.plotter.render()
picture = window.plotter.screenshot(None, return_img=True).astype(int)
assert (np.ptp(picture[:, : picture.shape[1] // 2], axis=2) > 20).any()  # a coloured body
press("q")
window.loop(preview.draw)
preview.engine.end()
assert preview.engine.has_died
print("closed")
"""


def test_a_window_obeys_keys_and_sliders_and_ends():
    with screen() as environment:
        words = [sys.executable, "-c", SESSION, str(BAR), *SHORT]
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "closed\n"), done.stderr
