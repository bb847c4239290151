"""Straight lines and arcs at piecewise constant acceleration: the paper's path, circles, stopping and reversing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array, advance
from trackslip.trajectory.path import cell
from trackslip.trajectory.profile import LIMITS, Limits


@dataclass(frozen=True)
class Segment:
    """A piece of constant curvature, driven at constant acceleration."""

    duration: float
    """Time from its start to its end [s]."""
    start_speed: float
    """Speed at its start [m/s]."""
    end_speed: float
    """Speed at its end [m/s]."""
    curvature: float = 0.0
    """Curvature, positive to the left [1/m]."""

    def __post_init__(self) -> None:
        require_positive("duration", self.duration)

    @property
    def length(self) -> float:
        """Signed path length [m]."""
        return (self.start_speed + self.end_speed) / 2 * self.duration


class SegmentedReference:
    """Straight lines and arcs in sequence, with pose and twist in closed form."""

    def __init__(self, start: ArrayLike, segments: Sequence[Segment]) -> None:
        """`start` is the first pose (3,); raises InvalidValueError without segments."""
        if not segments:
            raise InvalidValueError("segments", segments, "at least one segment")
        poses = [np.asarray(start, float)]
        for s in segments:
            poses.append(advance(poses[-1], [s.length, s.length * s.curvature], 1.0))
        self._start_poses = np.array(poses[:-1])  # (S, 3)
        self._start_times = np.concatenate([[0.0], np.cumsum([s.duration for s in segments])])  # (S + 1,)
        self._start_speeds = np.array([s.start_speed for s in segments])
        self._accelerations = np.array([(s.end_speed - s.start_speed) / s.duration for s in segments])
        self._curvatures = np.array([s.curvature for s in segments])

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""
        return float(self._start_times[-1])

    @property
    def knots(self) -> Array:
        """Times (S + 1,) between which the twist is smooth [s]."""
        return self._start_times

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        k, t = self._locate(time)
        distance = self._start_speeds[k] * t + self._accelerations[k] * t**2 / 2
        motion = np.stack([distance, distance * self._curvatures[k]], axis=-1)
        return advance(self._start_poses[k], motion, 1.0)

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        k, t = self._locate(time)
        time = np.asarray(time, float)
        speed = self._start_speeds[k] + self._accelerations[k] * t
        speed = np.where((time < 0) | (time >= self.duration), 0.0, speed)
        return np.stack([speed, speed * self._curvatures[k]], axis=-1)

    def _locate(self, time: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Index of the segment and time since its start, each (...)."""
        clipped: Array = np.clip(np.asarray(time, float), 0.0, self.duration)
        k = cell(self._start_times, clipped)
        return k, clipped - self._start_times[k]


PAPER_START = (0.0, 0.0, np.pi / 2)
"""First pose of the paper's path [m, m, rad]."""


def paper_reference(start: ArrayLike = PAPER_START) -> SegmentedReference:
    """The verification path of Sec. IV-A: 45.8 s, from `start` (3,).

    The five segments follow the description in words, which Eqs. 14c-14e contradict.
    """
    speed, yaw_rate = 0.15, 0.12
    turn = 4 * np.pi / 3 - np.pi / 2
    straight, arc = Segment(7.0, speed, speed), Segment(turn / yaw_rate, speed, speed, yaw_rate / speed)
    return SegmentedReference(start, [Segment(5.0, 0.0, speed), straight, arc, straight, Segment(5.0, speed, 0.0)])


def circle(radius: float, speed: float, duration: float, start: ArrayLike = (0.0, 0.0, 0.0)) -> SegmentedReference:
    """A circle of signed `radius` [m] (positive to the left), from `start`, at `speed` [m/s] for `duration` [s]."""
    require_positive("abs(radius)", abs(radius))
    return SegmentedReference(start, [Segment(duration, speed, speed, 1 / radius)])


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
