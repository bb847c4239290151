"""Copies of this process as workers."""

import contextlib
import multiprocessing
import os
import sys
import time

import pytest

from experiments.parallel.executors import InlineExecutor, copied_workers, processors
from experiments.parallel.workers import copies
from trackslip.errors import InvalidValueError, TrackslipError

KNOWN = []


def known():
    return KNOWN, os.getpid()


def refuse():
    raise InvalidValueError("radii", 0.1, "greater than the half gauge")


def test_copies_know_what_this_process_knows(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "KNOWN", ["a table"])
    with copied_workers(2) as workers:
        found, there = workers.begin(known)()
    assert found == ["a table"]
    assert there != os.getpid()


def test_one_thread_needs_no_copy():
    with copied_workers(1) as workers:
        assert isinstance(workers.executor, InlineExecutor)
        assert workers.begin(known)()[1] == os.getpid()


def test_as_many_as_processors_by_default():
    with copied_workers(0) as workers:
        assert workers.count == processors()


def test_a_copy_that_dies_is_reported():
    with pytest.raises(TrackslipError, match="a worker died"), copied_workers(2) as workers:
        workers.begin(os._exit, 1)()


@pytest.mark.parametrize("threads", [1, 2])
def test_what_a_task_raises_arrives(threads):
    with copied_workers(threads) as workers, pytest.raises(InvalidValueError, match=r"radii = 0\.1: must be greater"):
        workers.begin(refuse)()


def test_copies_end_with_an_error():
    with contextlib.suppress(KeyError), copies(2) as pool:
        assert len(multiprocessing.active_children()) >= 2
        pool.submit(time.sleep, 60)
        raise KeyError
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert multiprocessing.active_children() == []
