"""Worker processes that fail, die or are killed, and interrupted commands."""

import contextlib
import itertools
import multiprocessing
import os
import random
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark import config as benchmark
from experiments.common import pool as parallel
from experiments.common.pool import InlineExecutor, Workers, workers
from experiments.grid import config as grid
from experiments.studies import trials
from trackslip.errors import TrackslipError


def die(_task):
    os.kill(os.getpid(), signal.SIGKILL)


def double(task):
    return 2 * task


def refuse(task):
    raise ValueError(task)


def large(megabytes):
    return np.zeros(megabytes * 125_000)


def stubborn(_task):
    while True:
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(60)


def gone():
    """Whether all children have ended, once the pool's thread has noticed."""
    deadline = time.monotonic() + 2
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    return multiprocessing.active_children() == []


@pytest.mark.parametrize(("name", "jobs"), [("inline", 1), ("processes", 1), ("processes", 2)])
def test_every_task_is_done_once(name, jobs):
    with workers(name, jobs) as pool:
        assert sorted(pool.each(double, range(20))) == list(range(0, 40, 2))
        assert list(pool.each(double, [])) == []
        assert list(pool.map(double, range(20))) == list(range(0, 40, 2))
    assert gone()


@pytest.mark.parametrize("way", ["each", "map"])
def test_what_a_task_raises_arrives_and_a_worker_that_dies_is_reported(way):
    for jobs in (1, 2):
        with pytest.raises(ValueError, match="0"), workers("processes", jobs) as pool:
            list(getattr(pool, way)(refuse, [0]))
    with pytest.raises(TrackslipError, match="a worker died"), workers("processes", 2) as pool:
        list(getattr(pool, way)(die, range(4)))
    assert gone()


KILLED = type("KilledWorker", (Exception,), {"__module__": "distributed.scheduler"})


@pytest.mark.parametrize(("error", "message"), [(KILLED, "KilledWorker"), (CancelledError, "a worker died")])
def test_failures_in_a_cluster(error, message):
    def fail(_task):
        raise error

    with pytest.raises(TrackslipError, match=message):
        list(Workers(InlineExecutor(), 1).each(fail, [1]))


@pytest.mark.parametrize(("do", "tasks"), [(time.sleep, [60] * 4), (large, [20] * 20), (stubborn, [0] * 4)])
def test_an_error_leaves_no_process(do, tasks):
    """While workers compute, return results, or ignore interrupts."""

    def fail():
        with workers("processes", 2) as pool:
            list(pool.map(double, range(4)))
            pool.map(do, tasks)
            time.sleep(0.2)
            raise KeyError(time.monotonic())

    with pytest.raises(KeyError) as caught:
        fail()
    assert time.monotonic() - caught.value.args[0] < 4
    assert gone()


def test_workers_end_with_a_parent_that_is_killed():
    code = """
import multiprocessing, time
from experiments.common.pool import workers
if __name__ == "__main__":
    with workers("processes", 2) as pool:
        pending = pool.map(time.sleep, [0, 0, 60, 60])
        next(pending), next(pending)
        print(*(child.pid for child in multiprocessing.active_children()), flush=True)
        list(pending)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        first = process.stdout.readline().split()
        process.kill()
        began = time.monotonic()
        process.stdout.read()  # until nobody can write there any more
        assert time.monotonic() - began < 5
    assert len(first) == 2


_OF_DASK = (
    "import pathlib, sys; from distributed.cli.{module} import main\n"
    "sys.path[:] = [p for p in sys.path if not (pathlib.Path(p or '.') / 'experiments').is_dir()]\nmain()"
)


@contextlib.contextmanager
def started(module, *arguments):
    """Standard error of a Dask process that cannot import this checkout."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [sys.executable, "-c", _OF_DASK.format(module=module), *arguments]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, cwd="/") as process:
        try:
            yield process.stderr
        finally:
            process.kill()


@pytest.mark.slow
def test_a_dask_worker_without_trackslip_is_refused(monkeypatch):
    """On a real cluster, such a worker would never run its tasks."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(parallel, "_IMPORT_TIMEOUT", 5)
    with started("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard") as said:
        address = next(match[1] for line in said if (match := re.search(r"Scheduler at: *tcp://(\S+)", line)))
        options = (f"tcp://{address}", "--no-nanny", "--no-dashboard", "--nthreads", "1")
        with started("dask_worker", *options) as worker_said:
            assert any("Registered to" in line for line in worker_said)
            began = time.monotonic()
            with pytest.raises(TrackslipError, match="can't import trackslip"), workers(f"dask://{address}", 1):
                pass
            assert time.monotonic() - began < 30


SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
COMMANDS = {
    "reproduce": (*SMALL, "--threads", "2"),
    "grid": (*SMALL, "--vary", "scanner.noise=0.001,0.002,0.003,0.004", "--jobs", "2"),
    "benchmark": ("--controllers", "linear", "lqr", "--references", "circle", "--seeds", "0", "1", "--jobs", "2"),
    "track": (),
}
KEPT = {benchmark.PARTS, grid.PARTS, trials.FILE}  # in OUT, with which an interrupted command resumes
PROGRESS = re.compile(r"(?!trackslip).+: [\d.]+(/[\d.]+)? \w+.*")
LONGEST = 5.0  # until an interrupted command has ended [s]
STARTED = 1.0  # until when Python may not have got as far as our first lines on a busy machine [s]


WAYS = ((signal.SIGINT, os.killpg), (signal.SIGTERM, os.kill)) if os.name == "posix" else ()


@pytest.mark.parametrize(("command", "way"), list(zip(COMMANDS, itertools.cycle(WAYS), strict=False)))
def test_an_interrupted_command_ends_at_once_and_leaves_nothing(command, way, tmp_path):
    interrupt(command, random.Random(f"{command} {way}").uniform(0.1, 3.0), *way, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("seed", range(60 if WAYS else 0))
def test_three_hundred_interrupts(command, seed, tmp_path):
    """A quarter of an hour, at any moment of a command and shortly after its end."""
    rng = random.Random(f"{command} {seed}")
    interrupt(command, rng.uniform(0.1, 8.0), *rng.choice(WAYS), tmp_path)


def interrupt(command, after, number, send, folder):
    """Start a command and interrupt it after some time [s]; check how it ends and what it leaves."""
    environment = {**os.environ, "TMPDIR": str(folder / "tmp"), "PYTHONPATH": str(Path(__file__).parents[3])}
    (folder / "tmp").mkdir()
    whole = [sys.executable, "-m", "experiments", command, *COMMANDS[command], "--out", str(folder / "out")]
    with subprocess.Popen(
        whole, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        time.sleep(after)
        if process.poll() is None:
            send(process.pid, number)
        try:
            said = process.communicate(timeout=LONGEST)[1]
        finally:
            left = processes_of(process.pid, time.monotonic() + LONGEST)
            if left:
                os.killpg(process.pid, signal.SIGKILL)
    assert left == []
    if process.returncode == -number and after < STARTED:
        return
    lines = [re.sub(" with .*", "", line) for line in said.splitlines() if not PROGRESS.fullmatch(line)]
    assert (process.returncode, lines) in ((0, []), (130, ["trackslip: interrupted"]))
    assert unfinished(folder / "out", folder / "tmp") == []


def processes_of(group, until):
    """The processes of a group that don't end until then."""
    while True:
        listed = subprocess.run(["ps", "-A", "-o", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
        rows = [line.split(maxsplit=2) for line in listed.stdout.splitlines()]
        there = [" ".join(row) for row in rows if row[0] == str(group) and not row[1].startswith("Z")]
        if not there or time.monotonic() > until:
            return there
        time.sleep(0.05)


def unfinished(out, temporary):
    """Files that an interrupted command has left and shouldn't have."""
    files = [*temporary.iterdir(), *(out.iterdir() if out.exists() else ())]
    if (out / "manifest.json").exists():  # it had just ended
        return [file for file in files if file.name.startswith(".")]
    parts = [file for file in files if file.name in KEPT]
    drafts = [draft for part in parts for draft in part.glob(".*")]
    empty = [out] if out.exists() and not parts else []
    return [file for file in (*files, *drafts, *empty) if file not in parts]
