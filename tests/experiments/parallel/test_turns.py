import os
import time

import pytest

from experiments.parallel.executors import WorkersFailedError
from experiments.parallel.turns import take_turns
from trackslip.errors import InvalidValueError


def count(pieces, fail=None):
    """So many pieces of work; returns its process and when it had its turns."""
    turns = []
    for k in range(pieces):
        turns.append(time.monotonic())
        if fail is not None and k > 0:
            fail()
        yield (k + 1) / pieces
    return os.getpid(), turns


def refuse():
    raise InvalidValueError("duration", 0, "positive")


def die():
    os._exit(1)


def test_each_has_a_process_of_its_own_and_the_least_done_is_next():
    done = [[], []]
    (first, few), (second, many) = take_turns(count, [(2,), (6,)], lambda k, share: done[k].append(share))
    assert len({first, second, os.getpid()}) == 3
    assert few[0] < many[0] < min(few[1], many[1])
    assert many[2] < few[1] < many[4]  # a half of the one after a half of the other
    assert [sum(shares) for shares in done] == pytest.approx([1.0, 1.0])


def test_what_the_work_raises_is_raised():
    with pytest.raises(InvalidValueError, match="duration"):
        take_turns(count, [(3,), (3, refuse)])


def test_a_process_that_dies_is_named():
    with pytest.raises(WorkersFailedError, match=r"the process of \(3, "):
        take_turns(count, [(3,), (3, die)])
