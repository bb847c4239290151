"""Drives from set point to sprocket speed, with lag, motor limits and encoders; servos on courses;
towed loads.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackslip.errors import Checked, checked, require, require_non_negative, require_positive
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

MAX_FORCE = 1e5
"""Largest force of a pull [N]."""
_LEAST, _MOST = 1e-12, 1e6  # limits for all parameters, so that no derived value overflows
_CREEP = 0.02  # sprocket speed below which the gear friction is smoothed [rad/s]
RADIUS_ERROR = 0.0066
"""Default relative error of the effective sprocket radius, real / nominal - 1, tuned to the paper's
slips [-].
"""
MAX_RADIUS_ERROR = 0.5
"""Largest magnitude of the radius error [-]."""
_ROUNDING = 1 + 1e-6
_FLIPPER_SPEED = 1.5  # largest speed of flipper set points [rad/s]
_STATE = ("set_point", "omega", "_error", "_totals", "torque", "saturated_time")
_PARAMETERS = ("radius", "_decay", "_mean_decay")


@dataclass(frozen=True)
class Pull(Checked):
    """A horizontal force on the hitch that pulls the robot backwards."""

    force: float = checked(0.0, require_non_negative, MAX_FORCE, "N")
    """Magnitude of the force [N]."""
    height: float = checked(0.1, require_non_negative, 10.0, "m")
    """Height of the hitch above the ground [m]."""
    since: float = checked(0.0, require_non_negative)
    """Time from the start of a run until the force begins to act [s]."""


def _require_usable(name: str, value: float) -> None:
    require_positive(name, value, _MOST)
    require(value >= _LEAST, name, value, f"at least {_LEAST:g}")


@dataclass(frozen=True)
class Motor(Checked):
    """A brushed DC motor with a gear. All values are assumptions: its 60 W can easily drive 25 kg
    at 0.3 m/s.
    """

    gear: float = checked(50.0, _require_usable)
    """Gear ratio, motor speed over sprocket speed [-]."""
    voltage: float = checked(24.0, _require_usable)
    """Voltage of the battery, the largest voltage at the motor [V]."""
    no_load_speed: float = checked(400.0, _require_usable)
    """No-load speed of the motor at full voltage [rad/s]."""
    stall_torque: float = checked(0.6, _require_usable)
    """Stall torque of the motor at full voltage [N m]."""
    rotor_inertia: float = checked(8e-6, _require_usable)
    """Moment of inertia of the rotor, including the gear [kg m^2]."""
    friction: float = checked(0.3, require_non_negative)
    """Friction torque of the gear, measured at the sprocket [N m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        stall = self.gear * self.stall_torque
        require(
            self.friction < stall,
            "friction",
            self.friction,
            f"less than gear * stall_torque = {stall:g} N m",
        )

    @cached_property
    def inertia(self) -> float:
        """Moment of inertia of the motor at the sprocket [kg m^2]."""
        return self.rotor_inertia * self.gear**2

    @cached_property
    def torque_constant(self) -> float:
        """Torque constant, which equals the back-EMF constant [N m/A]."""
        return self.voltage / self.no_load_speed

    @cached_property
    def resistance(self) -> float:
        """Winding resistance [ohm]."""
        return self.voltage * self.torque_constant / self.stall_torque

    def torque_range(self, omega: Array) -> tuple[Array, Array]:
        """Smallest and largest sprocket torques (...) at full voltage [N m], for sprocket speeds
        (...) [rad/s].
        """
        stall = self.gear * self.stall_torque
        spent = stall * self.gear / self.no_load_speed * omega
        return -stall - spent, stall - spent

    def loss(self, omega: Array) -> Array:
        """Coulomb friction of the gear (...) [N m] at sprocket speeds (...) [rad/s], smoothed
        around rest.
        """
        return self.friction * np.tanh(omega / _CREEP)

    def power(self, torque: Array, omega: Array) -> Array:
        """Electrical power (...) [W] at sprocket torques (...) [N m] and speeds (...) [rad/s];
        negative if fed back.
        """
        current = torque / (self.gear * self.torque_constant)
        return torque * omega + self.resistance * current**2


@dataclass(frozen=True)
class Drive(Checked):
    """Servo and motor of a sprocket. Only the top speed is from the paper; all other values are
    assumptions.
    """

    lag: float = checked(0.05, require_positive, 1.0, "s")
    """Time constant of the speed controller [s]."""
    top_speed: float = checked(0.3, require_positive, 10.0, "m/s")
    """Largest speed of a track (paper, Sec. II) [m/s]."""
    torque_limit: float = checked(8.0, require_positive)
    """Largest motor torque at the sprocket, limited by the amplifier's current [N m]."""
    encoder_counts: int = checked(100_000, require_positive)
    """Encoder counts per sprocket revolution (motor encoder times gear)."""
    period: float = checked(0.01, require_positive)
    """Sampling period of the servo [s]."""
    motor: Motor = field(default_factory=Motor)
    """Motor and gear of the sprocket."""

    def __post_init__(self) -> None:
        super().__post_init__()
        limit, friction = self.torque_limit, self.motor.friction
        require(
            limit > friction, "torque_limit", limit, f"more than motor.friction = {friction} N m"
        )

    def torque_range(self, omega: Array) -> tuple[Array, Array]:
        """Smallest and largest torques (...) [N m] at speeds (...) [rad/s]; above its no-load
        speed, a motor brakes.
        """
        limit = self.torque_limit
        least, most = self.motor.torque_range(omega)
        return np.clip(least, -limit, limit), np.clip(most, -limit, limit)

    def belt_limits(self, radius: float, speeds: Array, goal: Array) -> Array:
        """Largest motor torques (...) [N m] for belts at `speeds` (...) with set points `goal`
        (...) [m/s].

        The sprockets have a `radius` [m]. For belts that exceed their set points, the limit is the
        torque limit plus gear friction, which helps to brake; for other belts, the motor's
        torque-speed line is the limit.
        """
        friction = self.motor.friction
        driving = np.maximum(self.torque_range(np.abs(speeds) / radius)[1] - friction, 0.0)
        return np.where(
            np.abs(speeds) > np.abs(goal) * _ROUNDING, self.torque_limit + friction, driving
        )


def tireless(top_speed: float = Drive.top_speed) -> Drive:
    """A drive that never saturates and so isolates the ground's effect; `top_speed` is in m/s."""
    return Drive(
        top_speed=top_speed, torque_limit=1e6, motor=Motor(no_load_speed=1e6, stall_torque=1e6)
    )


class Forecast(NamedTuple):
    """Motion of the sprockets in the next P servo periods, if the motors are strong enough for
    it.
    """

    omega: Array  # (P + 1, N, 2) current speeds, and speeds at the end of each period [rad/s]
    mean: Array  # (P, N, 2) mean speeds over each period [rad/s]
    error: Array  # (N, 2) final speeds minus set points [rad/s]


class DriveState(Restorable):
    """The sprockets of N robots; all states are (N, 2).

    The servo compensates its load: if the motor is strong enough, the speed follows the set point
    with an exact first-order lag. Speeds can therefore be forecast, and torques follow from them
    and the ground's forces.
    """

    STATE = (*_STATE, "_decay", "_mean_decay")

    def __init__(
        self, drive: Drive, n: int, sprocket_radius: float, effective_radius: Array | None = None
    ) -> None:
        """Start at rest, with the sprockets' `effective_radius` (N, 2), by default the nominal
        radius [m].
        """
        self.drive = drive  # servo and motor of all sprockets
        self.radius = (
            np.full((n, 2), sprocket_radius) if effective_radius is None else effective_radius
        )
        """Effective radii of the sprockets (N, 2) [m]."""
        self.limit = drive.top_speed / sprocket_radius  # largest sprocket speed [rad/s]
        self._decay, self._mean_decay = np.empty((2, n, 1))
        self.set_point = np.zeros((n, 2))  # set points of the speeds [rad/s]
        self.omega = np.zeros((n, 2))  # true speeds [rad/s]
        # also stored because it decays without rounding errors
        self._error: Array = np.zeros((n, 2))
        self._totals = np.zeros((n, 2, 2))  # integrals of speed and power
        self.torque = np.zeros((n, 2))  # motor torques at the sprockets in the last period [N m]
        # time that motors have spent at their limits so far [s]
        self.saturated_time = np.zeros((n, 2))
        self.restart(np.arange(n), [drive.lag] * n)

    @property
    def angle(self) -> Array:
        """True angles (N, 2) of the sprockets [rad]."""
        return self._totals[:, 0]

    @property
    def energy(self) -> Array:
        """Electrical energy (N, 2) drawn so far [J]."""
        return self._totals[:, 1]

    def restart(self, rows: np.ndarray, lag: Sequence[float]) -> None:
        """Reset the sprockets of the robots `rows` (R,) to rest; their servos have lags `lag` (R,)
        [s].
        """
        for name in _STATE:
            getattr(self, name)[rows] = 0.0
        period = self.drive.period
        for row, value in zip(rows, lag, strict=True):
            self._decay[row] = np.exp(-period / value)
            # mean of the decay over a period
            self._mean_decay[row] = -np.expm1(-period / value) * value / period

    def of(self, rows: np.ndarray) -> DriveState:
        """Copy the state of the sprockets on the robots `rows` (R,)."""
        part = copy.copy(self)
        for name in (*_STATE, *_PARAMETERS):
            setattr(part, name, getattr(self, name)[rows])
        return part

    def put(self, rows: np.ndarray, part: DriveState) -> None:
        """Set the state of the sprockets on the robots `rows` (R,) to that of `part`."""
        for name in _STATE:
            getattr(self, name)[rows] = getattr(part, name)

    def command(self, omega: Array) -> None:
        """Change the set points (N, 2), which are clipped to the top speed [rad/s]."""
        require(np.isfinite(omega).all(), "omega", omega, "finite")
        # takes a third of np.clip's time
        limited = np.minimum(np.maximum(omega, -self.limit), self.limit)
        self._error += self.set_point - limited
        self.set_point[:] = limited

    def forecast(self, periods: int) -> Forecast:
        """Forecast the speeds in the next `periods` servo periods for motors that are strong
        enough.
        """
        error = np.empty((periods + 1, *self.omega.shape))
        error[0], error[1:] = self._error, self._decay
        # bitwise identical for any number of forecasts
        np.multiply.accumulate(error, axis=0, out=error)
        return Forecast(
            error + self.set_point, error[:-1] * self._mean_decay + self.set_point, error[-1]
        )

    def torque_for(self, forecast: Forecast, traction: Array) -> Array:
        """Motor torques (P, N, 2) at the sprockets [N m] that a forecast requires, for tractions
        (P, N, 2) [N].
        """
        motor, omega = self.drive.motor, forecast.omega
        accelerating = (omega[1:] - omega[:-1]) * (motor.inertia / self.drive.period)
        return accelerating + self.radius * traction + motor.loss(omega[1:])

    def too_weak(self, forecast: Forecast, torque: Array) -> np.ndarray:
        """Indices (R,) of the robots with a motor too weak for the torques (P, N, 2) that a
        forecast requires [N m].
        """
        ample = self.drive.motor.torque_range(np.abs(forecast.omega).max())[1]
        if np.abs(torque).max() <= min(ample, self.drive.torque_limit):  # the usual case
            return np.empty(0, int)
        least, most = self.drive.torque_range(forecast.omega[1:])
        return np.flatnonzero(((torque < least) | (torque > most)).any(axis=(0, 2)))

    def accept(self, forecast: Forecast, torque: Array, saturated: Array | None = None) -> None:
        """Advance to the end of a forecast with torques (P, N, 2) [N m]; `saturated` (P, N, 2)
        marks limited ones.
        """
        period = self.drive.period
        self.omega, self.torque, self._error = forecast.omega[-1], torque[-1], forecast.error
        totals = np.empty((len(torque) + 1, *self._totals.shape))
        totals[0], rates = self._totals, totals[1:]
        rates[:, :, 0], rates[:, :, 1] = (
            forecast.mean,
            self.drive.motor.power(torque, forecast.mean),
        )
        rates *= period
        # added in order: bitwise identical for any number
        self._totals = np.add.accumulate(totals, axis=0)[-1].copy()
        if saturated is not None:
            self.saturated_time += saturated.sum(axis=0) * period

    def encoder_angle(self) -> Array:
        """Encoder angles (N, 2), rounded to whole counts [rad]."""
        count = 2 * np.pi / self.drive.encoder_counts
        return np.floor(self.angle / count) * count


class ServoState(Restorable):
    """Servos of N robots with F flippers each, on courses."""

    STATE = ("speed", "angle", "_speed_goal", "_angle_goal")

    def __init__(self, lag: float, top_speed: float, size: int, flippers: int) -> None:
        """Start at rest; `lag` is the time constant of the belt speeds [s], `top_speed` their limit
        [m/s].
        """
        self._lag, self._top_speed = lag, top_speed
        self.speed: Array = np.zeros((size, 2))  # belt speeds (N, 2), left and right [m/s]
        # set points (N, F) for the flippers' motors [rad]
        self.angle: Array = np.zeros((size, flippers))
        self._speed_goal, self._angle_goal = self.speed.copy(), self.angle.copy()

    def begin(self, rows: NDArray[np.int_], angle: Array) -> None:
        """Reset the robots `rows` (R,) to rest, with flippers at the angles `angle` (F,) [rad]."""
        self.speed[rows] = self._speed_goal[rows] = 0.0
        self.angle[rows] = self._angle_goal[rows] = angle

    def command(self, speed: Array, angle: Array) -> None:
        """Change the set points: belt speeds (N, 2), clipped to the top speed [m/s]; flipper angles
        (N, F) [rad].
        """
        self._speed_goal = np.clip(speed, -self._top_speed, self._top_speed)
        self._angle_goal = np.array(angle, float)

    def advance(self, duration: float) -> Array:
        """Advance by a `duration` [s], and return the mean belt speeds (N, 2) during that time
        [m/s].
        """
        short = self.speed - self._speed_goal
        self.speed = self._speed_goal + short * np.exp(-duration / self._lag)
        largest = _FLIPPER_SPEED * duration
        self.angle += np.clip(self._angle_goal - self.angle, -largest, largest)
        return self._speed_goal - short * (np.expm1(-duration / self._lag) * self._lag / duration)
