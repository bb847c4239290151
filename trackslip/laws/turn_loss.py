"""Laws of constant ICRs for robots that lose speed in turns or skid in fast turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry
from trackslip.laws.base import require_between
from trackslip.laws.icr import IcrLaw

# limits on g within which v increases with the belts' mean speed [-]
_MIN_LOSS: Final = -8.0
_MAX_LOSS: Final = 1.0
_MAX_ITERATIONS: Final = 60  # enough for bisections down to rounding
_CONVERGED: Final = 1e-15  # last step, relative to the largest speed


class _SpeedLost(IcrLaw):
    """Base class of laws with the yaw rate of constant ICRs and a speed that turning reduces."""

    offset: float
    turn_loss: float

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = f"between {_MIN_LOSS:g} and {_MAX_LOSS:g}, where sprocket speeds are unique"
        require_between(self, ("turn_loss",), _MIN_LOSS, _MAX_LOSS, allowed)

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        reach = self._reach[..., 0]
        v, difference, loss = np.broadcast_arrays(v, reach * w, self.turn_loss)
        mean = _mean_speed(v, difference, loss)
        belts = mean[..., None] + TRACK_SIGNS * difference[..., None]
        return belts / (geometry.sprocket_radius * self._scale)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        belts = geometry.sprocket_radius * self._scale * np.asarray(omega, float)
        left = belts[..., 0]
        right = belts[..., 1]
        mean = (right + left) / 2
        difference = (right - left) / 2
        v = mean * (1 - self.turn_loss * _sine(difference, mean) ** 2)
        w = difference / self._reach[..., 0]
        return np.stack(np.broadcast_arrays(v, w), axis=-1)


@dataclass(frozen=True)
class TurnLoss(_SpeedLost):
    """The law of constant ICRs and a loss of speed in turns, as in fast skid-steered robots.

    With belt speeds V = (1 + epsilon) r omega, their mean s and half their difference d,

        w = d / (b + D)        v = s (1 - g sin^2 theta)        tan theta = d / s

    With g = 0, the law is that of constant ICRs.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    turn_loss: float = 0.0
    """g: share of the speed that is lost when turning about the robot's centre [-]."""


@dataclass(frozen=True)
class TurnLossSides(_SpeedLost):
    """TurnLoss with an epsilon for each side, for robots that pull to one side, as with unequally
    inflated tyres.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    radius_error_left: float
    """epsilon of the left sprocket [-]."""
    radius_error_right: float
    """epsilon of the right sprocket [-]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    turn_loss: float = 0.0
    """g: share of the speed that is lost when turning about the robot's centre [-]."""

    radius_errors = ("radius_error_left", "radius_error_right")


@dataclass(frozen=True)
class Centrifugal(TurnLoss):
    """TurnLoss with slip in proportion to the lateral acceleration, as for fast robots on ice.

    If (v', w') is the twist that the belt speeds produce under TurnLoss,

        v' = v (1 + k |v w|)        w' = w (1 + k |v w|)

    Friction that holds the robot on its curve can't also drive it, so the robot skids more slowly
    along the same curve.
    """

    centrifugal_slip: float = 0.0
    """k: slip per lateral acceleration [s^2/m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # negative values only for finite differences at 0
        require_between(self, ("centrifugal_slip",), -0.01, np.inf, "finite and >= 0")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...) in the limit of slow driving."""
        slow = TurnLoss(self.offset, self.half_gauge, self.radius_error, self.turn_loss)
        return slow(kappa)

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2)."""
        twist = np.asarray(twist, float)
        lateral_acceleration = np.abs(twist[..., 0] * twist[..., 1])
        factor = 1 + np.asarray(self.centrifugal_slip) * lateral_acceleration
        return super().sprocket_speeds(factor[..., None] * twist, geometry)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce.

        The factor q = 1 + k |v w| is the only real root of q^3 - q^2 = p with p = k |v' w'|, which
        is v' w' = q^2 v w inserted in its definition. By Viete's formula, q - 1 =
        2 / 3 (cosh(2 / 3 arcsinh(sqrt(27 p / 4))) - 1).
        """
        slow = super().twist(omega, geometry)
        p = np.asarray(self.centrifugal_slip) * np.abs(slow[..., 0] * slow[..., 1])
        angle = np.arcsinh(np.sqrt(27 / 4 * np.abs(p)))
        excess = 2 / 3 * (np.cosh(2 / 3 * angle) - 1)
        factor = 1 + np.copysign(excess, p)
        return np.asarray(slow / factor[..., None])


def _sine(difference: Array, mean: Array) -> Array:
    """sin theta (...) from half the belt speed differences (...) and the mean belt speeds (...); 0
    at rest.
    """
    size = np.hypot(difference, mean)
    return difference / np.where(size == 0, 1.0, size)


def _mean_speed(v: Array, difference: Array, loss: Array) -> Array:
    """Mean belt speeds s (...) with s (1 - g sin^2 theta) = v, only real roots of s^3 - v s^2 + (1
    - g) d^2 s - v d^2.

    Newton's method is applied to the first equation, whose left side increases with s; its slope is
    1 - g sin^2 theta (2 sin^2 theta - 1). A step that leaves the interval known to contain the root
    is replaced by a bisection. The root is between v, where the robot doesn't turn, and v / (1 -
    g), where it turns in place.
    """
    # all speeds forwards, relative to the largest of each
    size = np.maximum(np.abs(v), np.abs(difference))
    size = np.where(size == 0, 1.0, size)
    goal = np.abs(v) / size
    d = np.abs(difference) / size

    in_place = goal / (1 - loss)
    low = np.minimum(goal, in_place)
    high = np.maximum(goal, in_place)
    mean = goal
    for _ in range(_MAX_ITERATIONS):
        sine = _sine(d, mean)
        missed = mean * (1 - loss * sine**2) - goal
        low = np.where(missed < 0, mean, low)
        high = np.where(missed > 0, mean, high)
        slope = 1 - loss * sine**2 * (2 * sine**2 - 1)
        newton = mean - missed / slope
        stays = (newton >= low) & (newton <= high)
        before = mean
        mean = np.where(stays, newton, (low + high) / 2)
        step = np.abs(mean - before)
        if step.max(initial=0.0) < _CONVERGED:
            break
    return np.copysign(mean, v) * size
