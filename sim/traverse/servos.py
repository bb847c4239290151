"""Servos of belts and flippers of robots on courses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.restorable import Restorable
from trackslip.errors import Checked, checked, require_positive
from trackslip.kinematics import Array

MAX_SPEED = 5.0
"""Largest belt speed that servos may have [m/s]."""


@dataclass(frozen=True)
class Servos(Checked):
    """Servos of a robot's belts and flippers."""

    lag: float = checked(0.05, require_positive, 1.0, "s")
    """Time constant of the belts' speed [s]."""
    top_speed: float = checked(0.6, require_positive, MAX_SPEED, "m/s")
    """Largest belt speed [m/s]."""
    flipper_speed: float = checked(1.5, require_positive, 100.0, "rad/s")
    """Largest angular speed of a flipper's set point [rad/s]."""


class ServoState(Restorable):
    """Servos of N robots with F flippers each."""

    STATE = ("speed", "angle", "_speed_goal", "_angle_goal")

    def __init__(self, servos: Servos, size: int, flippers: int) -> None:
        self._servos = servos
        self.speed: Array = np.zeros((size, 2))  # belt speeds (N, 2), left and right [m/s]
        self.angle: Array = np.zeros((size, flippers))  # set points (N, F) that the flippers' motors have [rad]
        self._speed_goal, self._angle_goal = self.speed.copy(), self.angle.copy()

    def begin(self, rows: NDArray[np.int_], angle: Array) -> None:
        """Reset the robots `rows` (R,) to rest, with flippers at angles (F,) [rad]."""
        self.speed[rows] = self._speed_goal[rows] = 0.0
        self.angle[rows] = self._angle_goal[rows] = angle

    def command(self, speed: Array, angle: Array) -> None:
        """Set the set points: belt speeds (N, 2) [m/s], clipped to the top speed, and flipper angles (N, F) [rad]."""
        top = self._servos.top_speed
        self._speed_goal = np.clip(speed, -top, top)
        self._angle_goal = np.array(angle, float)

    def advance(self, duration: float) -> Array:
        """Mean belt speeds (N, 2) in the next `duration` [s], after which the servos are at its end [m/s]."""
        lag = self._servos.lag
        short = self.speed - self._speed_goal
        self.speed = self._speed_goal + short * np.exp(-duration / lag)
        largest = self._servos.flipper_speed * duration
        self.angle += np.clip(self._angle_goal - self.angle, -largest, largest)
        return self._speed_goal - short * (np.expm1(-duration / lag) * lag / duration)
