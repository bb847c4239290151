"""Where parts of a sweep are driven."""

import contextlib
import logging
import os
import re
import subprocess
import sys
import time
import types
from concurrent.futures import CancelledError
from pathlib import Path

import pytest

from experiments.parallel import executors
from experiments.parallel.executors import InlineExecutor, Workers, workers
from trackslip.errors import TrackslipError


def die(_task):
    os._exit(1)


def double(task):
    return 2 * task


def refuse(task):
    raise ValueError(task)


@pytest.mark.parametrize(("name", "jobs"), [("inline", 1), ("processes", 1), ("processes", 2)])
def test_every_task_is_done_once(name, jobs):
    with workers(name, jobs) as pool:
        assert sorted(pool.each(double, range(20))) == list(range(0, 40, 2))
        assert list(pool.each(double, [])) == []


def test_a_worker_that_dies_is_reported():
    with (
        pytest.raises(TrackslipError, match="a worker died"),
        workers("processes", 2) as pool,
    ):
        list(pool.each(die, range(4)))


@pytest.mark.parametrize(
    ("error", "raised", "message"),
    [
        (type("KilledWorker", (Exception,), {"__module__": "distributed.scheduler"}), TrackslipError, "KilledWorker"),
        (CancelledError, TrackslipError, "a worker died"),
        (ValueError, ValueError, None),
    ],
)
def test_failures_in_a_cluster(error, raised, message):
    def fail(_task):
        raise error

    with pytest.raises(raised, match=message):
        list(Workers(InlineExecutor(), 1).each(fail, [1]))


def test_inline_tasks_are_done_one_by_one():
    done = []
    results = Workers(InlineExecutor(), 1).each(done.append, range(3))
    next(results)
    assert done == [0]
    assert len(list(results)) == 2


WITHOUT_TRACKSLIP = (
    "import pathlib, sys; from distributed.cli.{module} import main\n"
    "sys.path[:] = [p for p in sys.path if not (pathlib.Path(p or '.') / 'experiments').is_dir()]\nmain()"
)
WITH_TRACKSLIP = "from distributed.cli.{module} import main; main()"


@contextlib.contextmanager
def started(code, module, *arguments):
    """A process of Dask's, once it has said that it is ready; without the modules of this checkout unless imported."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    if code is WITH_TRACKSLIP:
        environment["PYTHONPATH"] = str(Path(__file__).parents[3])
    command = [sys.executable, "-c", code.format(module=module), *arguments]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, cwd="/") as process:
        try:
            yield process.stderr
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", [WITH_TRACKSLIP, WITHOUT_TRACKSLIP], ids=["worker", "both"])
def test_a_dask_worker_without_trackslip_is_refused(scheduler, monkeypatch):
    """A real cluster: a worker that can't load a task never does it."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "_IMPORT_PATIENCE", 5)
    with started(scheduler, "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard") as said:
        address = next(match[1] for line in said if (match := re.search(r"Scheduler at: *tcp://(\S+)", line)))
        with started(
            WITHOUT_TRACKSLIP, "dask_worker", f"tcp://{address}", "--no-nanny", "--no-dashboard", "--nthreads", "1"
        ) as worker_said:
            assert any("Registered to" in line for line in worker_said)
            began = time.monotonic()
            with pytest.raises(TrackslipError, match="can't import trackslip"), workers(f"dask://{address}", 1):
                pass
            assert time.monotonic() - began < 30


class Cluster:
    """A client of a cluster with a worker, which logs what it is asked to do."""

    def __init__(self, *_arguments, **_options):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def scheduler_info(self, n_workers):
        return {"workers": {n_workers: {"nthreads": 1}}}

    def submit(self, function, **_options):
        return InlineExecutor().submit(function)

    def get_executor(self, pure):
        return InlineExecutor()


def test_what_a_cluster_logs_is_not_printed(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "distributed", types.SimpleNamespace(Client=Cluster))
    log = logging.getLogger("distributed.client")
    with workers("dask://there:1", 1) as pool:
        assert list(pool.each(log.error, ["lost"])) == [None]
    assert not caplog.messages
    log.error("later")
    assert caplog.messages == ["later"]
