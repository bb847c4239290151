"""Workers that fail, die or are killed, and interrupted commands."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from experiments.common.pool import workers
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
    with pytest.raises(ValueError, match="0"), workers("inline", 1) as pool:
        list(pool.each(refuse, [0]))
    with pytest.raises(TrackslipError, match="a worker died"), workers("processes", 1) as pool:
        list(pool.each(die, range(2)))
    assert gone()


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
}


def lives(group):
    """Whether a group still has a process after a while."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.parametrize(
    ("command", "send", "number"), [("reproduce", os.killpg, signal.SIGINT), ("grid", os.kill, signal.SIGTERM)]
)
def test_an_interrupted_command_ends_at_once_and_leaves_nothing(command, send, number, tmp_path):
    """No process of its group, and no file but a store, with which it resumes."""
    out, temporary = tmp_path / "out", tmp_path / "tmp"
    temporary.mkdir()
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(Path(__file__).parents[3])}
    whole = [sys.executable, "-m", "experiments", command, *COMMANDS[command], "--out", str(out)]
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen(whole, env=environment, **options) as process:
        while not out.exists():
            assert process.poll() is None
            time.sleep(0.01)
        time.sleep(0.5)
        send(process.pid, number)
        message = process.communicate(timeout=10)[1]
    assert process.returncode == 130
    assert "\ntrackslip: interrupted" in f"\n{message}"
    assert not lives(process.pid)
    assert not list(temporary.iterdir())
    assert not out.exists() or [file.name for file in out.iterdir()] == [STORE]
    assert not list(out.glob(f"{STORE}/.*"))
