"""The drives: set point -> sprocket speed, with a servo's lag, limits and encoder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require_at_most, require_positive
from trackslip.kinematics import Array

_WIND_UP = 64.0  # stiffness of grip against turning, over that against driving: enough to keep a saturated drive calm
RADIUS_ERROR = 0.0067
"""Default relative error of the effective sprocket radius, real / nominal - 1 [-]: tuned to the paper's slips."""


@dataclass(frozen=True)
class Drive:
    """Servo of a sprocket. All assumptions: the paper gives the top speed only."""

    lag: float = 0.05
    """Time constant of the speed loop [s]."""
    top_speed: float = 0.3
    """Largest speed of a track [m/s] (paper, Sec. II)."""
    torque_limit: float = 8.0
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
        require_at_most("lag", self.lag, 1.0, "s")
        require_at_most("top_speed", self.top_speed, 10.0, "m/s")


class DriveState:
    """The sprockets of N robots, (N, 2) each."""

    def __init__(self, drive: Drive, n: int, sprocket_radius: float, mass: float = 0.0, grip_rate: float = 0.0) -> None:
        """N pairs of sprockets at rest.

        Args:
            drive: their servo.
            n: robots.
            sprocket_radius: turns the top speed into a sprocket speed [m].
            mass: of the robot that the tracks push [kg].
            grip_rate: rate at which friction takes up a sliding speed, before it reaches its limit [1/s].
        """
        self._mass = mass
        self._grip = mass / 2 * grip_rate  # force per sliding speed of one track [N s/m]
        self._drive = drive
        self._radius = sprocket_radius
        self.limit = drive.top_speed / sprocket_radius
        """Largest sprocket speed [rad/s]."""
        self._decay = np.exp(-drive.period / drive.lag)
        self._mean_decay = -np.expm1(-drive.period / drive.lag) * drive.lag / drive.period
        self._torque_per_error = drive.inertia * (self._decay - 1) / drive.period
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
        mean = self.set_point + error * self._mean_decay
        torque = error * self._torque_per_error + load
        if np.abs(torque).max() > drive.torque_limit:
            limited = np.clip(torque, -drive.torque_limit, drive.torque_limit)
            free = self.omega + self._saturated_step(limited - load, traction)
            free = np.where(torque > limited, np.minimum(free, target), np.maximum(free, target))
            saturated = limited != torque
            mean = np.where(saturated, (self.omega + free) / 2, mean)
            target = np.where(saturated, free, target)
            torque = limited
        self.torque = torque
        self.omega = target
        self.angle += mean * drive.period
        return mean

    def _saturated_step(self, net: Array, traction: Array) -> Array:
        """Change of speed (N, 2) [rad/s] in a period under net torques (N, 2) [N m].

        The ground answers within the period, and unless its answer is counted the tracks are shaken to and fro. Both
        tracks together meet the robot's inertia, one against the other the much stiffer grip sideways. A turn that
        takes more torque than there is still hunts, by a few tenths of a rad/s.
        """
        period, inertia, radius = self._drive.period, self._drive.inertia, self._radius
        together, against = net.mean(axis=1, keepdims=True), (net[:, 1:] - net[:, :1]) / 2
        if self._mass > 0:  # grip that the robot's own acceleration takes off again
            speeding_up = traction.sum(axis=1, keepdims=True) / self._mass * period
            together = together + radius * self._grip * speeding_up
        common = together * period / (inertia + period * self._grip * radius**2)
        turning = against * period / (inertia + period * _WIND_UP * self._grip * radius**2)
        return np.concatenate([common - turning, common + turning], axis=1)

    def encoder_angle(self) -> Array:
        """Angles (N, 2) as the encoders count them [rad]."""
        count = 2 * np.pi / self._drive.encoder_counts
        return np.floor(self.angle / count) * count
