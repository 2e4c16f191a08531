"""Runs on a cluster of this machine: the same table as one run after the other, whatever dies, is foreign or is timed."""

import fcntl
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections import Counter
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from solvers import calls, make_solvers, wait_for_calls

from analysis import cluster as module
from analysis.__main__ import parse_arguments
from analysis.cluster import engine_of, offered, perform, scratch, task_of
from analysis.grid import parse_grid, settings_of, sweep
from analysis.machine import THREADS
from analysis.paths import PROGRAMS, ROOT
from analysis.run_store import Here, RunRequest, Store, each, hash_of_programs, made_by
from analysis.runs import RunError
from analysis.studies import cluster as study

pytest.importorskip("distributed")

GRID = {"material.nu": ["0.25", "0.3", "0.6", "diverge"], "network.multiplicity": ["3", "5"]}
_DEADLY = 'case "$*" in *deadly=*) sleep 0.3; kill -9 $PPID; sleep 60;; esac\n'
_WORKER = """
import sys
from pathlib import Path
from analysis import cluster, machine
cluster.PROGRAMS, cluster.OUT, cluster.LOCK = (Path(word) for word in sys.argv[2:5])
from analysis.__main__ import main
sys.argv[1:] = ["worker", sys.argv[1], "--name", sys.argv[5], "--cores", "1"]
sys.exit(main())
"""


@pytest.fixture(scope="module")
def home(ball, tmp_path_factory):
    return tmp_path_factory.mktemp("cluster")


@pytest.fixture(scope="module")
def programs(ball, home):
    """Stand-ins; springs with deadly=N kill what started them."""
    made = make_solvers(home / "solvers", ball, seconds=0.1)
    (made / "massspring").rename(made.parent / "massspring")
    (made / "massspring").write_text(f'#!/bin/sh\n{_DEADLY}exec {made.parent / "massspring"} "$@"\n')
    (made / "massspring").chmod(0o755)
    return made


@pytest.fixture(scope="module")
def scene(home):
    file = home / "scene.toml"
    file.write_text('name = "synthetic"\n')
    return file


@pytest.fixture(scope="module")
def cluster(programs, home):
    """Of two runs at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LOCK", home / "lock")
        patch.setattr(module, "PROGRAMS", programs)
        with engine_of(Namespace(workers=2, cluster=None, listen="127.0.0.1", quiet=True)):
            from analysis import run_store

            yield run_store._engine


def store(folder, programs, time_limit=60):
    return Store(folder, time_limit, programs)


def request(scene, *overrides, **more):
    return RunRequest("massspring", scene, ("material.nu=0.25", *overrides), **more)


def files_of(folder):
    return {
        file.relative_to(folder): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file() and file.name not in ("outcome.json", ".lock")
    }


def test_sweep_gives_the_table_and_the_files_of_one_worker(cluster, scene, programs, tmp_path):
    with made_by(Here()):
        sweep(scene, GRID, tmp_path / "one", is_quiet=True, store=store(tmp_path / "one" / "runs", programs))
    sweep(scene, GRID, tmp_path / "two", is_quiet=True, store=store(tmp_path / "two" / "runs", programs))
    tables = [(tmp_path / name / "sweep.csv").read_text() for name in ("one", "two")]
    assert tables[0] == tables[1] and tables[0].count("\n") == 9
    assert "expected less than 0.5" in tables[0]
    one, two = (files_of(tmp_path / name / "runs") for name in ("one", "two"))
    assert {file: data for file, data in one.items() if not str(file).startswith(".")} == {
        file: data for file, data in two.items() if not str(file).startswith(".")
    }
    n_calls = len(calls(programs))
    sweep(scene, GRID, tmp_path / "two", is_quiet=True, store=store(tmp_path / "two" / "runs", programs))
    assert len(calls(programs)) == n_calls


def test_a_run_has_the_same_key_with_and_without_a_cluster(scene, programs, tmp_path, monkeypatch):
    """Where the variables of threads are not set, too."""
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(module, "LOCK", tmp_path / "lock")
    monkeypatch.setattr(module, "PROGRAMS", programs)
    with made_by(Here()):
        key = store(tmp_path / "runs", programs).key(request(scene))
    with engine_of(Namespace(workers=2, cluster=None, listen="127.0.0.1", quiet=True)):
        assert store(tmp_path / "runs", programs).key(request(scene)) == key


def test_of_the_threads_of_a_study_one_works_while_others_wait_for_runs(cluster, scene, programs, tmp_path):
    kept = store(tmp_path, programs)
    most: Counter[str] = Counter()
    now: Counter[str] = Counter()

    @contextmanager
    def counted(what):
        now[what] += 1
        most[what] = max(most[what], now[what])
        yield
        now[what] -= 1

    def measure(number):
        with counted("at work"):
            time.sleep(0.02)
        with counted("waiting"):
            outcome = kept.run(request(scene, f"density={1000 + number}"))
        with counted("at work"):
            time.sleep(0.02)
        return outcome

    for outcome in each(measure, range(6)):
        with counted("at work"):
            time.sleep(0.02)
        assert outcome.status == "ok"
    assert most["at work"] == 1 and most["waiting"] > 2

    for pair in each(lambda number: [*each(measure, (number, number + 10))], range(3)):
        assert [outcome.status for outcome in pair] == ["ok", "ok"]
    assert most["at work"] == 1


def test_what_was_begun_first_is_finished_first(cluster, scene, programs, tmp_path):
    kept = store(tmp_path, programs)
    ended = []

    def two_runs(number):
        for run in (1, 2):
            kept.run(request(scene, f"density={2000 + number}", f"gravity={run}"))
        ended.append(number)

    list(each(two_runs, range(16)))
    first = [ended.index(number) for number in range(4)]
    assert max(first) < 8, ended


def test_inputs_travel_and_messages_name_those_asked_for(tmp_path):
    """The program finds content that is nowhere else, and what it writes of its inputs reads as if it had run here."""
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "bin").mkdir(parents=True)
    program = (
        '#!/bin/sh\nfor word; do case "$word" in surface.file=*|mesh=*) f=$(echo "$word" | tr -d \'"\');\n'
    )
    program += 'cat "${f#*=}"; echo "error: ${f#*=}:1: not a surface" >&2;; esac; done; cat "$1"; exit 1\n'
    for name in ("massspring", "fem_reference", "gmsh_worker", "tetgen_worker"):
        (here / "bin" / name).write_text(program)
        (here / "bin" / name).chmod(0o755)
    (here / "ball.obj").write_text("v 0 0 1\n")
    (here / "scene.toml").write_text('surface = { file = "ball.obj" } # the scene\n')
    made = store(here / "runs", here / "bin")
    asked = RunRequest("massspring", here / "scene.toml")
    key = made.key(asked)
    task = task_of(made, asked, key)
    for name in ("ball.obj", "scene.toml"):
        (here / name).unlink()
    files = perform(task, there)
    assert "v 0 0 1\n" in files["messages.txt"].decode() and "# the scene" in files["messages.txt"].decode()
    assert f'"{here / "ball.obj"}:1: not a surface"' in files["outcome.json"].decode()
    assert str(there) not in str(files["messages.txt"] + files["outcome.json"])
    before = (there / "runs" / key / "outcome.json").stat().st_mtime_ns
    assert perform(task, there) == files  # by the worker's own store
    assert (there / "runs" / key / "outcome.json").stat().st_mtime_ns == before


def test_threads_of_a_run_are_those_of_who_asks(scene, tmp_path, monkeypatch):
    """And not the worker's own."""
    (tmp_path / "bin").mkdir()
    for name in ("massspring", "fem_reference", "gmsh_worker", "tetgen_worker"):
        (tmp_path / "bin" / name).write_text('#!/bin/sh\necho "$OMP_NUM_THREADS threads"; exit 1\n')
        (tmp_path / "bin" / name).chmod(0o755)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    task = task_of(store(tmp_path / "runs", tmp_path / "bin"), request(scene), "a")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert perform(task, tmp_path / "worker")["messages.txt"].startswith(b"3 threads\n")


def test_programs_that_have_been_built_anew_make_nothing(scene, ball, tmp_path):
    programs = make_solvers(tmp_path / "solvers", ball)
    task = task_of(store(tmp_path, programs), request(scene), "a")
    (programs / "gmsh_worker").write_text("another")
    with pytest.raises(RunError, match=r"built anew, expected \w+"):
        perform(task, tmp_path / "worker")


def spans(programs, folder):
    """Start and end of each run (s), by whether it was timed."""
    text = (folder / "spans.txt").read_text().split()
    return [(word, float(start), float(end)) for word, start, end in zip(*[iter(text)] * 3, strict=True)]


def test_timed_run_shares_the_machine_with_none(cluster, scene, programs, tmp_path):
    log = tmp_path / "spans.txt"
    (tmp_path / "note").write_text(
        f'#!/bin/sh\nstart=$(date +%s.%N); "$@"; echo "$WHAT $start $(date +%s.%N)" >>{log}\n'
    )
    (tmp_path / "note").chmod(0o755)

    def asked(number):
        is_timed = number % 3 == 1
        prefix = ("env", f"WHAT={'timed' if is_timed else 'plain'}", str(tmp_path / "note"))
        return request(scene, f"a={number}", prefix=prefix, is_timed=is_timed)

    made = store(tmp_path / "runs", programs)
    assert {outcome.status for outcome in each(made.run, map(asked, range(9)))} == {"ok"}
    found = spans(programs, tmp_path)
    overlapping = [(a, b) for n, a in enumerate(found) for b in found[:n] if a[1] < b[2] and b[1] < a[2]]
    assert len(found) == 9 and overlapping
    assert not [pair for pair in overlapping if "timed" in (pair[0][0], pair[1][0])]


def test_timed_runs_of_another_kind_of_machine_are_other_runs(scene, programs, tmp_path):
    keys = []
    for kind in ("one", "two"):
        engine = Here()
        engine.machine = kind
        with made_by(engine):
            keys.append([store(tmp_path, programs).key(request(scene, is_timed=t)) for t in (True, False)])
    (one, plain), (two, same) = keys
    assert plain == same and len({one, two, plain}) == 3


def test_second_worker_of_a_machine_takes_no_timed_runs(programs, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PROGRAMS", programs)
    monkeypatch.setattr(module, "LOCK", tmp_path / "lock")
    with offered(2) as first, offered(2) as second:
        pass
    with offered(2) as later:
        pass
    kinds = [[name.split()[0] for name in resources] for resources in (first, second, later)]
    assert kinds == [["run", "programs", "machine"], ["run", "programs"], ["run", "programs", "machine"]]


def test_killed_worker_loses_nothing(cluster, scene, programs, tmp_path):
    before = list(cluster.client.run(os.getpid).values())

    def kill():
        time.sleep(0.5)
        os.kill(before[0], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    made = store(tmp_path / "runs", programs)
    asked = [request(scene, f"a={number}") for number in range(20)]
    assert [outcome.status for outcome in each(made.run, asked)] == ["ok"] * 20
    thread.join()
    assert list(cluster.client.run(os.getpid).values()) != before


def test_run_that_kills_its_workers_is_a_row_that_is_not_kept(cluster, scene, programs, tmp_path):
    made = store(tmp_path / "runs", programs)
    lost = made.run(request(scene, "deadly=1"))
    assert (lost.status, made.find(request(scene, "deadly=1"))) == ("failed", None)
    assert lost.message.startswith("massspring: its worker died 3 times")
    assert made.run(request(scene, "a=1")).status == "ok"


def test_workers_join_and_one_with_other_programs_is_refused_by_name(
    cluster, scene, programs, ball, tmp_path, capfd
):
    other = make_solvers(tmp_path / "solvers", ball)
    address = cluster.client.scheduler.address
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", _WORKER, address, of, tmp_path / name, tmp_path / "lock", name],
            cwd=ROOT, stdout=subprocess.PIPE, text=True,
        )
        for name, of in (("friend", programs), ("stranger", other))
    ]  # fmt: skip
    for worker, name in zip(workers, ("friend", "stranger"), strict=True):
        assert worker.stdout.readline() == f"worker {name}: 1 runs at once for {address}\n"
    made = store(tmp_path / "runs", programs)
    assert {o.status for o in each(made.run, [request(scene, f"a={n}") for n in range(12)])} == {"ok"}
    for worker in workers:
        worker.kill()
        worker.communicate()
    assert not calls(other) and list((tmp_path / "friend").rglob("outcome.json"))
    said = capfd.readouterr().err
    assert (
        "worker stranger" in said and hash_of_programs(other) in said and hash_of_programs(programs) in said
    )


def listening(process):
    """Addresses at which a process and those that it has started listen."""
    of = psutil.Process(process)
    return {
        connection.laddr.ip
        for one in (of, *of.children(recursive=True))
        for connection in one.net_connections("inet")
        if connection.status == psutil.CONN_LISTEN
    }


def test_a_cluster_of_this_machine_listens_to_no_other(cluster):
    assert listening(os.getpid()) == {"127.0.0.1"}


@pytest.mark.parametrize("host, is_said", [("127.0.0.1", False), ("127.0.0.2", True)])
def test_a_cluster_that_listens_to_others_says_what_they_can_do(
    host, is_said, programs, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(module, "LOCK", tmp_path / "lock")
    monkeypatch.setattr(module, "PROGRAMS", programs)
    with engine_of(Namespace(workers=2, cluster=None, listen=host, quiet=False)):
        pass
    said = capfd.readouterr().err
    assert f"cluster tcp://{host}:" in said and f"dashboard http://{host}:" in said
    assert (f"whoever reaches {host} can run anything as you; TLS: analysis/CLUSTER.md" in said) == is_said
    assert "## Who may connect" in (ROOT / "analysis" / "CLUSTER.md").read_text()


def test_the_example_for_job_arrays_makes_every_run_once():
    """Its words are a sweep's, in a hundred parts."""
    text = (ROOT / "analysis" / "examples" / "Snakefile").read_text()
    known = {}
    exec(text[: text.index("rule table:")], known)
    shares = [
        parse_arguments([*shlex.split(known["SWEEP"])[1:], "--part", f"{part}/{known['N']}"])
        for part in range(1, known["N"] + 1)
    ]
    settings = settings_of(parse_grid(shares[0].overrides))
    made = [values for of in shares for values in settings[of.part[0] - 1 :: of.part[1]]]
    assert len(made) == len(settings) == 1400 and all(values in made for values in settings)
    assert text.count("\nrule ") == 2 and 'SWEEP + " --part {wildcards.part}/" + str(N)' in text


def test_a_scheduler_started_as_the_page_says_gives_runs_to_workers(scene, programs, tmp_path, monkeypatch):
    """From the project's folder, with nothing set. The worker listens where it reaches the scheduler."""
    page = (ROOT / "analysis" / "CLUSTER.md").read_text()
    (line,) = re.findall("^    (.*dask scheduler --host .*)$", page, re.MULTILINE)
    words = re.sub("--host .*", "--host 127.0.0.1 --port 0 --dashboard-address 127.0.0.1:0", line)
    words = "exec env " + words.replace(".venv/bin/dask", str(Path(sys.executable).parent / "dask"))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    monkeypatch.setattr(module, "PROGRAMS", programs)
    with subprocess.Popen(
        words, shell=True, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True
    ) as scheduler:
        said = iter(scheduler.stderr.readline, "")
        address = next(found[1] for text in said if (found := re.search(r"Scheduler at: *(tcp://\S+)", text)))
        command = [sys.executable, "-c", _WORKER, address, programs, tmp_path / "a", tmp_path / "lock", "a"]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as worker:
            assert worker.stdout.readline().startswith("worker a: 1 runs at once")
            assert listening(worker.pid) == {"127.0.0.1"}
            with engine_of(Namespace(workers=1, cluster=address, quiet=True)):
                made = store(tmp_path / "runs", programs)
                assert made.run(request(scene, "a=1")).status == "ok"
            worker.kill()
        scheduler.kill()
    assert list((tmp_path / "a").rglob("outcome.json"))


def test_sweep_that_is_stopped_by_hand_ends_at_once(ball, scene, tmp_path):
    slow = make_solvers(tmp_path / "solvers", ball, seconds=100)
    code = (
        "import sys; from pathlib import Path; from analysis import cluster, grid, run_store\n"
        "cluster.PROGRAMS, cluster.LOCK = (Path(word) for word in sys.argv[1:3])\n"
        "run_store.Store.__init__.__defaults__ = (3600, cluster.PROGRAMS)\n"
        "del sys.argv[1:3]; from analysis.__main__ import main; sys.exit(main())"
    )
    words = [
        "sweep",
        scene,
        "--set",
        "material.nu=0.25,0.3,0.45",
        "--workers",
        "2",
        "--out",
        tmp_path / "out",
    ]
    with subprocess.Popen(
        [sys.executable, "-c", code, slow, tmp_path / "lock", *words],
        cwd=ROOT, stderr=subprocess.PIPE, text=True,
    ) as stopped:  # fmt: skip
        wait_for_calls(slow, 2, 0)
        stopped.send_signal(signal.SIGINT)
        said = stopped.communicate(timeout=60)[1]
    assert stopped.returncode == 130 and "stopped; to continue: ./testbed sweep" in said
    assert "Traceback" not in said


_REPRODUCE = """
import sys
from pathlib import Path
from analysis import cluster, experiment, reproduce, run_store
home, programs = Path(sys.argv[1]), Path(sys.argv[2])
cluster.PROGRAMS = experiment.PROGRAMS = programs
cluster.LOCK, run_store.Store.__init__.__defaults__ = home / "lock", (3600, programs)
reproduce.ROOT = reproduce.SCENES = home
reproduce.OUT, reproduce.STORED = home / "out", home / "stored.json"
rows = tuple({"label": [nu], "scene": "scene.toml", "set": [f"material.nu={nu}"]} for nu in ("0.25", "0.3", "0.45"))
column = "models.affine.displacement_error_l2"
entry = reproduce.Entry("pairs", "PAGE.md", "Pairs", 1, (1,), head=("nu", "error"), columns=(column,), rows=rows)
reproduce.entries = lambda: {"pairs": entry}
from analysis.__main__ import main
sys.argv[1:] = ["reproduce", "--workers", "2"]
sys.exit(main())
"""


def test_a_published_table_of_pairs_is_made_by_the_engine_and_goes_on_after_a_kill(ball, tmp_path):
    programs = make_solvers(tmp_path / "solvers", ball, seconds=2)
    filled_in = (
        '[network]\ncalibration = ""\n[comparison]\n[time]\nmode = "static"\n[reference]\nrefine = 0\n'
    )
    more = 'name = "a"\n[surface]\nshape = "ball"\n[material]\nlaw = "small_strain"\n'
    (tmp_path / "solvers" / "fem_reference" / "scene.toml").write_text(more + filled_in)
    (tmp_path / "scene.toml").write_text("")
    page = "## Pairs\n\n| nu | error |\n|---|---|\n| 0.25 | 10 % |\n| 0.3 | 21 % |\n| 0.45 | 50 % |\n"
    (tmp_path / "PAGE.md").write_text(page)
    command = [sys.executable, "-c", _REPRODUCE, tmp_path, programs]
    runs = tmp_path / "out" / "reproduce" / "pairs" / "runs"
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL) as killed:
        while len(there := [file for file in runs.glob("*/outcome.json") if ".part-" not in str(file)]) < 2:
            time.sleep(0.01)
        killed.kill()
    written = {file: file.stat().st_mtime_ns for file in there}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert {file: file.stat().st_mtime_ns for file in there} == written
    assert len(list(runs.glob("*/outcome.json"))) == 6 <= len(calls(programs)) <= 6 + 2, "two were at work"
    assert "  0.45: 50 % -> 40 %" in done.stdout and done.returncode == 1
    place = r"tcp://127\.0\.0\.1:\d+, its dashboard http://127\.0\.0\.1:\d+/status; to add a machine: ./testbed worker"
    assert re.search(place, done.stderr)
    assert "[3/3] pairs: 0.45" in done.stderr and "left] pairs: 0.25" in done.stderr
    report = (tmp_path / "out" / "reproduce" / "report.html").read_text()
    assert "<td>6</td><td>1</td><td>20 %</td><td>differ</td>" in report


def test_what_the_engine_costs_is_told_by_run_but_not_of_what_was_killed():
    one = study.Measured("one", 1, wall=10, of_runs=9, cpu=0.5, n_runs=100, table=[{"a": "1"}])
    two = replace(one, name="two", n_workers=2, wall=5.5, cpu=1.5)
    killed = replace(two, name="killed", cpu=None, table=[{"a": "2"}])
    head, lines = study.table([one, two, killed])
    assert head[1:5] == ["runs", "seconds", "without a run (ms)", "processor (ms)"]
    assert lines == [
        ["one", "100", "10", "10.0", "5.0", "the same"],
        ["two", "100", "6", "20.0", "15.0", "the same"],
        ["killed", "100", "6", "-", "-", "another"],
    ]
    assert study.finding([one, two, killed]) == (
        "1 of 2 sweeps on a cluster give the table of one worker, and the engine takes 10.0 ms of a processor for a run."
    )


@pytest.mark.skipif(not (PROGRAMS / "fem_reference").exists(), reason="needs the built programs")
def test_sweeps_of_small_runs_give_one_table_whatever_is_killed(tmp_path, monkeypatch):
    """By real programs. Asked again, they are made and measured again."""
    monkeypatch.setattr(study, "alone", lambda _: nullcontext())
    monkeypatch.setattr(study, "_N_QUICK", 3)
    left = tmp_path / "sweeps" / "one" / "runs" / "left"
    left.mkdir(parents=True)
    found = study.study(Namespace(quick=True, quiet=True), tmp_path)
    (section,) = found.sections
    _, lines = section.tables["cluster"]
    assert [line[1] for line in lines] == ["6"] * 4 and [line[-1] for line in lines] == ["the same"] * 4
    assert found.sentence.startswith("3 of 3 sweeps") and not left.exists()


def test_a_run_that_a_kill_has_cut_off_is_not_finished(tmp_path):
    """Its outcome was written, and its folder not yet given its name."""
    for name in ("5aa49c47", "5aa49c48.part-vm-12312"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "outcome.json").write_text("{}")
    assert [file.parent.name for file in study.finished(tmp_path)] == ["5aa49c47"]


def test_one_worker_loads_no_engine():
    code = (
        "import sys; from argparse import Namespace; import analysis.__main__ as m\n"
        "with m.cluster.engine_of(Namespace(workers=1, cluster=None)): print('distributed' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_workers_and_cluster_exclude_each_other():
    with (
        pytest.raises(RunError, match="expected one of them"),
        engine_of(Namespace(workers=2, cluster="tcp://a:1")),
    ):
        pass


def test_programs_keep_off_the_runs_that_are_being_made():
    """They remove folders of the system's temporary folder that bear this prefix, are old, and that nobody has locked."""
    with scratch() as name:
        folder = os.open(name, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(folder)
    assert not Path(name).exists()
