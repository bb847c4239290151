import contextlib
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
from trackslip.errors import TrackslipError
from trackslip.replacement import STORE


def die(_task):
    os.kill(os.getpid(), signal.SIGKILL)


def double(task):
    return 2 * task


def large(megabytes):
    return np.zeros(megabytes * 125_000)


def gone():
    deadline = time.monotonic() + 10  # on a busy machine; the tasks that are left would take 15 s
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    return multiprocessing.active_children() == []


@pytest.mark.parametrize(("name", "count"), [("inline", 1), ("processes", 2)])
def test_every_task_is_done_once_and_an_error_leaves_no_process(name, count):
    """While workers compute and return results: they end their tasks, and begin no others."""
    with contextlib.suppress(KeyError), workers(name, count) as pool:
        assert sorted(pool.each(double, range(20))) == list(range(0, 40, 2))
        assert list(pool.each(double, [])) == []
        for do, tasks in ((large, [2] * 20), (time.sleep, [0, *[1.5] * 20])):
            next(pool.each(do, tasks))
        raise KeyError
    assert gone()


def test_a_worker_that_dies_is_reported():
    with pytest.raises(TrackslipError, match="a worker died"), workers("processes", 1) as pool:
        list(pool.each(die, range(2)))
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
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as process:
        first = process.stdout.readline().split()
        process.kill()
        began = time.monotonic()
        process.stdout.read()  # until nobody can write there any more
        assert time.monotonic() - began < 5
    assert len(first) == 2


GRID = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
NOISES = ("--vary", "scanner.noise=0.001,0.002,0.003,0.004", "--jobs", "2")


def lives(group):
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.05)
    return True


def test_an_interrupted_command_ends_at_once_and_leaves_nothing(tmp_path):
    """No process of its group, and no file but a store, with which it resumes."""
    out, temporary = tmp_path / "out", tmp_path / "tmp"
    temporary.mkdir()
    environment = {
        **os.environ,
        "TMPDIR": str(temporary),
        "PYTHONPATH": str(Path(__file__).parents[3]),
    }
    command = [sys.executable, "-m", "experiments", "grid", *GRID, *NOISES, "--out", str(out)]
    options = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.PIPE,
        "text": True,
        "start_new_session": True,
    }
    with subprocess.Popen(command, env=environment, **options) as process:
        while not out.exists():
            assert process.poll() is None
            time.sleep(0.01)
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)
        message = process.communicate(timeout=10)[1]
    assert process.returncode == 130
    assert "\ntrackslip: interrupted" in f"\n{message}"
    assert not lives(process.pid)
    assert not list(temporary.iterdir())
    assert not out.exists() or [file.name for file in out.iterdir()] == [STORE]
    assert not list(out.glob(f"{STORE}/.*"))
