"""Workers that fail, die or are killed, and interrupted commands."""

import itertools
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError, Executor, Future
from pathlib import Path

import numpy as np
import pytest

from experiments.common.pool import Workers, workers
from experiments.common.sweep import STORE
from trackslip.errors import TrackslipError


def die(_task):
    os.kill(os.getpid(), signal.SIGKILL)


def double(task):
    return 2 * task


def refuse(task):
    raise ValueError(task)


def large(megabytes):
    return np.zeros(megabytes * 125_000)


def gone():
    """Whether all children have ended, once the pool's thread has noticed."""
    deadline = time.monotonic() + 10  # on a busy machine; the tasks that are left would take 15 s
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    return multiprocessing.active_children() == []


@pytest.mark.parametrize(("name", "count"), [("inline", 1), ("processes", 2)])
def test_every_task_is_done_once(name, count):
    with workers(name, count) as pool:
        assert sorted(pool.each(double, range(20))) == list(range(0, 40, 2))
        assert list(pool.each(double, [])) == []
    assert gone()


def test_what_a_task_raises_arrives_and_a_worker_that_dies_is_reported():
    with pytest.raises(ValueError, match="0"), workers("processes", 1) as pool:
        list(pool.each(refuse, [0]))
    with pytest.raises(TrackslipError, match="a worker died"), workers("processes", 2) as pool:
        list(pool.each(die, range(4)))
    assert gone()


KILLED = type("KilledWorker", (Exception,), {"__module__": "distributed.scheduler"})


@pytest.mark.parametrize(("error", "message"), [(KILLED(), "KilledWorker"), (CancelledError(), "a worker died")])
def test_failures_in_a_cluster(error, message):
    class Cluster(Executor):
        def submit(self, *_):
            future = Future()
            future.set_exception(error)
            return future

    with pytest.raises(TrackslipError, match=message):
        list(Workers(Cluster(), 1).each(double, [1]))


@pytest.mark.parametrize(("do", "tasks"), [(time.sleep, [0, *[1.5] * 20]), (large, [20] * 20)])
def test_an_error_leaves_no_process(do, tasks):
    """While workers compute, or return results: they end their tasks, and begin no others."""

    def fail():
        with workers("processes", 2) as pool:
            next(pool.each(do, tasks))
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert gone()


def test_workers_end_with_a_parent_that_is_killed():
    code = """
import multiprocessing, time
from experiments.common.pool import workers
if __name__ == "__main__":
    with workers("processes", 2) as pool:
        pending = pool.each(time.sleep, [0, 0, 60, 60])
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


SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
COMMANDS = {
    "reproduce": (*SMALL, "--threads", "2"),
    "grid": (*SMALL, "--vary", "scanner.noise=0.001,0.002,0.003,0.004", "--jobs", "2"),
    "benchmark": ("--controllers", "linear", "lqr", "--references", "circle", "--seeds", "0", "1", "--jobs", "2"),
    "track": (),
}
LONGEST = 5.0  # until an interrupted command has ended [s]
STARTED = 1.0  # until when Python may not have got as far as our first lines on a busy machine [s]
WAYS = ((signal.SIGINT, os.killpg), (signal.SIGTERM, os.kill)) if os.name == "posix" else ()


@pytest.mark.parametrize(("command", "way"), list(zip(COMMANDS, itertools.cycle(WAYS), strict=False)))
def test_an_interrupted_command_ends_at_once_and_leaves_nothing(command, way, tmp_path):
    interrupt(command, random.Random(f"{command} {way}").uniform(0.1, 3.0), *way, tmp_path)


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
            message = process.communicate(timeout=LONGEST)[1]
        finally:
            left = processes_of(process.pid, time.monotonic() + LONGEST)
            if left:
                os.killpg(process.pid, signal.SIGKILL)
    assert left == []
    if process.returncode == -number and after < STARTED:
        return
    lines = [line.partition(" with ")[0] for line in message.splitlines() if line.startswith("trackslip")]
    assert (process.returncode, lines) in ((0, []), (130, ["trackslip: interrupted"])), message
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
    """Files that an interrupted command has left and shouldn't have: all but a store, with which it resumes."""
    files = [*temporary.iterdir(), *(out.iterdir() if out.exists() else ())]
    if (out / "manifest.json").exists():  # it had just ended
        return [file for file in files if file.name.startswith(".")]
    store = [file for file in files if file.name == STORE]
    drafts = [draft for folder in store for draft in folder.glob(".*")]
    empty = [out] if out.exists() and not store else []
    return [file for file in (*files, *drafts, *empty) if file not in store]
