"""The motors of a robot's drive as those of its belts on terrain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.drive.drive import Drive
from sim.robot.tracked import TrackedRobot
from trackslip.kinematics import Array

_ROUNDING = 1 + 1e-6


@dataclass(frozen=True)
class BeltMotors:
    """A motor for each belt."""

    drive: Drive
    """Motors, gears and current limits."""
    radius: float
    """Radius of the sprockets [m]."""

    @classmethod
    def of(cls, robot: TrackedRobot) -> BeltMotors | None:
        """The motors of a robot; None if its file states none: its belts have the speeds of their servos at once."""
        return None if robot.drive == Drive() else cls(robot.drive, robot.sprocket_radius)

    def at(self, speeds: Array, goal: Array) -> dict[str, Any]:
        """Limits (..., T) of belts that have speeds (..., T) and shall have those of `goal` (..., T) [m/s].

        They are options of `Belts.set`. The friction of the gears helps belts that are too fast, and the line of torque
        over speed limits the others.
        """
        omega, friction = np.abs(speeds) / self.radius, self.drive.motor.friction
        drives = np.clip(self.drive.torque_range(omega)[1] - friction, 0.0, None)
        too_fast = np.abs(speeds) > np.abs(goal) * _ROUNDING
        limit = np.where(too_fast, self.drive.torque_limit + friction, drives)
        return {"torque_limit": limit, "inertia": self.drive.motor.inertia}
