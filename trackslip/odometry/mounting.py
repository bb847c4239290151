"""Where the sensor of measured poses sits on a robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import require_finite
from trackslip.identification.drive.reckoning import rotated
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Mounting:
    """Place and heading of a sensor in the frame of the robot's turning centre."""

    x: float = 0.0
    """How far it sits ahead [m]."""
    y: float = 0.0
    """How far it sits to the left [m]."""
    yaw: float = 0.0
    """Its heading minus the robot's, counter-clockwise [rad]."""

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            require_finite(f"sensor.{name}", getattr(self, name))

    def sensor_poses(self, pose: Array) -> Array:
        """Poses (..., 3) of the sensor, from those of the robot (..., 3)."""
        place = pose[..., :2] + rotated(pose[..., 2], np.array([self.x, self.y]))
        return np.concatenate([place, pose[..., 2:] + self.yaw], axis=-1)
