import logging
import os
import sys
import types
from concurrent.futures import CancelledError

import pytest

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


def test_a_worker_that_dies_costs_a_line():
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
def test_what_fails_in_a_cluster(error, raised, message):
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
