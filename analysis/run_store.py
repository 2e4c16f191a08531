"""Runs of the solvers for sweeps and studies, each made once and kept in a folder named by all that it depends on."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import threading
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

from . import load_scale
from .execute import execute, solver
from .folder_lock import locked
from .machine import THREADS, kind
from .outputs import are_as_written
from .paths import PROGRAMS, write_text
from .progress import tell_made
from .runs import NOT_OK, SOLVED, RunError, built, read_toml, record_of
from .turns import lent

# Top-level keys of a scene that change nothing in a program's result, as in its own input hash.
_IGNORED = {
    "fem_reference": {"name", "network", "comparison", "playback"},
    "massspring": {"name", "reference", "comparison", "playback"},
}
_SURFACE = "surface.file"
_MESHERS = ("gmsh_worker", "tetgen_worker")
_READER = "vtk_worker"
_MARK = f".part-{platform.node()}-"  # of a folder that a process works on; its number follows
_guards: dict[str, threading.Lock] = defaultdict(
    threading.Lock
)  # of runs: threads wait for each other without a word

Item = TypeVar("Item")
Found = TypeVar("Found")


@dataclass(frozen=True)
class RunRequest:
    """One run of one program, as it is asked for."""

    program: str  #: fem_reference or massspring
    scene: Path
    overrides: tuple[str, ...] = ()  #: KEY=VALUE, as --set takes them
    options: tuple[str, ...] = ()  #: further words of the command line
    prefix: tuple[str, ...] = ()  #: a command that runs the program, such as valgrind
    repetition: int = 0  #: of a timed run; only the first keeps its frames
    is_timed: bool = False  #: its seconds count: no other run shares its machine, and only those of one kind of machine are taken
    is_of_pair: bool = False  #: every key of the scene counts, as the folder of a pair is read for them

    @cached_property
    def values(self) -> dict[str, Any]:
        """Of the scene, as it was when they were first asked for. Raises RunError when it cannot be read."""
        return read_toml(self.scene)


@dataclass(frozen=True)
class Outcome:
    """What a run gave. A run that fails is a result too: status and message say how."""

    status: str  #: "ok", the program's own word ("diverged", ...), "failed" or "time limit"
    message: str
    wall: float  #: s, of the whole process
    cpu: float  #: s
    load: float  #: load average of the machine as the run began
    folder: Path = Path()
    record: dict[str, Any] = field(default_factory=dict)  #: run.json


class LostRunError(RunError):
    """A run whose makers have all died: it is no result, and is made again where it is asked for again."""


class Engine(Protocol):
    """Makes runs. What has been made is the store's."""

    @property
    def machine(self) -> str:
        """Kind of machine that timed runs are made on. Raises RunError where there is none."""

    def make(self, store: Store, request: RunRequest, key: str, folder: Path) -> None:
        """Makes a run and writes all its files and outcome.json into a folder. Raises LostRunError."""

    def each(self, function: Callable[[Item], Found], items: Iterable[Item]) -> Iterator[Found]:
        """A function of each item, in their order; as many at a time as the engine has use for."""


class Here:
    """One run after the other, by this process."""

    machine = kind()

    def make(self, store: Store, request: RunRequest, key: str, folder: Path) -> None:  # noqa: ARG002
        store.fill(request, folder)

    def each(self, function: Callable[[Item], Found], items: Iterable[Item]) -> Iterator[Found]:
        return map(function, items)


_engine: Engine = Here()


@contextmanager
def made_by(engine: Engine) -> Iterator[None]:
    """Within it, an engine makes the runs of every store."""
    global _engine
    before, _engine = _engine, engine
    try:
        yield
    finally:
        _engine = before


def each(function: Callable[[Item], Found], items: Iterable[Item]) -> Iterator[Found]:
    """A function of each item, in their order; runs that it asks of a store are made beside those of other items."""
    return _engine.each(function, items)


def is_of_one_machine() -> bool:
    """Whether runs are made by this process."""
    return isinstance(_engine, Here)


class Store:
    """A folder of runs. Several processes may work on one store, and any may be killed: a run's folder appears
    under its name only when it is whole. Who asks for a run that another process is making waits and takes it."""

    def __init__(self, folder: Path, time_limit: float = 3600, programs: Path = PROGRAMS) -> None:
        self.folder, self.time_limit, self.programs = folder, time_limit, programs
        folder.mkdir(parents=True, exist_ok=True)
        for part in folder.glob(f"*{_MARK}*"):  # left by a killed process of this machine
            if not Path("/proc", part.name.rsplit("-", 1)[1]).exists():
                shutil.rmtree(part, ignore_errors=True)

    def key(self, request: RunRequest) -> str:
        """Hash of programs, threads, scene, its files and overrides that the run's result depends on. A surface counts by
        its name and content wherever it lies, but for a pair, whose folder tells it.

        Raises RunError when the scene or a program cannot be read.
        """
        ignored = set() if request.is_of_pair else {*_IGNORED[request.program], _SURFACE}
        settings = _settings_of(request)
        parts = [
            _without(request.values, ignored),
            {key: value for key, value in settings.items() if not {key, key.split(".")[0]} & ignored},
            request.program,
            request.options,
            request.prefix,
            request.repetition,
            [_hash_of_file(built(self.programs, name)) for name in (request.program, *_MESHERS)],
            # Programs of earlier commits have none.
            _hash_of_file(worker) if (worker := self.programs / _READER).exists() else "",
            [os.environ.get(name, "") for name in THREADS],
            {place: (file.name, _hash_of_file(file)) for place, file in files_of(request).items()},
            *([_engine.machine] if request.is_timed else []),
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]

    def law_of(self, scene: Path) -> str:
        """Of both programs, as the springs' tells it. Raises RunError where it refuses the scene."""
        ended = execute(solver(built(self.programs, "massspring"), scene, self.folder, options=("--check",)))
        if ended.status != SOLVED:
            raise RunError(ended.errors or f"massspring refuses {scene}")
        law: str = json.loads(ended.output)["law"]
        return law

    def find(self, request: RunRequest) -> Outcome | None:
        """The run's outcome if it has been run, its files are there as they were written, and it was not stopped by a time
        limit shorter than this one."""
        request = self._loaded(request)
        return self._known(self.folder / self.key(request), request)

    def _known(self, folder: Path, request: RunRequest) -> Outcome | None:
        try:
            outcome = Outcome(**json.loads((folder / "outcome.json").read_text()), folder=folder)
            has_record = outcome.status not in ("failed", "time limit")
            record = record_of(folder) if has_record else {}
        except (OSError, ValueError, TypeError, RunError):  # none, or a damaged one
            return None
        if outcome.status == "time limit" and outcome.wall < self.time_limit:
            return None
        listed = record.get("outputs", {})
        kept = {
            name: stamp
            for name, stamp in listed.items()
            if not (request.repetition and name.startswith("frames/"))
        }
        return replace(outcome, record=record) if are_as_written(folder, kept) else None

    def run(self, request: RunRequest) -> Outcome:
        """The run's outcome, running it now if that has not been done."""
        request = self._loaded(request)
        # Of the programs as they are now, which may be built anew meanwhile.
        return self.run_as(self.key(request), request)

    def run_as(self, key: str, request: RunRequest) -> Outcome:
        """The outcome of a run whose key is known, running it now if that has not been done."""
        folder = self.folder / key
        if known := self._known(folder, request):
            return known
        with lent(), _guards[str(folder)], locked(self.folder, f".{key}.lock"):
            return self._known(folder, request) or self._made(folder, request)

    def _made(self, folder: Path, request: RunRequest) -> Outcome:
        part = folder.with_name(f"{folder.name}{_MARK}{os.getpid()}")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        shutil.rmtree(folder, ignore_errors=True)  # of a shorter time limit, or damaged
        try:
            _engine.make(self, request, folder.name, part)
        except LostRunError as error:
            return Outcome("failed", str(error), 0, 0, 0)
        part.rename(folder)
        tell_made()
        found = self._known(folder, request)
        assert found
        return found

    def fill(self, request: RunRequest, folder: Path) -> None:
        """Makes a run by this process, with all its files and outcome.json in a folder."""
        outcome = self._execute(request, folder)
        if request.repetition:
            shutil.rmtree(folder / "frames", ignore_errors=True)
        values = asdict(outcome)
        del values["folder"], values["record"]
        write_text(folder / "outcome.json", json.dumps(values))

    def _loaded(self, request: RunRequest) -> RunRequest:
        """The request with the factor on its loads by which it strains as its scene wants, found by a trial."""
        wanted = load_scale.wanted_strain(request.values, request.overrides)
        if wanted is None:
            return request

        def trial(words: tuple[str, ...]) -> tuple[str, Path]:
            found = self.run(
                RunRequest("massspring", request.scene, (*request.overrides, *words), load_scale.OPTIONS)
            )
            return found.status, found.folder

        factor = load_scale.factor_override(wanted, trial)
        return replace(request, overrides=(*request.overrides, factor)) if factor else request

    def _execute(self, request: RunRequest, folder: Path) -> Outcome:
        command = solver(
            self.programs / request.program, request.scene, folder, request.overrides, request.options
        )
        ended = execute([*request.prefix, *command], limit=self.time_limit)
        (folder / "messages.txt").write_text(ended.output + ended.said)
        spent: dict[str, Any] = {"wall": ended.wall, "cpu": ended.cpu, "load": ended.load}
        if ended.is_late:
            return Outcome("time limit", f"stopped after {self.time_limit:g} s", **spent)
        if ended.status not in (SOLVED, NOT_OK):
            said = ended.errors or (ended.output + ended.said).strip() or f"exit status {ended.status}"
            return Outcome("failed", said.splitlines()[-1], **spent)
        record = record_of(folder)
        return Outcome(record["status"], record.get("reason", ""), **spent)


def files_of(request: RunRequest) -> dict[str, Path]:
    """Place in the scene -> file, of all that a run reads. Raises RunError when the scene cannot be read."""
    files = dict(_files_in(request.values, "", request.scene.parent))
    for key, text in _settings_of(request).items():
        files = {place: file for place, file in files.items() if not f"{place}.".startswith(f"{key}.")}
        files |= dict(_files_in(value_of(text), key, Path()))
    return files


def _without(value: Any, ignored: set[str], within: str = "") -> Any:
    """A value of a scene without the keys that are ignored."""
    if not isinstance(value, dict):
        return value
    kept = {key: part for key, part in value.items() if within + key not in ignored}
    return {key: _without(part, ignored, f"{within}{key}.") for key, part in kept.items()}


def _settings_of(request: RunRequest) -> dict[str, str]:
    return dict(override.partition("=")[::2] for override in request.overrides)


def hash_of_programs(programs: Path) -> str:
    """Of all that a run's result depends on, of either program. Raises RunError where one is not there."""
    hashes = [_hash_of_file(built(programs, name)) for name in (*_IGNORED, *_MESHERS)]
    return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]


def value_of(text: str) -> Any:
    """The value that --set KEY=TEXT gives: TOML, or the text itself where it is none."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _files_in(value: Any, place: str, folder: Path) -> Iterator[tuple[str, Path]]:
    """Place and path of every file that a value of a scene names: the surface, and meshes of obstacles."""
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _files_in(part, f"{place}.{key}" if place else str(key), folder)
    elif value and place.endswith(".file"):
        yield place, folder / value


def _hash_of_file(file: Path) -> str:
    try:
        state = file.stat()
        return _hash_of_version(file, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise RunError(f"{file}: {error.strerror}") from None


@lru_cache
def _hash_of_version(file: Path, _time: int, _size: int) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
