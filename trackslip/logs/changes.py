"""Counts and angles that are changes since the last reading, not sums."""

from __future__ import annotations

from typing import Final

import numpy as np

from trackslip.kinematics import Array

_FEWEST: Final = 100  # least number of steps that tell
# share of steps to the other side than the step before: 3/4 for changes that are rounded to whole
# ticks, and few for sums, which go on in one direction until the robot reverses
_ALTERNATING: Final = 0.5
# largest range of changes, in root mean squares of their steps: sums leave any range
_WIDEST: Final = 100.0


def are_changes(readings: Array) -> bool:
    """True if readings (n,) are clearly changes since the reading before: rounded to whole ticks,
    they go up and down from row to row, and stay within a narrow range.

    The steps of sums are the motion from reading to reading, which keeps its sign. The steps of
    changes are differences of motions, in which rounding dominates.
    """
    step = np.diff(readings)
    moving = step[step != 0]
    if len(moving) < _FEWEST:
        return False
    alternating = float(np.mean(moving[1:] * moving[:-1] < 0))
    size = float(np.sqrt(np.mean(step**2)))
    return alternating > _ALTERNATING and float(np.ptp(readings)) < _WIDEST * size
