"""Checks on the rows of a run: restarted clocks, gaps, stamps that go back, wrapped headings."""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

import numpy as np
import scipy

from trackslip.errors import LogError
from trackslip.kinematics import Array

# longest time from a row to the next in a drive: longer than in any log of a driving robot [s]
LONGEST_STEP: Final = 10.0
_RESTART: Final = 1.0  # least time by which a restarted clock goes back [s]
# most successive rows that may have wrong stamps; a longer series belongs to another drive
_GLITCH: Final = 4


def restarts(time: Array) -> np.ndarray:
    """Rows (n,) at which the clock `time` (T,) restarts because another drive with the same name
    begins.
    """
    usual = scipy.ndimage.median_filter(time, size=2 * _GLITCH + 1, mode="reflect")
    return np.flatnonzero(np.diff(usual) < -_RESTART) + 1


def gaps(time: Array, run: str) -> np.ndarray:
    """Rows (n,) before which the ascending clock `time` (T,) goes on by more than LONGEST_STEP:
    another drive begins, or the clock was set.

    Time grids are laid out only within drives, so that the number of rows limits their size. Raises
    LogError if most steps are that long, as in other units.
    """
    step = np.diff(time)
    if len(step) and np.median(step) > LONGEST_STEP:
        raise LogError(
            f"run {run!r}: t rises by {np.median(step):.3g} per row: are these ms or ns? It must "
            "be in seconds"
        )
    return np.flatnonzero(step > LONGEST_STEP) + 1


def unwrapped_headings(heading: Array) -> Array:
    """Headings (n,) without jumps by whole turns; unchanged if range and steps show that they are
    not in radians.
    """
    step = np.abs(np.diff(heading))
    turns = step[step > np.pi]
    if not len(turns) or np.ptp(heading) < 2 * np.pi + 0.1:
        return np.unwrap(heading)
    # jumps by a whole turn, at few of the rows
    are_circles = np.median(np.abs(turns - 2 * np.pi)) < 1.0
    is_wrapped = are_circles and len(turns) < 0.1 * len(step)
    return np.unwrap(heading) if is_wrapped else heading


def in_order(time: Array) -> np.ndarray:
    """Rows (n,) of the longest strictly ascending subsequence of `time` (T,)."""
    if (np.diff(time) > 0).all():  # nearly always, and the search below takes a step per row
        return np.arange(len(time))
    ends: list[float] = []  # the earliest end among ascending chains of each length
    last: list[int] = []  # the row of that end
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
