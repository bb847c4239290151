"""Laws with all other inputs to odometry: noise, parameter errors, sensor and clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.se2 import Mounting


@dataclass(frozen=True)
class LawInUse:
    """A law for odometry, with noise, parameter errors, sensor and clock."""

    name: str  # name of the law's family
    law: SlipLaw
    geometry: RobotGeometry  # geometry of the robot for which the law was identified
    noise: SlipNoise | None = None  # varying slip; None if it was not identified
    errors: LawErrors | None = None
    """Errors of the law's parameters that match the 95 % intervals; None if unknown."""
    drift: float = 0.0  # drift c, which causes a lateral speed of -c v w [s]
    mounting: Mounting | None = None
    """Mounting of the pose sensor during the identification; None if unknown."""
    clock_offset: float | None = None
    """Encoder clock minus pose clock during the identification, minus the lag of the motion [s];
    None if unknown.
    """
    # errors of the gyroscope during the identification; None without a gyroscope
    gyro: Gyro | None = None

    def odometry(self, **start: Any) -> SlipOdometry:
        """Odometry by this law; the keywords `start` and `start_covariance` are those of
        SlipOdometry.
        """
        return SlipOdometry(
            self.law, self.geometry, self.noise, self.errors, self.drift, gyro=self.gyro, **start
        )
