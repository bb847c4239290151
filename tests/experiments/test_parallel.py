"""Workers, and what is left of them when they die or the command is interrupted."""

import contextlib
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError

import numpy as np
import pytest

from experiments import parallel
from experiments.parallel import InlineExecutor, Workers, interrupts_later, workers
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
    """Whether no process is left, once the pool's thread has noted it."""
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_for_the_end_of_a_block(number):
    def handle(*_):
        raise KeyboardInterrupt

    def interrupted():
        with interrupts_later():
            signal.raise_signal(number)
            done.append(number)

    before, done = signal.signal(number, handle), []
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert done == [number]
    finally:
        assert signal.signal(number, before) is handle


@pytest.mark.parametrize(("do", "tasks"), [(time.sleep, [60] * 4), (large, [20] * 20), (stubborn, [0] * 4)])
def test_an_error_leaves_no_process(do, tasks):
    """While workers are at work, while they return results, and when their tasks don't end."""

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


def test_workers_ignore_interrupts_of_the_terminal():
    with workers("processes", 2) as pool:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        pending = pool.map(time.sleep, [1.0] * 2)
        for child in multiprocessing.active_children():
            os.kill(child.pid, signal.SIGINT)
        assert list(pending) == [None, None]
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_workers_end_with_a_parent_that_is_killed():
    code = """
import multiprocessing, time
from experiments.parallel import workers
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
    """What a process of Dask's says, which can't import the modules of this checkout."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [sys.executable, "-c", _OF_DASK.format(module=module), *arguments]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, cwd="/") as process:
        try:
            yield process.stderr
        finally:
            process.kill()


@pytest.mark.slow
def test_a_dask_worker_without_trackslip_is_refused(monkeypatch):
    """A real cluster: a worker that can't load a task never does it."""
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
