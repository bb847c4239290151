"""Whether a robot moved steadily while its sprockets did."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.motion.arc import MIN_ARC_POSES, arc
from trackslip.motion.steady import SteadyPart

_MIN_HALF = 2 * MIN_ARC_POSES  # valid poses in a half that say something
_SIGNIFICANT = 6.0  # difference between the halves [standard errors]
_CHANGE = 0.05  # of the twist that matters, relative to it
_TURNING = 0.2  # curvature [1/m], and radius [m], of turns too wide or too tight to be told from none


def require_steady_motion(part: SteadyPart) -> None:
    """Hold the first half of a steady part against the second.

    Raises:
        LogError: where the robot's twist changes though its sprockets' speeds don't, as when it drives onto other
            ground or against something.
    """
    begin, end = part.window
    middle = (begin + end) / 2
    halves = (part.rows & part.log.is_valid & (late == (part.log.time > middle)) for late in (False, True))
    if min(half.sum() for half in halves) < _MIN_HALF:
        return  # too few to tell
    first, second = arc(part.log, (begin, middle)), arc(part.log, (middle, end))
    change = second.twist - first.twist
    error = np.sqrt(np.diag(first.covariance + second.covariance))
    significant = np.abs(change) > _SIGNIFICANT * error
    v, w = np.abs(np.stack([first.twist, second.twist])).max(axis=0)
    size = np.array([v + _TURNING * w, w + _TURNING * v])
    if (significant & (np.abs(change) > _CHANGE * size)).any():
        v, w = change
        raise LogError(
            f"run {part.log.run!r}: its sprockets are steady from {begin:g} s to {end:g} s, its motion isn't: "
            f"v changes by {v:+.3g} m/s and w by {w:+.3g} rad/s from the first half to the second"
        )
