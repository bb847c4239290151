import contextlib
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
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


def children():
    return psutil.Process().children(recursive=True)


@pytest.mark.parametrize(("name", "count"), [("inline", 1), ("processes", 2)])
def test_every_task_is_done_once_and_an_error_leaves_no_process(name, count):
    """While workers compute and return results."""
    with contextlib.suppress(KeyError), workers(name, count) as pool:
        assert sorted(pool.each(double, range(20))) == list(range(0, 40, 2))
        assert list(pool.each(double, [])) == []
        for do, tasks in ((large, [2] * 20), (time.sleep, [0, *[1.5] * 20])):
            next(pool.each(do, tasks))
        raise KeyError
    assert not children()


def test_a_worker_that_dies_is_reported():
    with pytest.raises(TrackslipError, match="a worker died"), workers("processes", 1) as pool:
        list(pool.each(die, range(2)))
    assert not children()


def test_workers_end_with_a_parent_that_is_killed():
    code = """
import time
from experiments.common.pool import workers
with workers("processes", 2) as pool:
    pending = pool.each(time.sleep, [0, 0, 60, 60])
    next(pending), next(pending)
    print(flush=True)
    list(pending)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        started = psutil.Process(process.pid).children()
        process.kill()
        gone, _ = psutil.wait_procs(started, timeout=5)
    assert len(gone) == 2


def broken(_task):
    raise ValueError(lambda: "an error that can't be pickled")


def test_errors_in_workers_are_raised_here():
    with workers("processes", 1) as pool:
        with pytest.raises(TypeError, match="unsupported operand"):
            list(pool.each(double, [None]))
        with pytest.raises(RuntimeError, match="ValueError"):
            list(pool.each(broken, [1]))
        with pytest.raises((AttributeError, pickle.PicklingError), match="pickle"):
            list(pool.each(lambda task: task, [1]))


def shout(task):
    print("a task prints")
    return task


def test_what_tasks_print_is_no_result(capfd):
    with workers("processes", 1) as pool:
        assert list(pool.each(shout, [1, 2])) == [1, 2]
    assert capfd.readouterr().err.count("a task prints") == 2


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
    out = tmp_path / "out"
    temporary = tmp_path / "tmp"
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
