"""Where the sensor of the poses sits on the robot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sensor:
    """Place and mounting of a sensor in the robot's frame."""

    x: float = 0.0
    """Ahead of the middle of the tracks [m]."""
    y: float = 0.0
    """To the left of it [m]."""
    yaw: float = 0.0
    """Heading of the sensor minus heading of the robot [rad]."""
