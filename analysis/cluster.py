"""Runs as tasks of a Dask cluster: of this machine's cores (--workers N), or of machines that share no files (--cluster ADDRESS).

A task carries scene, files and overrides to a worker, whose folder of the run comes back. The engine retries what a worker's
death has ended, and gives tasks by the resources that workers offer:

    run                as many as a worker makes at once; a timed run takes all of them, so that it has the machine alone
    programs HASH      the programs that it has; others are refused
    machine N KIND     what timed runs ask for; one worker of a machine offers it, which makes N runs at once
"""

from __future__ import annotations

import argparse
import asyncio
import fcntl
import hashlib
import json
import logging
import os
import platform
import socket
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from .machine import LOCK, THREADS, kind
from .paths import OUT, PROGRAMS
from .progress import say
from .run_store import Found, Item, LostRunError, RunRequest, Store, files_of, hash_of_programs, made_by
from .runs import RunError
from .turns import lent, taken

_RUN, _PROGRAMS, _MACHINE = "run", "programs", "machine"
_RETRIES = 2  # of a run whose worker has died
_AT_ONCE = 64  # runs asked for beside each other, at least: those that wait cost nothing
_PAUSE = 2.0  # s, between looks at the workers
_THIS_MACHINE = "127.0.0.1"
#: Of the engine. It takes no samples of Python's stack, which waits for programs, and few of its processes, leaves the
#: variables of threads as they are, on which a run depends, and what fails is told by us.
_SETTINGS = {
    "distributed.scheduler.allowed-failures": _RETRIES,
    "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ": {},
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "logging": {"distributed": "critical", "distributed.client": "critical"},
}
_NAMING = (
    "scene.toml",
    "messages.txt",
    "run.json",
    "outcome.json",
)  # files of a run that may name its inputs


@dataclass(frozen=True)
class Task:
    """A run with all that it needs on another machine."""

    key: str  #: of the run, in every store
    request: RunRequest  #: as asked for
    scene: bytes
    files: dict[
        str, tuple[Path, bytes]
    ]  #: place in the scene -> a file's name where it was asked for, and its content
    threads: dict[str, str]  #: variables of the environment
    time_limit: float  #: s
    programs: Path  #: their folder where it was asked for
    programs_hash: str


def task_of(store: Store, request: RunRequest, key: str) -> Task:
    """Raises RunError when a file cannot be read."""
    try:
        files = {place: (file, file.read_bytes()) for place, file in files_of(request).items()}
        scene = request.scene.read_bytes()
    except OSError as error:
        raise RunError(f"{error.filename}: {error.strerror}") from None
    threads = {name: os.environ[name] for name in THREADS if name in os.environ}
    return Task(
        key,
        request,
        scene,
        files,
        threads,
        store.time_limit,
        store.programs,
        hash_of_programs(store.programs),
    )


def _programs_of(task: Task) -> Path:
    """This machine's, or those of who asks where they are here, too."""
    for programs in (PROGRAMS, task.programs):
        with suppress(RunError):  # not built
            if hash_of_programs(programs) == task.programs_hash:
                return programs
    raise RunError(f"{PROGRAMS}: the programs have been built anew, expected {task.programs_hash}")


@lru_cache
def _store(folder: Path, time_limit: float, programs: Path) -> Store:
    """Kept, as a store looks at all its runs when it begins."""
    return Store(folder, time_limit, programs)


def perform(task: Task, folder: Path) -> dict[str, bytes]:
    """The files of a task's run, by name; made in a store of the folder unless that holds it.

    Raises RunError where the programs are others than it was asked for.
    """
    programs = _programs_of(task)
    names: dict[str, str] = {}  # of inputs here -> where they were asked for

    def put(file: Path, data: bytes) -> Path:
        here = folder / "inputs" / hashlib.sha256(data).hexdigest()[:16] / file.name
        if not here.exists():
            here.parent.mkdir(parents=True, exist_ok=True)
            temporary = here.with_name(f"{here.name}.{os.getpid()}-{threading.get_ident()}.tmp")
            temporary.write_bytes(data)
            temporary.replace(here)
        names[str(here)] = str(file)
        return here

    scene = put(task.request.scene, task.scene)
    files = [
        f"{place}={json.dumps(str(put(*file)), ensure_ascii=False)}" for place, file in task.files.items()
    ]
    prefix = ("env", *(f"{name}={value}" for name, value in task.threads.items()), *task.request.prefix)
    here = replace(task.request, scene=scene, overrides=(*task.request.overrides, *files), prefix=prefix)
    run = _store(folder / "runs", task.time_limit, programs).run_as(task.key, here).folder
    found = {str(file.relative_to(run)): file.read_bytes() for file in run.rglob("*") if file.is_file()}
    for name in found.keys() & set(_NAMING):
        for of_worker, asked in names.items():
            found[name] = found[name].replace(of_worker.encode(), asked.encode())
    return found


def _on_worker(task: Task) -> dict[str, bytes]:
    from distributed import get_worker

    return perform(task, Path(get_worker().local_directory).parent)


@contextmanager
def offered(n_runs: int) -> Iterator[dict[str, float]]:
    """Within it, the resources of a worker of so many runs at once. The first of a machine takes timed runs."""
    resources: dict[str, float] = dict.fromkeys([_RUN, f"{_PROGRAMS} {hash_of_programs(PROGRAMS)}"], n_runs)
    with LOCK.open("a") as held:
        with suppress(BlockingIOError):  # another worker or a timed study has the machine
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            resources[f"{_MACHINE} {n_runs} {kind()}"] = n_runs
        yield resources


_until_exit = ExitStack()


async def dask_setup(worker: Any) -> None:
    """Of workers that the engine's own launchers start with --preload analysis.cluster."""
    resources = _until_exit.enter_context(offered(worker.state.nthreads))
    worker.state.total_resources.update(resources)
    worker.state.available_resources.update(resources)


class Cluster:
    """A cluster as an engine of runs."""

    def __init__(self, client: Any) -> None:
        """client: of distributed."""
        self.client, self.programs_hash = client, hash_of_programs(PROGRAMS)
        self._refused: set[str] = set()
        self._has_ended = threading.Event()
        self._of_thread = threading.local()  # number: of the item that it works for

    @property
    def machine(self) -> str:
        return self._whole[1]

    @property
    def address(self) -> str:
        """Of the scheduler."""
        found: str = self.client.scheduler.address
        return found

    def _workers(self) -> dict[str, dict[str, float]]:
        """Address -> resources, of workers with the programs that are wanted."""
        wanted = f"{_PROGRAMS} {self.programs_hash}"
        found = {}
        for address, worker in self.client.scheduler_info(n_workers=-1).get("workers", {}).items():
            offered = worker["resources"]
            other = [name for name in offered if name.startswith(_PROGRAMS) and name != wanted]
            if wanted in offered:
                found[address] = offered
            elif other and address not in self._refused:
                self._refused.add(address)
                say(f"worker {worker['name']} ({address}) is refused: {other[0]}, expected {wanted}", False)
        return found

    @cached_property
    def _whole(self) -> tuple[int, str]:
        """Runs at once and kind of the machines that timed runs are made on, first to last: those that are most."""
        machines = Counter(
            name for offered in self._workers().values() for name in offered if name.startswith(_MACHINE)
        )
        if not machines:
            raise RunError(
                "no worker has its machine alone, expected one for timed runs: another worker or timed study is at work there"
            )
        _, n_runs, machine = machines.most_common(1)[0][0].split(" ", 2)
        return int(n_runs), machine

    def watch(self) -> None:
        """Tells of workers that are refused, and that there is none; until close()."""

        def look(is_waiting: bool) -> None:
            while not self._has_ended.wait(_PAUSE):
                found = self._workers()
                if is_waiting and found:
                    say(f"worker {next(iter(found))} has come", False)
                    is_waiting = False

        is_waiting = not self._workers()
        if is_waiting:
            say(f"waiting for a worker: ./testbed worker {self.address}", False)
        threading.Thread(target=look, args=(is_waiting,), daemon=True).start()

    def close(self) -> None:
        self._has_ended.set()

    def make(self, store: Store, request: RunRequest, key: str, folder: Path) -> None:
        if store.programs != PROGRAMS:  # of another commit, which are here alone
            store.fill(request, folder)
            return
        from distributed import KilledWorker

        needed = {_RUN: 1, f"{_PROGRAMS} {self.programs_hash}": 1}
        if request.is_timed:
            n_runs, machine = self._whole
            needed = dict.fromkeys([*needed, f"{_MACHINE} {n_runs} {machine}"], n_runs)
        task = task_of(store, request, key)
        name = f"{request.program}-{key}-{store.time_limit:g}"
        # What was begun first is finished first, so that it is kept and told of.
        urgency = -getattr(self._of_thread, "number", 0)
        future = self.client.submit(
            _on_worker, task, key=name, resources=needed, retries=_RETRIES, priority=urgency
        )
        try:
            files = future.result()
        except KilledWorker:
            raise LostRunError(
                f"{request.program}: its worker died {_RETRIES + 1} times: run {key}"
            ) from None
        finally:
            future.release()
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)

    def each(self, function: Callable[[Item], Found], items: Iterable[Item]) -> Iterator[Found]:
        n_runs = sum(int(offered[_RUN]) for offered in self._workers().values())
        pool = ThreadPoolExecutor(max(_AT_ONCE, 2 * n_runs))

        def in_turn(numbered: tuple[int, Item]) -> Found:
            self._of_thread.number, item = numbered
            with taken():
                return function(item)

        try:
            with taken():
                found = pool.map(in_turn, enumerate(items))
                while True:
                    with lent():
                        of_one = list(islice(found, 1))
                    if not of_one:
                        return
                    yield from of_one
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("address", metavar="ADDRESS", help="of the scheduler, as tcp://192.168.0.1:8786")
    parser.add_argument(
        "--cores",
        type=whole_number,
        default=os.cpu_count(),
        metavar="N",
        help="runs at once; default: %(default)s, all cores",
    )
    parser.add_argument(
        "--out", type=Path, default=OUT / "worker", metavar="DIR",
        help="where inputs and finished runs are kept; default: out/worker",
    )  # fmt: skip
    parser.add_argument(
        "--name",
        default=f"{platform.node()}-{os.getpid()}",
        help="by which it is told from others; default: %(default)s",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of commands that make many runs."""
    parser.add_argument(
        "--workers",
        type=whole_number,
        default=1,
        metavar="N",
        help="runs at once on this machine; default: %(default)s",
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="of a Dask scheduler whose workers make the runs: analysis/CLUSTER.md",
    )
    parser.add_argument(
        "--listen", metavar="HOST", default=_THIS_MACHINE,
        help="with --workers: where workers of other machines may join; default: this machine alone",
    )  # fmt: skip


def whole_number(text: str) -> int:
    """Of a command line. Raises argparse.ArgumentTypeError for what is no number from 1."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number from 1")
    return int(text)


@contextmanager
def scratch() -> Iterator[str]:
    """A temporary folder. Programs remove what killed ones have left: folders of this prefix that nobody has locked."""
    with tempfile.TemporaryDirectory(prefix="testbed-") as name:
        held = os.open(name, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX)
        try:
            yield name
        finally:
            os.close(held)


@contextmanager
def engine_of(arguments: argparse.Namespace) -> Iterator[Cluster | None]:
    """Within it, runs are made as a command's options say: by a cluster, or by this process.

    Raises RunError where there is no cluster at the address.
    """
    if arguments.workers == 1 and not arguments.cluster:
        yield None
        return
    if arguments.workers > 1 and arguments.cluster:
        raise RunError("--workers and --cluster, expected one of them")
    distributed = _engine()
    with ExitStack() as stack:
        address = arguments.cluster
        if not address:
            address = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=1, threads_per_worker=arguments.workers, memory_limit=0, host=arguments.listen,
                    dashboard_address=f"{arguments.listen}:0", silence_logs=logging.CRITICAL,
                    local_directory=stack.enter_context(scratch()),
                    resources=stack.enter_context(offered(arguments.workers)),
                )
            )  # fmt: skip
        try:
            client = stack.enter_context(distributed.Client(address, timeout=10))
        except (OSError, ValueError) as error:
            raise RunError(f"--cluster {address}: {error}") from None
        cluster = Cluster(client)
        say(
            f"cluster {cluster.address}, its dashboard {client.dashboard_link}; "
            f"to add a machine: ./testbed worker {cluster.address}",
            arguments.quiet,
        )
        if not arguments.cluster and arguments.listen != _THIS_MACHINE:
            say(
                f"whoever reaches {arguments.listen} can run anything as you; TLS: analysis/CLUSTER.md, 'Who may connect'",
                arguments.quiet,
            )
        stack.callback(cluster.close)
        cluster.watch()
        with made_by(cluster):
            yield cluster


def _engine() -> Any:
    """The module distributed, set up for runs of programs. Raises RunError where it is not installed."""
    try:
        import dask

        dask.config.set(_SETTINGS)
        import distributed
    except ImportError as error:
        raise RunError(f"{error}; ./testbed installs what --workers and --cluster need") from None
    return distributed


def _host_towards(host: str, port: int) -> str:
    """This machine's address for those at another one: a worker listens there, and nowhere else. Raises OSError."""
    (family, kind, _, _, place), *_ = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    with socket.socket(family, kind) as probe:
        probe.connect(place)  # nothing is sent
        found: str = probe.getsockname()[0]
        return found


def serve(arguments: argparse.Namespace) -> int:
    """./testbed worker"""
    distributed = _engine()

    async def work(resources: dict[str, float]) -> None:
        host = _host_towards(*distributed.comm.get_address_host_port(arguments.address))
        async with distributed.Worker(
            arguments.address, name=arguments.name, nthreads=arguments.cores, resources=resources, memory_limit=0,
            host=host, dashboard=False, dashboard_address=f"{host}:0", local_directory=str(arguments.out),
        ) as worker:  # fmt: skip
            print(
                f"worker {arguments.name}: {arguments.cores} runs at once for {arguments.address}", flush=True
            )
            await worker.finished()

    with offered(arguments.cores) as resources:
        try:
            asyncio.run(work(resources))
        except (OSError, ValueError) as error:
            raise RunError(f"{arguments.address}: {error}, expected the address of a scheduler") from None
    return 0
