"""The order of a run's rows in time: clocks that restart, stamps that go back."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
import scipy

from trackslip.kinematics import Array

_RESTART = 1.0  # time by which a restarted clock goes back at least [s]
_GLITCH = 4  # largest number of successive rows that are stamped wrongly rather than part of another drive


def restarts(time: Array) -> np.ndarray:
    """Rows (n,) at which the clock (T,) starts anew, because another drive follows under the same name."""
    usual = scipy.ndimage.median_filter(time, size=2 * _GLITCH + 1, mode="reflect")
    return np.flatnonzero(np.diff(usual) < -_RESTART) + 1


def in_order(time: Array) -> np.ndarray:
    """Rows (n,), as many as possible, whose times (T,) ascend."""
    if (np.diff(time) > 0).all():
        return np.arange(len(time))
    ends: list[float] = []  # the earliest end of an ascending chain of each length
    last: list[int] = []  # and its row
    before = np.full(len(time), -1)
    for row, stamp in enumerate(time.tolist()):
        length = bisect_left(ends, stamp)
        before[row] = last[length - 1] if length else -1
        if length == len(ends):
            ends.append(stamp)
            last.append(row)
        elif stamp < ends[length]:
            ends[length], last[length] = stamp, row
    rows = np.empty(len(ends), int)
    row = last[-1] if last else -1
    for k in range(len(ends) - 1, -1, -1):
        rows[k], row = row, before[row]
    return rows
