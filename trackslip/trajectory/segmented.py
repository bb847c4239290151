"""References of straight lines and arcs at piecewise constant acceleration: the paper's path,
circles, stop-and-go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import require_positive
from trackslip.kinematics import Array, advance
from trackslip.trajectory.base import PiecewiseReference
from trackslip.trajectory.path import LIMITS


@dataclass(frozen=True)
class Segment:
    """A piece of constant curvature, driven at constant acceleration."""

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
        poses = [np.asarray(start, float)]
        for s in segments:
            poses.append(advance(poses[-1], [s.length, s.length * s.curvature], 1.0))
        self._start_poses, self._curvatures = (
            np.array(poses[:-1]),
            np.array([s.curvature for s in segments]),
        )
        super().__init__(*np.array([(s.duration, s.start_speed, s.end_speed) for s in segments]).T)

    def pose_in(self, k: NDArray[np.intp], way: Array) -> Array:
        """See PiecewiseReference."""
        return advance(
            self._start_poses[k], np.stack([way, way * self._curvatures[k]], axis=-1), 1.0
        )

    def curvature_in(self, k: NDArray[np.intp], way: Array) -> Array:
        """See PiecewiseReference."""
        return self._curvatures[k]


PAPER_START = (0.0, 0.0, np.pi / 2)  # first pose of the paper's path [m, m, rad]


def paper_reference(start: ArrayLike = PAPER_START) -> SegmentedReference:
    """The verification path of Sec. IV-A, which takes 45.8 s, from the pose `start` (3,).

    The five segments follow the paper's text, which Eqs. 14c-14e contradict.
    """
    speed, yaw_rate = 0.15, 0.12
    turn = 4 * np.pi / 3 - np.pi / 2
    straight, arc = (
        Segment(7.0, speed, speed),
        Segment(turn / yaw_rate, speed, speed, yaw_rate / speed),
    )
    return SegmentedReference(
        start, [Segment(5.0, 0.0, speed), straight, arc, straight, Segment(5.0, speed, 0.0)]
    )


def circle(
    radius: float, speed: float, duration: float, start: ArrayLike = (0.0, 0.0, 0.0)
) -> SegmentedReference:
    """A circle of signed `radius` [m], positive to the left, from pose `start` at `speed` [m/s] for
    `duration` [s].
    """
    require_positive("abs(radius)", abs(radius))
    return SegmentedReference(start, [Segment(duration, speed, speed, 1 / radius)])


def stop_and_go(start: ArrayLike) -> SegmentedReference:
    """2.5 m forwards, a 1.6 m arc backwards and 2.5 m forwards, with 2 s at rest after the first
    two legs.

    `start` (3,) is the first pose. The arc has a radius of 1 m, and its centre is to the left of
    the robot.
    """
    forwards, backwards, stop = _leg(2.5, 0.0, 1.0), _leg(1.6, 1.0, -1.0), Segment(2.0, 0.0, 0.0)
    return SegmentedReference(start, [*forwards, stop, *backwards, stop, *forwards])


def _leg(length: float, curvature: float, direction: float) -> list[Segment]:
    """Segments from rest to rest over `length` [m]: accelerate, cruise and brake."""
    speed = float(LIMITS.speed_at(curvature))
    top, ramp = direction * speed, speed / LIMITS.acceleration
    cruise = Segment(length / speed - ramp, top, top, curvature)
    return [Segment(ramp, 0.0, top, curvature), cruise, Segment(ramp, top, 0.0, curvature)]
