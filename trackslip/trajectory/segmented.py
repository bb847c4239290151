"""References of straight lines and arcs: the paper's path, circles, stop-and-go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import require_positive
from trackslip.kinematics import Array, advance
from trackslip.trajectory.base import PiecewiseReference
from trackslip.trajectory.path import LIMITS

PAPER_START: Final = (0.0, 0.0, np.pi / 2)
"""First pose of the paper's path [m, m, rad]."""


@dataclass(frozen=True)
class Segment:
    """A straight line or an arc, driven at constant acceleration."""

    duration: float  # time from the start to the end of the segment [s]
    start_speed: float  # speed at the start [m/s]
    end_speed: float  # speed at the end [m/s]
    curvature: float = 0.0  # positive to the left [1/m]

    def __post_init__(self) -> None:
        require_positive("duration", self.duration)

    @property
    def length(self) -> float:
        """Signed path length [m]."""
        return (self.start_speed + self.end_speed) / 2 * self.duration


class SegmentedReference(PiecewiseReference):
    """A sequence of straight lines and arcs, with pose and twist in closed form."""

    def __init__(self, start: ArrayLike, segments: Sequence[Segment]) -> None:
        """Join the segments, the first from the pose `start` (3,)."""
        start_poses = []
        pose = np.asarray(start, float)
        for segment in segments:
            start_poses.append(pose)
            turn = segment.length * segment.curvature
            pose = advance(pose, [segment.length, turn], 1.0)
        self._start_poses = np.array(start_poses)  # (K, 3)
        self._curvatures = np.array([segment.curvature for segment in segments])  # (K,)
        super().__init__(
            [segment.duration for segment in segments],
            [segment.start_speed for segment in segments],
            [segment.end_speed for segment in segments],
        )

    def pose_in(self, k: NDArray[np.intp], distance: Array) -> Array:
        """See PiecewiseReference."""
        turn = distance * self._curvatures[k]
        return advance(self._start_poses[k], np.stack([distance, turn], axis=-1), 1.0)

    def twist_in(self, k: NDArray[np.intp], distance: Array, speed: Array) -> Array:
        """See PiecewiseReference."""
        return np.stack([speed, speed * self._curvatures[k]], axis=-1)


def paper_reference(start: ArrayLike = PAPER_START) -> SegmentedReference:
    """The verification path of Sec. IV-A, which takes 45.8 s, from the pose `start` (3,).

    The five segments follow the paper's text, which Eqs. 14c-14e contradict.
    """
    speed = 0.15
    yaw_rate = 0.12
    turn = 4 * np.pi / 3 - np.pi / 2
    accelerate = Segment(5.0, 0.0, speed)
    straight = Segment(7.0, speed, speed)
    arc = Segment(turn / yaw_rate, speed, speed, yaw_rate / speed)
    brake = Segment(5.0, speed, 0.0)
    return SegmentedReference(start, [accelerate, straight, arc, straight, brake])


def circle(
    radius: float, speed: float, duration: float, start: ArrayLike = (0.0, 0.0, 0.0)
) -> SegmentedReference:
    """A circle of signed `radius` [m], positive to the left, at `speed` [m/s] for `duration` [s].

    `start` (3,) is the first pose.
    """
    require_positive("abs(radius)", abs(radius))
    return SegmentedReference(start, [Segment(duration, speed, speed, 1 / radius)])


def stop_and_go(start: ArrayLike) -> SegmentedReference:
    """2.5 m forwards, a 1.6 m arc backwards and 2.5 m forwards, with 2 s at rest in between.

    `start` (3,) is the first pose. The arc has a radius of 1 m, and its centre is to the left of
    the robot.
    """
    forwards = _leg(2.5, 0.0, 1.0)
    backwards = _leg(1.6, 1.0, -1.0)
    stop = Segment(2.0, 0.0, 0.0)
    return SegmentedReference(start, [*forwards, stop, *backwards, stop, *forwards])


def _leg(length: float, curvature: float, direction: float) -> list[Segment]:
    """Segments from rest to rest over `length` [m]: accelerate, cruise and brake."""
    speed = float(LIMITS.speed_at(curvature))
    velocity = direction * speed
    ramp = speed / LIMITS.acceleration
    accelerate = Segment(ramp, 0.0, velocity, curvature)
    cruise = Segment(length / speed - ramp, velocity, velocity, curvature)
    brake = Segment(ramp, velocity, 0.0, curvature)
    return [accelerate, cruise, brake]
