"""The servos: speeds that follow their set points with a lag, and angles with a limited rate.

The servo of a sprocket compensates its load: if the motor is strong enough, the speed w follows the
set point s as a first-order lag, whatever the ground does,

    dw/dt = (s - w) / lag.

The error e = w - s therefore decays, and its mean over a period P is known, too:

    e(t + P) = e(t) exp(-P / lag),
    mean     = e(t) (1 - exp(-P / lag)) lag / P.

If a motor is too weak, its servo goes on from the speed that the sprocket really has.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array
from trackslip.restorable import Restorable

FLIPPER_SPEED: Final = 1.5
"""Largest speed of the set points of flippers [rad/s]."""


class Servo(Restorable):
    """Speed servos of the (left, right) sprockets or belts of N robots, in any unit of speed."""

    STATE = ("set_point", "error", "_decay", "_mean_decay")

    def __init__(self, size: int, lag: float, period: float, top_speed: float) -> None:
        """Start at rest; `lag` is the time constant and `period` the servo's sampling period [s],
        `top_speed` the largest set point.
        """
        self.top_speed = top_speed
        self._period = period
        self.set_point: Array = np.zeros((size, 2))
        """Set points (N, 2)."""
        # stored because it decays without rounding errors
        self.error: Array = np.zeros((size, 2))
        """Speeds minus set points (N, 2)."""
        self._decay: Array = np.empty((size, 1))
        self._mean_decay: Array = np.empty((size, 1))
        self.begin(np.arange(size), [lag] * size)

    @property
    def speed(self) -> Array:
        """Speeds (N, 2)."""
        return self.set_point + self.error

    def begin(self, rows: NDArray[np.int_], lag: Sequence[float]) -> None:
        """Reset the servos of the robots `rows` (R,) to rest, with time constants `lag` (R,)
        [s].
        """
        self.set_point[rows] = 0.0
        self.error[rows] = 0.0
        period = self._period
        for row, value in zip(rows, lag, strict=True):
            self._decay[row] = np.exp(-period / value)
            self._mean_decay[row] = -np.expm1(-period / value) * value / period

    def of(self, rows: NDArray[np.int_]) -> Servo:
        """Copy the servos of the robots `rows` (R,)."""
        part = copy.copy(self)
        for name in self.STATE:
            setattr(part, name, getattr(self, name)[rows])
        return part

    def put(self, rows: NDArray[np.int_], part: Servo) -> None:
        """Set the servos of the robots `rows` (R,) to those in `part`."""
        for name in self.STATE:
            getattr(self, name)[rows] = getattr(part, name)

    def command(self, speed: Array) -> None:
        """Change the set points (N, 2), which are clipped to the top speed."""
        # takes a third of np.clip's time
        limited = np.minimum(np.maximum(speed, -self.top_speed), self.top_speed)
        self.error += self.set_point - limited
        self.set_point[:] = limited

    def errors(self, periods: int) -> Array:
        """Errors (P + 1, N, 2) now and at the end of each of the next P periods."""
        errors = np.empty((periods + 1, *self.error.shape))
        errors[0] = self.error
        errors[1:] = self._decay
        # bitwise identical for any number of periods
        np.multiply.accumulate(errors, axis=0, out=errors)
        return errors

    def means(self, errors: Array) -> Array:
        """Mean speeds (P, N, 2) in the periods that begin and end with `errors` (P + 1, N, 2)."""
        return errors[:-1] * self._mean_decay + self.set_point

    def advance(self) -> Array:
        """Advance by a period; return the mean speeds (N, 2) in it."""
        mean = self.error * self._mean_decay + self.set_point
        self.error = self.error * self._decay
        return mean

    def correct(self, where: NDArray[np.bool_], speed: Array) -> None:
        """Go on from the speeds (N, 2) `where` (N, 2) motors were too weak to follow."""
        self.error = np.where(where, speed - self.set_point, self.error)


class FlipperServo(Restorable):
    """Set points of the motors of F flippers on each of N robots, which change at a limited
    rate.
    """

    STATE = ("angle", "_goal")

    def __init__(self, size: int, flippers: int) -> None:
        self.angle: Array = np.zeros((size, flippers))
        """Set points (N, F) for the flippers' motors [rad]."""
        self._goal = self.angle.copy()

    def begin(self, rows: NDArray[np.int_], angle: Array) -> None:
        """Set the flippers of the robots `rows` (R,) to the angles `angle` (F,) [rad]."""
        self.angle[rows] = angle
        self._goal[rows] = angle

    def command(self, angle: Array) -> None:
        """Change the angles (N, F) that the set points approach [rad]."""
        self._goal = np.array(angle, float)

    def advance(self, duration: float) -> None:
        """Advance by a `duration` [s]."""
        largest = FLIPPER_SPEED * duration
        self.angle += np.clip(self._goal - self.angle, -largest, largest)
