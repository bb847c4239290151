"""A reference that stops, waits and reverses."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require_positive
from trackslip.trajectory.profile import LIMITS, Limits
from trackslip.trajectory.segmented import Segment, SegmentedReference


def stop_and_go(
    start: ArrayLike,
    straight: float = 2.5,
    radius: float = 1.0,
    arc: float = 1.6,
    dwell: float = 2.0,
    limits: Limits = LIMITS,
) -> SegmentedReference:
    """Forwards, a stop, backwards on an arc about a point to the left, a stop, forwards.

    Args:
        start: first pose (3,).
        straight: length of the first and the last piece [m].
        radius: of the arc [m].
        arc: length of the arc [m].
        dwell: duration of each stop [s].
        limits: of speeds and acceleration.
    """
    for name, value in (("straight", straight), ("radius", radius), ("arc", arc), ("dwell", dwell)):
        require_positive(name, value)
    forwards, backwards = _leg(straight, 0.0, 1.0, limits), _leg(arc, 1 / radius, -1.0, limits)
    stop = Segment(dwell, 0.0, 0.0)
    return SegmentedReference(start, [*forwards, stop, *backwards, stop, *forwards])


def _leg(length: float, curvature: float, direction: float, limits: Limits) -> list[Segment]:
    """Segments from rest to rest: accelerate, cruise if the leg is long enough, brake."""
    acceleration = limits.acceleration
    speed = min(float(limits.speed_at(curvature)), float(np.sqrt(acceleration * length)))
    cruise = length / speed - speed / acceleration
    speeds = [0.0, speed, speed, 0.0] if cruise > 0 else [0.0, speed, 0.0]
    durations = [speed / acceleration, cruise, speed / acceleration] if cruise > 0 else [speed / acceleration] * 2
    return [
        Segment(duration, direction * before, direction * after, curvature)
        for duration, (before, after) in zip(durations, pairwise(speeds), strict=True)
    ]
