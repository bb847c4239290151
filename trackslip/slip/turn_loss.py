"""Constant ICRs of a robot that loses speed in turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array, RobotGeometry
from trackslip.slip.base import require_between
from trackslip.slip.icr import IcrLaw

_MIN_LOSS, _MAX_LOSS = -8.0, 1.0  # between these, v grows with the belts' mean speed at every difference
_ITERATIONS = 60
_CONVERGED = 1e-15  # last step, relative to the twist


@dataclass(frozen=True)
class TurnLoss(IcrLaw):
    """The yaw rate of constant ICRs, and a speed that turning diminishes, as seen with fast skid-steered robots.

    With the belts' speeds V = (1 + epsilon) r omega, their mean s and half their difference d,

        w = d / (b + D)        v = s (1 - g sin^2 theta)        tan theta = d / s

    With g = 0 it is the constant ICR.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    turn_loss: float = 0.0
    """g: share of the speed that is lost in a turn about the middle of the robot [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = f"between {_MIN_LOSS:g} and {_MAX_LOSS:g}, where sprocket speeds are unique"
        require_between(self, ("turn_loss",), _MIN_LOSS, _MAX_LOSS, allowed)

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce a twist (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        reach, scale = np.asarray(self.half_gauge + np.asarray(self.offset)), 1 + np.asarray(self.radius_error)
        v, difference, loss, scale = np.broadcast_arrays(v, reach * w, self.turn_loss, scale)
        mean = _mean_speed(v, difference, loss)
        return (mean[..., None] + SIDES * difference[..., None]) / (geometry.sprocket_radius * scale[..., None])

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        belt = geometry.sprocket_radius * (1 + np.asarray(self.radius_error)[..., None]) * np.asarray(omega, float)
        mean, difference = (belt[..., 1] + belt[..., 0]) / 2, (belt[..., 1] - belt[..., 0]) / 2
        v = mean * (1 - self.turn_loss * _sine(difference, mean) ** 2)
        return np.stack(np.broadcast_arrays(v, difference / (self.half_gauge + np.asarray(self.offset))), axis=-1)


def _sine(difference: Array, mean: Array) -> Array:
    """sin theta (...) of belts' half differences and mean speeds (...); 0 at rest."""
    size = np.hypot(difference, mean)
    return difference / np.where(size == 0, 1.0, size)


def _mean_speed(v: Array, difference: Array, loss: Array) -> Array:
    """The s (...) with s (1 - g sin^2 theta) = v: the only real root of s^3 - v s^2 + (1 - g) d^2 s - v d^2.

    Newton's method on the speed itself, which grows with s; a step that leaves the interval known to hold the root is
    replaced by a bisection.
    """
    size = np.maximum(np.abs(v), np.abs(difference))
    size = np.where(size == 0, 1.0, size)
    goal, d = np.abs(v) / size, np.abs(difference) / size
    ends = goal, goal / (1 - loss)
    low, high = np.minimum(*ends), np.maximum(*ends)
    mean = goal
    for _ in range(_ITERATIONS):
        sine = _sine(d, mean)
        missed = mean * (1 - loss * sine**2) - goal
        low, high = np.where(missed < 0, mean, low), np.where(missed > 0, mean, high)
        slope = 1 - loss * sine**2 * (2 * sine**2 - 1)
        newton = mean - missed / slope
        following = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        step, mean = np.abs(following - mean), following
        if step.max(initial=0.0) < _CONVERGED:
            break
    return np.copysign(mean, v) * size
