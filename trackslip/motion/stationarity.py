"""Checks that a robot moved steadily while its sprockets did."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.motion.arc import MIN_ARC_POSES, arc
from trackslip.motion.steady import SteadyPart

_MIN_HALF = 2 * MIN_ARC_POSES  # minimum number of valid poses in each half
_SIGNIFICANT = 6.0  # significant difference between the halves [standard errors]
_CHANGE = 0.05  # relevant relative change of the twist
_TURNING = 0.2  # curvature [1/m] of nearly straight paths, and radius [m] of turns nearly in place


def require_steady_motion(part: SteadyPart) -> None:
    """Compare the first half of a steady part with the second.

    Raises:
        LogError: if the twist changes although the sprocket speeds do not, for example because the robot drives onto
            other ground or against an obstacle.
    """
    begin, end = part.window
    middle = (begin + end) / 2
    halves = (part.rows & part.log.is_valid & (late == (part.log.time > middle)) for late in (False, True))
    if min(half.sum() for half in halves) < _MIN_HALF:
        return  # too few to compare
    first, second = arc(part.log, (begin, middle)), arc(part.log, (middle, end))
    change = second.twist - first.twist
    error = np.sqrt(np.diag(first.covariance + second.covariance))
    significant = np.abs(change) > _SIGNIFICANT * error
    v, w = np.abs(np.stack([first.twist, second.twist])).max(axis=0)
    size = np.array([v + _TURNING * w, w + _TURNING * v])
    if (significant & (np.abs(change) > _CHANGE * size)).any():
        v, w = change
        raise LogError(
            f"run {part.log.run!r}: its sprockets are steady from {begin:g} s to {end:g} s, but its motion is not: "
            f"v changes by {v:+.3g} m/s and w by {w:+.3g} rad/s from the first half to the second"
        )
