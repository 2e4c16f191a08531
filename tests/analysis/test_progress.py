"""What is told of work while it goes on."""

import io
import sys
import time
from types import SimpleNamespace

import pytest

from analysis import progress
from analysis.progress import Progress, reminders, say, tell_made


def test_progress_stands_on_stderr(capsys):
    say("half way", is_quiet=False)
    say("nothing", is_quiet=True)
    assert capsys.readouterr() == ("", "half way\n")


@pytest.fixture
def clock(monkeypatch):
    """The time (s) that progress sees."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setitem(progress._last, "made", -1.0)
    return clock


def test_time_left_follows_the_pace_of_the_last(clock, capsys):
    told = Progress(31, is_quiet=False)
    for number, clock.now in enumerate([1.0, 3.0, *(3.0 + 10 * n for n in range(1, 29))]):
        tell_made()
        told.say(str(number))
    said = capsys.readouterr().err.splitlines()
    assert said[:2] == ["[1/31, 30 s left] 0", "[2/31, 40 s left] 1"]
    assert said[-1] == "[30/31, 10 s left] 29"


def test_time_left_does_not_count_on_what_was_kept(clock, capsys):
    told = Progress(40, is_quiet=False)
    for clock.now in (1.0, 2.0, 3.0):
        told.say("kept")
    clock.now = 33.0
    tell_made()
    told.say("made")
    assert capsys.readouterr().err == "[1/40] kept\n[2/40] kept\n[3/40] kept\n[4/40, 18 min left] made\n"


def wait_for(stream, text):
    deadline = time.monotonic() + 60
    while text not in stream.getvalue() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert text in stream.getvalue()


def test_who_waits_is_told_again_what_is_at_work(monkeypatch):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with reminders("study", is_quiet=False, pause=0.02):
        wait_for(sys.stderr, "study: 0 s\nstudy: 0 s\n")
        say("half way", is_quiet=False)
        wait_for(sys.stderr, "half way\nhalf way: 0 s\n")
    monkeypatch.setattr("sys.stderr", io.StringIO())
    time.sleep(0.1)
    with reminders("study", is_quiet=True, pause=0.02):
        time.sleep(0.1)
    assert sys.stderr.getvalue() == ""
