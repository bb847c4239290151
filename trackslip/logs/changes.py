"""Counts and angles that are changes since the last reading, not sums."""

from __future__ import annotations

from typing import Final

import numpy as np

from trackslip.kinematics import Array

_FEWEST_STEPS: Final = 100  # fewer don't tell (test_changes)
# share of steps to the other side than the step before. Where rounding dominates, steps are second
# differences of independent errors, whose successive values have the correlation -2/3: a share of
# acos(-2/3) / pi = 0.73 alternates. Sums go on in one direction until the robot reverses.
_ALTERNATING: Final = 0.5
# largest range of changes, in root mean squares of their steps: sums leave any range (test_changes)
_WIDEST_RANGE: Final = 100.0


def are_changes(readings: Array) -> bool:
    """True if readings (n,) are clearly changes since the reading before: rounded to whole ticks,
    they go up and down from row to row, and stay within a narrow range.

    The steps of sums are the motion from reading to reading, which keeps its sign. The steps of
    changes are differences of motions, in which rounding dominates.
    """
    step = np.diff(readings)
    moving = step[step != 0]
    if len(moving) < _FEWEST_STEPS:
        return False
    alternating = float(np.mean(moving[1:] * moving[:-1] < 0))
    step_rms = float(np.sqrt(np.mean(step**2)))
    return alternating > _ALTERNATING and float(np.ptp(readings)) < _WIDEST_RANGE * step_rms
