"""What is told of work while it goes on, on stderr: what is done, how long the rest will take, and that it goes on."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .wording import duration

_PAUSE = 10.0  # s, without a word at most
_last: dict[str, Any] = {
    "text": "",
    "said": 0.0,
    "shown": 0.0,
    "made": -math.inf,
}  # what was said last, and when (s) it was said, it was repeated, and a run was made


def say(text: str, is_quiet: bool) -> None:
    """Progress, on stderr."""
    if not is_quiet:
        now = time.monotonic()
        _last.update(text=text, said=now, shown=now)
        print(text, file=sys.stderr, flush=True)


def tell_made() -> None:
    """That a run has been made now, while others may have been kept."""
    _last["made"] = time.monotonic()


class Progress:
    """Tells what is done of so many things, and how long the others will take by the pace of the last ones.

    The pace is that since runs are made: what is kept takes no time.
    """

    def __init__(self, n: int, is_quiet: bool) -> None:
        self.n, self.is_quiet, self.n_done = n, is_quiet, 0
        self._times = deque([time.monotonic()], maxlen=20)

    def say(self, text: str) -> None:
        """Of one more that is done."""
        self.n_done += 1
        if _last["made"] < self._times[0]:
            self._times.clear()
        self._times.append(time.monotonic())
        left = ""
        if self.n_done < self.n and len(self._times) > 1:
            pace = (self._times[-1] - self._times[0]) / (len(self._times) - 1)
            left = f", {duration(pace * (self.n - self.n_done))} left"
        say(f"[{self.n_done}/{self.n}{left}] {text}", self.is_quiet)


@contextmanager
def reminders(text: str, is_quiet: bool, pause: float = _PAUSE) -> Iterator[None]:
    """Within it, what was said last is repeated whenever nothing has been said for so long (s), with the seconds since.

    text: what is repeated until something is said.
    """
    has_ended = threading.Event()
    now = time.monotonic()
    _last.update(text=text, said=now, shown=now)

    def remind() -> None:
        while not has_ended.wait(max(0.0, _last["shown"] + pause - time.monotonic())):
            now = time.monotonic()
            if now >= _last["shown"] + pause:
                _last["shown"] = now
                print(f"{_last['text']}: {now - _last['said']:.0f} s", file=sys.stderr, flush=True)

    thread = threading.Thread(target=remind, daemon=True)
    if not is_quiet:
        thread.start()
    try:
        yield
    finally:
        has_ended.set()
