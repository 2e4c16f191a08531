"""The program that steps a preview, as the window sees it."""

from __future__ import annotations

import functools
import itertools
import json
import subprocess
import threading
import time
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from analysis.paths import PROGRAMS
from analysis.runs import Array, RunError, built

_ASKED = 1 / 40  # s between two pictures that are asked for


class Body(NamedTuple):
    """A body at rest.

    X: (n, 3) nodes in m, first the n_surface of the surface, n_uncut of them as they were before cuts; F: (m, 3) triangles;
    T: (t, 4) tetrahedra, in which springs are coupled; E: (k, 2) edges of these and independent springs.
    """

    is_static: bool
    n_surface: int
    n_uncut: int
    X: Array
    F: Array
    T: Array
    E: Array


class Moment(NamedTuple):
    """What the engine tells of a moment: a body, its head, u (n, 3) in m and v (n, 3) in m/s of all nodes."""

    body: Body
    head: dict[str, Any]
    u: Array
    v: Array


@functools.lru_cache(1)
def _parsed(scene: str) -> dict[str, Any]:
    return tomllib.loads(scene)


class Engine:
    """The program that steps, which is spoken to by a thread of its own: no window waits for it.

    latest: the last moment that it told of.
    """

    def __init__(self, scene: Path, overrides: list[str]) -> None:
        """Raises RunError where the program refuses the scene, which it has told then."""
        words = [str(built(PROGRAMS, "preview")), str(scene)]
        words += [word for value in overrides for word in ("--set", value)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin and self._process.stdout
        self._in, self._out = self._process.stdin, self._process.stdout
        self._lock = threading.Lock()
        self._n_begun = 0
        try:
            self.latest = self._ask()
        except (OSError, ValueError):
            raise RunError(f"{scene}: cannot be previewed", is_told=True) from None
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _read(self, n: int, width: int = 3) -> Array:
        return np.frombuffer(self._out.read(4 * width * n), "<f4").reshape(n, width).astype(float)

    def _read_body(self, head: dict[str, Any]) -> Body:
        X = self._read(head["n_nodes"])
        F = self._read(head["n_triangles"]).astype(int)
        springs = self._read(head["n_springs"], 2).astype(int)
        T = self._read(head["n_tetrahedra"], 4).astype(int)
        edges = [T[:, pair] for pair in itertools.combinations(range(4), 2)]
        E = np.unique(np.sort(np.vstack([springs, *edges]), axis=1), axis=0)
        return Body(head["is_static"], head["n_surface"], head["n_uncut"], X, F, T, E)

    def _ask(self) -> Moment:
        self.say("picture")
        head = json.loads(self._out.readline())
        body = self._read_body(head["body"]) if head["body"] else self.latest.body
        return Moment(body, head, self._read(len(body.X)), self._read(len(body.X)))

    def _listen(self) -> None:
        try:
            while True:
                time.sleep(_ASKED)
                self.latest = self._ask()
        except (OSError, ValueError):  # it has ended
            return

    def say(self, command: str) -> None:
        """Raises OSError or ValueError once the program has ended."""
        with self._lock:
            self._in.write(f"{command}\n".encode())
            self._in.flush()
        self._n_begun += command.startswith("begin ")

    @property
    def is_beginning(self) -> bool:
        """Another body is being set up."""
        return bool(self._n_begun > self.latest.head["n_begun"])

    @property
    def scene(self) -> dict[str, Any]:
        """As it is now, with every default filled in."""
        return _parsed(self.latest.head["scene"])

    @property
    def has_died(self) -> bool:
        return self._process.poll() is not None

    def end(self) -> None:
        """Whatever step is under way."""
        with self._lock:
            self._in.close()
        self._process.wait()
