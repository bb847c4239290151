"""Turns on the spot as parts of references, and which references contain them."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.trajectory.base import PiecewiseReference, Reference
from trackslip.trajectory.path import MotionLimits

_SAMPLING_PERIOD: Final = 0.05  # period at which references are searched for turns [s]


class TurnOnTheSpot(PiecewiseReference):
    """A turn about the robot's centre, from rest to rest, with v = 0.

    The yaw rate grows at a constant rate up to its limit, is constant, and falls again, like the
    speed along a straight. It reaches its limit in the same time as the speed.
    """

    def __init__(self, start: ArrayLike, angle: float, limits: MotionLimits) -> None:
        """Turn by `angle` [rad], not 0, positive to the left, from the pose `start` (3,)."""
        self._start = np.asarray(start, float)
        top_rate = limits.yaw_rate
        if limits.half_gauge > 0:
            top_rate = min(top_rate, limits.track_speed / limits.half_gauge)
        yaw_acceleration = limits.yaw_rate * limits.acceleration / limits.speed
        # a short turn ends before the yaw rate reaches its limit
        rate = min(top_rate, np.sqrt(yaw_acceleration * abs(angle)))
        ramp = rate / yaw_acceleration
        coasting = abs(angle) / rate - ramp

        rate = np.copysign(rate, angle)
        durations = [ramp, coasting, ramp]
        start_rates = [0.0, rate, rate]
        end_rates = [rate, rate, 0.0]
        is_cell = np.array(durations) > 0
        cells = np.array([durations, start_rates, end_rates])[:, is_cell]
        super().__init__(*cells)
        angles = cells[0] * (cells[1] + cells[2]) / 2
        self._angles = np.concatenate([[0.0], np.cumsum(angles)])  # at the starts of the cells

    def pose_in(self, k: NDArray[np.intp], distance: Array) -> Array:
        """See PiecewiseReference."""
        turned = self._angles[k] + distance
        return self._start + turned[..., None] * np.array([0.0, 0.0, 1.0])

    def twist_in(self, k: NDArray[np.intp], distance: Array, speed: Array) -> Array:
        """See PiecewiseReference."""
        return np.stack([np.zeros_like(speed), speed], axis=-1)


class Turn(NamedTuple):
    """Place and time of a turn on the spot."""

    time: float  # [s]
    x: float  # [m]
    y: float  # [m]

    def __str__(self) -> str:
        return f"({self.x:.3g}, {self.y:.3g}) after {self.time:.1f} s"


def turns_of(reference: Reference) -> list[Turn]:
    """The turns on the spot of a reference in the order of their times, to a period of 0.05 s."""
    time = np.arange(0.0, reference.duration, _SAMPLING_PERIOD)
    v, w = np.moveaxis(reference.twist(time), -1, 0)
    is_turning = (v == 0) & (w != 0)
    starts = np.flatnonzero(is_turning & ~np.insert(is_turning, 0, False)[:-1])
    poses = reference.pose(time[starts])
    return [Turn(float(time[k]), *pose[:2].tolist()) for k, pose in zip(starts, poses, strict=True)]


def require_turns(reference: Reference, field: str, name: str, follower: object, able: str) -> None:
    """Raise InvalidValueError if a reference turns on the spot and `follower` can't.

    A controller or law can, unless its attribute `turns_on_the_spot` is false. `able` names those
    that can.
    """
    if getattr(follower, "turns_on_the_spot", True):
        return
    turns = turns_of(reference)
    if turns:
        allowed = f"one that can turn on the spot, as the path does at {turns[0]}: {able}"
        raise InvalidValueError(field, name, allowed)
