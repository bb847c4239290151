"""The drives: set point -> sprocket speed, with a servo's lag, limits and encoder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

RADIUS_ERROR = 0.0067
"""Default relative error of the effective sprocket radius, real / nominal - 1 [-]: tuned to the paper's slips."""


@dataclass(frozen=True)
class Drive:
    """Servo of a sprocket. All assumptions: the paper gives the top speed only."""

    lag: float = 0.05
    """Time constant of the speed loop [s]."""
    top_speed: float = 0.3
    """Largest speed of a track [m/s] (paper, Sec. II)."""
    torque_limit: float = 15.0
    """Largest torque at a sprocket [N m]."""
    inertia: float = 0.02
    """Of motor and gear, at the sprocket [kg m^2]."""
    encoder_counts: int = 100_000
    """Encoder counts per turn of a sprocket (motor encoder times gear)."""
    period: float = 0.01
    """Sampling time of the servo [s]."""

    def __post_init__(self) -> None:
        for name in ("lag", "top_speed", "torque_limit", "inertia", "encoder_counts", "period"):
            require_positive(name, getattr(self, name))


class DriveState:
    """The sprockets of N robots, (N, 2) each."""

    def __init__(self, drive: Drive, n: int, sprocket_radius: float) -> None:
        """`sprocket_radius` [m] turns the top speed into a sprocket speed."""
        self._drive = drive
        self._radius = sprocket_radius
        self.limit = drive.top_speed / sprocket_radius
        """Largest sprocket speed [rad/s]."""
        self._decay = np.exp(-drive.period / drive.lag)
        self._mean_decay = (1 - self._decay) * drive.lag / drive.period
        self.set_point = np.zeros((n, 2))
        """[rad/s]"""
        self.omega = np.zeros((n, 2))
        """True speed [rad/s]."""
        self.angle = np.zeros((n, 2))
        """True angle [rad]."""
        self.torque = np.zeros((n, 2))
        """[N m]"""

    def command(self, omega: Array) -> None:
        """Set points (N, 2) [rad/s]; what is beyond the top speed is cut off."""
        if not np.isfinite(omega).all():
            raise InvalidValueError("omega", omega, "finite")
        np.clip(omega, -self.limit, self.limit, out=self.set_point)

    def advance(self, traction: Array) -> Array:
        """One servo period against the ground's pull on the tracks (N, 2) [N]; the mean speeds in it (N, 2) [rad/s].

        The servo compensates its load, so that the speed follows the set point with a first-order lag, exactly, as
        long as the torque this takes is within the limit.
        """
        drive = self._drive
        load = self._radius * traction
        error = self.omega - self.set_point
        target = self.set_point + error * self._decay
        acceleration = (target - self.omega) / drive.period
        torque = drive.inertia * acceleration + load
        limited = np.clip(torque, -drive.torque_limit, drive.torque_limit)
        mean = self.set_point + error * self._mean_decay
        saturated = limited != torque
        if saturated.any():
            free = self.omega + (limited - load) / drive.inertia * drive.period
            mean = np.where(saturated, (self.omega + free) / 2, mean)
            target = np.where(saturated, free, target)
        self.torque = limited
        self.omega = target
        self.angle += mean * drive.period
        return mean

    def encoder_angle(self) -> Array:
        """Angles (N, 2) as the encoders count them [rad]."""
        count = 2 * np.pi / self._drive.encoder_counts
        return np.floor(self.angle / count) * count
