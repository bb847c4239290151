"""The sprockets of a fleet: their motion, torques, energy and encoders, in periods of the servo.

A servo compensates its load: if its motor is strong enough, its speed is known in advance. The
motion of the sprockets can therefore be *forecast* for many periods at once, in which the engine
runs without interruption; the torques that this took follow from the tractions afterwards. Only the
robots whose motors turn out to be too weak repeat the time, period by period, with the balance of
`sim.motors.balance`.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.motors.balance import ROUGHNESS, TOLERANCE, Balance
from sim.motors.motor import Drive
from sim.motors.servo import Servo
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

# initial slopes of the load over the sprocket speeds, per mass * radius^2 [1/s]: for equal changes
# on both tracks, which accelerate the robot, and for opposite ones while friction holds the heading
_COMMON: Final = 25.0
_OPPOSITE: Final = 12_000.0

_PER_ROBOT = ("_totals", "torque", "needed", "saturated_time", "radius")


class Forecast(NamedTuple):
    """Motion of the sprockets in the next P servo periods, if the motors are strong enough for
    it.
    """

    omega: Array  # (P + 1, N, 2) current speeds, and speeds at the end of each period [rad/s]
    mean: Array  # (P, N, 2) mean speeds over each period [rad/s]
    error: Array  # (N, 2) final speeds minus set points [rad/s]


class Sprockets(Restorable):
    """The (left, right) sprockets of N robots."""

    STATE = ("servo", "_totals", "torque", "needed", "saturated_time")

    def __init__(
        self, drive: Drive, n: int, sprocket_radius: float, effective_radius: Array | None = None
    ) -> None:
        """Start at rest, with the sprockets' `effective_radius` (N, 2), by default the nominal
        radius [m].
        """
        self.drive = drive  # servo and motor of all sprockets
        self.radius: Array = (
            np.full((n, 2), sprocket_radius) if effective_radius is None else effective_radius
        )
        """Effective radii of the sprockets (N, 2) [m]."""
        self.servo = Servo(n, drive.lag, drive.period, drive.top_speed / sprocket_radius)
        """Servos of the sprocket speeds [rad/s]."""
        self._totals: Array = np.zeros((n, 2, 2))  # integrals of speed and power
        self.torque: Array = np.zeros((n, 2))
        """Motor torques (N, 2) at the sprockets in the last period [N m]."""
        self.needed: Array = np.zeros((n, 2))
        """Torques (N, 2) that the set points took in the last period [N m]; equal to `torque` for
        motors that are strong enough.
        """
        self.saturated_time: Array = np.zeros((n, 2))
        """Times (N, 2) that the motors have spent at their limits so far [s]."""

    @property
    def omega(self) -> Array:
        """True speeds (N, 2) [rad/s]."""
        return self.servo.speed

    @property
    def limit(self) -> float:
        """Largest set point [rad/s]."""
        return self.servo.top_speed

    @property
    def set_point(self) -> Array:
        """Set points (N, 2) of the speeds [rad/s]."""
        return self.servo.set_point

    @property
    def angle(self) -> Array:
        """True angles (N, 2) of the sprockets [rad]."""
        return self._totals[:, 0]

    @property
    def energy(self) -> Array:
        """Electrical energy (N, 2) drawn so far [J]."""
        return self._totals[:, 1]

    def restart(self, rows: NDArray[np.int_], lag: Sequence[float]) -> None:
        """Reset the sprockets of the robots `rows` (R,) to rest; their servos have lags `lag` (R,)
        [s].
        """
        self.servo.begin(rows, lag)
        for values in (self._totals, self.torque, self.needed, self.saturated_time):
            values[rows] = 0.0

    def of(self, rows: NDArray[np.int_]) -> Sprockets:
        """Copy the sprockets of the robots `rows` (R,)."""
        part = copy.copy(self)
        for name in _PER_ROBOT:
            setattr(part, name, getattr(self, name)[rows])
        part.servo = self.servo.of(rows)
        return part

    def put(self, rows: NDArray[np.int_], part: Sprockets) -> None:
        """Set the state of the sprockets on the robots `rows` (R,) to that of `part`."""
        for name in _PER_ROBOT:
            getattr(self, name)[rows] = getattr(part, name)
        self.servo.put(rows, part.servo)

    def command(self, omega: Array) -> None:
        """Change the set points (N, 2), which are clipped to the top speed [rad/s]."""
        require(np.isfinite(omega).all(), "omega", omega, "finite")
        self.servo.command(omega)

    def forecast(self, periods: int) -> Forecast:
        """Forecast the speeds in the next `periods` servo periods for motors that are strong
        enough.
        """
        errors = self.servo.errors(periods)
        return Forecast(errors + self.servo.set_point, self.servo.means(errors), errors[-1])

    def torque_for(self, forecast: Forecast, traction: Array) -> Array:
        """Motor torques (P, N, 2) at the sprockets [N m] that a forecast requires, for tractions
        (P, N, 2) [N].
        """
        motor, omega = self.drive.motor, forecast.omega
        accelerating = (omega[1:] - omega[:-1]) * (motor.inertia / self.drive.period)
        return accelerating + self.radius * traction + motor.loss(omega[1:])

    def too_weak(self, forecast: Forecast, torque: Array) -> NDArray[np.int_]:
        """Indices (R,) of the robots with a motor too weak for the torques (P, N, 2) that a
        forecast requires [N m].
        """
        fastest = np.abs(forecast.omega).max()
        ample = self.drive.limits(fastest)[1]
        if np.abs(torque).max() <= ample:  # the usual case
            return np.empty(0, int)
        smallest, largest = self.drive.limits(forecast.omega[1:])
        is_beyond = (torque < smallest) | (torque > largest)
        return np.flatnonzero(is_beyond.any(axis=(0, 2)))

    def accept(self, forecast: Forecast, torque: Array) -> None:
        """Advance to the end of a forecast with torques (P, N, 2) [N m]."""
        self.servo.error = forecast.error
        self.torque = torque[-1]
        self.needed = torque[-1].copy()
        rates = np.stack([forecast.mean, self.drive.motor.power(torque, forecast.mean)], axis=2)
        totals = np.concatenate([self._totals[None], rates * self.drive.period])
        # added in order: bitwise identical for any number of periods
        self._totals = np.add.accumulate(totals, axis=0)[-1].copy()

    def advance_within_limits(
        self,
        mass: float,
        gravity: float,
        run: Callable[[NDArray[np.int_], Array], Array],
    ) -> None:
        """Advance by one servo period with torques within the motors' limits.

        A robot with motors that are strong enough moves as its servos demand. The belts of any
        other robot run at the final sprocket speeds for the whole period, so that no motion
        oscillates however stiff the grip. `run` simulates the period from its start for robots (A,)
        at mean sprocket speeds (A, 2) [rad/s], and returns mean tractions (A, 2) [N].
        """
        drive = self.drive
        wanted = self.forecast(1)
        start, goal = wanted.omega
        everyone = np.arange(len(goal))
        needed = self.torque_for(wanted, run(everyone, wanted.mean[0])[None])[0]
        smallest, largest = drive.limits(goal)
        torque = np.minimum(np.maximum(needed, smallest), largest)
        omega = goal.copy()
        mean = wanted.mean[0].copy()

        # torque of a track that carries the robot alone
        carrying = mass * gravity * self.radius
        weaker = np.minimum(*np.abs(drive.limits(start)))
        strength = np.minimum(weaker, carrying)
        tolerance = TOLERANCE * strength + ROUGHNESS * carrying
        weak = np.flatnonzero((np.abs(needed - torque) > tolerance).any(axis=1))
        if weak.size:
            balance = Balance(
                law=drive.motor,
                torque_limit=np.full((len(weak), 2), drive.torque_limit),
                inertia_per_step=np.full((len(weak), 2), drive.motor.inertia / drive.period),
                start=start[weak],
                goal=goal[weak],
                owed=np.zeros((len(weak), 2)),
                tolerance=tolerance[weak],
            )
            solution, _ = balance.solve(
                _first_try(start[weak], goal[weak], torque[weak] != needed[weak]),
                _first_slope(mass, self.radius[weak]),
                lambda rows, speed: self.radius[weak[rows]] * run(weak[rows], speed),
            )
            torque[weak] = solution.torque
            omega[weak] = solution.omega
            mean[weak] = solution.omega

        smallest, largest = drive.limits(omega)
        is_saturated = (torque <= smallest) | (torque >= largest)
        error = np.where(omega == goal, wanted.error, omega - self.servo.set_point)
        self.accept(Forecast(np.stack([start, omega]), mean[None], error), torque[None])
        self.needed = needed
        self.saturated_time += is_saturated * drive.period

    def encoder_angle(self) -> Array:
        """Encoder angles (N, 2), rounded to whole counts [rad]."""
        count = 2 * np.pi / self.drive.encoder_counts
        return np.floor(self.angle / count) * count


def _first_try(start: Array, goal: Array, is_limited: NDArray[np.bool_]) -> Array:
    """Speeds (R, 2) to try first, from the speeds at the start of a period and the set points at
    its end (R, 2), for robots with motors that are too weak for their set points, `is_limited` (R,
    2).

    If both motors are, these are the past speeds. Otherwise the weak sprocket changes its speed as
    the other one does, so that the robot turns no faster than before.
    """
    as_the_other = start + (goal - start)[:, ::-1]
    one = np.where(is_limited, as_the_other, goal)
    return np.where(is_limited.all(axis=1, keepdims=True), start, one)


def _first_slope(mass: float, radius: Array) -> Array:
    """Slopes (R, 2, 2) of the loads over the sprocket speeds [N m s/rad] from which a search
    begins, for robots of a mass [kg] and sprockets of the radii (R, 2) [m].
    """
    same = (_COMMON + _OPPOSITE) * mass / 2
    cross = (_COMMON - _OPPOSITE) * mass / 2
    slope = np.array([[same, cross], [cross, same]])
    return slope * (radius[:, :, None] * radius[:, None])
