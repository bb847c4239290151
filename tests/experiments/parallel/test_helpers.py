"""Tasks that this process and helper processes share."""

import contextlib
import multiprocessing
import os
import time

import numpy as np
import pytest

from experiments.parallel.early import together
from experiments.parallel.executors import InlineExecutor, helped
from experiments.parallel.helpers import HelpedExecutor
from experiments.parallel.workers import processors
from trackslip.errors import InvalidValueError, TrackslipError


def slowly(seconds):
    time.sleep(seconds)
    return os.getpid()


def refuse():
    raise InvalidValueError("radii", 0.1, "greater than the half gauge")


def gone():
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    return multiprocessing.active_children() == []


def test_one_thread_needs_no_helper():
    with helped(1) as workers:
        assert isinstance(workers.executor, InlineExecutor)
        begun = workers.begin(KNOWN.append, "asked for")
        assert KNOWN == []
        assert begun() is begun() is None
        assert KNOWN.pop() == "asked for"
        assert KNOWN == []
        workers.prepare(refuse)  # nobody to be prepared
        assert workers.begin(os.getpid)(lambda: pytest.fail("there is nothing to wait for")) == os.getpid()


def test_as_many_as_processors_by_default():
    with helped(0) as workers:
        assert workers.count == processors()


def test_who_waits_does_what_nobody_has_begun():
    with helped(2) as workers:
        assert workers.begin(os.getpid)() != os.getpid()  # the helper is there
        first, second = (workers.begin(slowly, 0.2) for _ in range(2))
        assert first() != os.getpid()
        assert second() == os.getpid()
    assert gone()


def test_meanwhile_something_else_is_done_until_the_result_is_there():
    pieces = []

    def piece():
        pieces.append(time.monotonic())
        time.sleep(0.01)
        return len(pieces) < 5

    with helped(2) as workers:
        workers.begin(os.getpid)()
        assert workers.begin(slowly, 0.5)(piece) != os.getpid()
        assert len(pieces) == 5  # the last one says that there is nothing left
        assert workers.begin(slowly, 0.5)(lambda: bool(time.sleep(0.01)) or True) != os.getpid()  # ends all the same


def test_more_tasks_than_workers_are_all_done():
    with helped(3) as workers:
        begun = [workers.begin(divmod, k, 7) for k in range(50)]
        assert [one() for one in begun] == [divmod(k, 7) for k in range(50)]


def test_helpers_are_prepared_before_their_next_task():
    with helped(2) as workers:
        assert isinstance(workers.executor, HelpedExecutor)
        workers.prepare(remember)
        assert workers.begin(remembered)()
        assert not remembered()


KNOWN = []


def remember():
    KNOWN.append(os.getpid())


def remembered():
    return [os.getpid()] == KNOWN


def test_a_helper_that_dies_is_reported():
    with pytest.raises(TrackslipError, match="a worker died"), helped(2) as workers:
        workers.begin(os._exit, 1)()
    assert gone()


def test_tasks_that_wait_for_a_helper_that_dies_fail_too():
    with helped(2) as workers:
        begun = [workers.begin(os._exit, 1), workers.begin(os.getpid), workers.begin(os.getpid)]
        deadline = time.monotonic() + 10
        while multiprocessing.active_children() and time.monotonic() < deadline:
            time.sleep(0.01)
        workers.prepare(os.getpid)
        for one in begun:
            with pytest.raises(TrackslipError, match="a worker died"):
                one()
        assert workers.begin(os.getpid)() == os.getpid()  # there is still this process
    assert gone()


@pytest.mark.parametrize("threads", [1, 2])
def test_what_a_task_raises_arrives(threads):
    with helped(threads) as workers:
        begun = [workers.begin(refuse) for _ in range(2)]  # in a helper, and here
        for one in begun:
            with pytest.raises(InvalidValueError, match=r"radii = 0\.1: must be greater"):
                one()


def test_helpers_end_with_an_error():
    began = time.monotonic()
    with contextlib.suppress(KeyError), helped(2) as workers:
        workers.begin(time.sleep, 60)
        raise KeyError
    assert gone()
    assert time.monotonic() - began < 30


def test_more_threads_than_there_is_work_for_are_the_engines():
    assert [together(threads) for threads in (1, 2, 12, 13, 1024)] == [1, 2, 12, 12, 12]
    assert together(0) == min(processors(), 12)


def test_results_that_nobody_asks_for_leave_no_file(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with helped(2) as workers:
        workers.begin(np.zeros, 300_000)
        workers.begin(os.getpid)()
    assert gone()
    assert list(tmp_path.iterdir()) == []
