"""Turns of a study's threads: one works while the others wait for runs. VTK and files that they share bear no two at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

_turn, _of_thread = threading.Lock(), threading.local()


def _is_held() -> bool:
    return getattr(_of_thread, "is_held", False)


@contextmanager
def taken() -> Iterator[None]:
    """Within it this thread has the turn, which it keeps if it had it before."""
    if _is_held():
        yield
        return
    with _turn:
        _of_thread.is_held = True
        try:
            yield
        finally:
            _of_thread.is_held = False


@contextmanager
def lent() -> Iterator[None]:
    """Within it others work, while this thread waits."""
    if not _is_held():
        yield
        return
    _of_thread.is_held = False
    _turn.release()
    try:
        yield
    finally:
        _turn.acquire()
        _of_thread.is_held = True
