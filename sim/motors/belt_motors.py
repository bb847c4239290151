"""The motors of belts, in steps of the engine: their state, and what they exert in a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.motors.balance import ROUGHNESS, TOLERANCE, Balance
from sim.motors.motor import EvenTorque, TorqueLaw
from trackslip.errors import require

Floats = NDArray[Any]
_STATES: Final = 13  # number of arrays in a state


@dataclass(frozen=True)
class MotorReading:
    """State of T belt motors in the last physics step; for a batch with a leading axis (N, T)."""

    torque: Floats
    """Torque of the motor at the sprocket, positive forwards (..., T) [N m]."""
    speed: Floats
    """Speed of the belt (..., T) [m/s]."""
    power: Floats
    """Mechanical power of the motor (..., T) [W]; negative when it brakes."""
    energy: Floats
    """Integral of the power over all steps so far (..., T) [J]."""
    saturated_time: Floats
    """Time that the motor has spent at its limit so far (..., T) [s]."""
    saturated_torque: Floats
    """Torque when the motor was at its limit last; 0 before that (..., T) [N m]."""
    needed: Floats
    """Largest torque that the set point took in the last `BatchBelts.run` in which one of the
    motors was too weak; 0 before that (..., T) [N m].
    """
    position: Floats
    """Distance that the belt has run in all steps so far (..., T) [m]."""


class BeltMotors:
    """Motors of T belts in each of N simulations; all states are (N, T)."""

    def __init__(
        self, size: int, radius: Floats, weight: float, slope: float, law: TorqueLaw | None = None
    ) -> None:
        """Start at rest, without limits.

        Args:
            size: number of simulations.
            radius: radii of the sprockets (T,) [m].
            weight: the robot's weight [N].
            slope: increase in traction with belt speed for a robot that is free to move [N s/m].
            law: limits and losses of the motors; by default the torque limit at any speed, and
                none.
        """
        shape = size, len(radius)
        self._radius = radius
        self._law: TorqueLaw = law or EvenTorque()
        self._noise = ROUGHNESS * weight * radius / len(radius)
        # (T, T) least slopes of the loads over the sprocket speeds [N m s/rad]
        self._least = np.diag(radius**2) * slope / len(radius)
        self._slope = np.zeros((*shape, len(radius)))
        self._state = np.zeros((_STATES, *shape))
        # views: set points, changes in speed in the last step [m/s], owed angular momentum [N m s],
        # moments of inertia [kg m^2], torque limits [N m]
        self._goal, self._change, self._owed, self._inertia, self._limit = self._state[:5]
        # views: belt speeds [m/s], torques [N m], powers [W], energies [J]
        self.speed, self._torque, self._power, self._energy = self._state[5:9]
        # views: times at the limits [s], torques there [N m], torques for the set points [N m]
        self._saturated_time, self._saturated_torque, self._needed = self._state[9:12]
        self._position = self._state[12]  # view: distances that the belts have run [m]
        self.begin(np.arange(size))

    def begin(self, rows: NDArray[np.int_]) -> None:
        """Reset the motors in the simulations `rows` to rest, without limits."""
        self._state[:, rows] = 0.0
        self._limit[rows] = np.inf
        self._slope[rows] = self._least

    def get_state(self) -> tuple[Floats, Floats]:
        """Return a copy of all motors' states."""
        return self._state.copy(), self._slope.copy()

    def set_state(self, state: tuple[Floats, Floats]) -> None:
        """Restore a state from `get_state`."""
        self._state[:], self._slope[:] = state

    def set(
        self,
        rows: NDArray[np.int_],
        speeds: Floats,
        torque_limit: ArrayLike | None,
        inertia: ArrayLike,
    ) -> None:
        """Change set points (R, T) in the simulations `rows` [m/s]; belts without a limit reach
        these speeds at once.
        """
        shape = len(rows), self.speed.shape[1]
        limit: ArrayLike = np.inf
        if torque_limit is not None:
            limit = _numbers("torque_limit", torque_limit, shape)
        self._inertia[rows] = _numbers("inertia", inertia, shape, most=1e6)
        self._limit[rows] = limit
        self._goal[rows] = speeds
        is_free = np.isinf(limit)
        self.speed[rows] = np.where(is_free, speeds, self.speed[rows])
        for state in (self._change, self._owed):
            state[rows] = np.where(is_free, 0.0, state[rows])

    def goal(self, rows: NDArray[np.int_]) -> Floats:
        """Set points (R, T) in the simulations `rows` [m/s]."""
        return self._goal[rows]

    def roll(self, rows: NDArray[np.int_], duration: float) -> None:
        """Let the belts in the simulations `rows` run at their set points for a `duration` [s]."""
        self._position[rows] += self._goal[rows] * duration

    def limited(self, rows: NDArray[np.int_]) -> bool:
        """Whether any motor in the simulations `rows` has a limit."""
        return bool(np.isfinite(self._limit[rows]).any())

    def hold(self, rows: NDArray[np.int_], step: float, traction: Floats) -> NDArray[np.bool_]:
        """Advance the simulations with motors that are strong enough for their set points; return
        their mask (R,).

        `traction` (R, S, T) has the tractions at the set points in S physics steps [N].
        """
        goal = self._goal[rows] / self._radius
        start = self.speed[rows] / self._radius
        torque = traction * self._radius + self._law.loss(goal)[:, None]
        # the speed changes in the first step
        accelerating = self._inertia[rows] * (goal - start) - self._owed[rows]
        torque[:, 0] += accelerating / step
        smallest, largest = self._law.limits(goal, self._limit[rows])
        is_within = (torque >= smallest[:, None]) & (torque <= largest[:, None])
        held: NDArray[np.bool_] = np.logical_and.reduce(is_within, axis=(1, 2))

        power = torque * goal[:, None]
        power[:, 0] = torque[:, 0] * (start + goal) / 2
        kept = rows[held]
        self.roll(kept, traction.shape[1] * step)
        self._position[kept] += (self.speed[kept] - self._goal[kept]) * step / 2
        self.speed[kept] = self._goal[kept]
        self._owed[kept] = 0.0
        self._change[kept] = 0.0
        self._torque[kept] = torque[held, -1]
        self._power[kept] = power[held, -1]
        self._energy[kept] += power[held].sum(axis=1) * step

        if not held.all():
            forwards = torque[~held].max(axis=1)
            backwards = torque[~held].min(axis=1)
            self._needed[rows[~held]] = np.where(forwards > -backwards, forwards, backwards)
        return held

    def read(self, rows: int | slice = slice(None)) -> MotorReading:
        """Motor readings (N, T), or (T,) for a single simulation."""
        return MotorReading(
            self._torque[rows].copy(),
            self.speed[rows].copy(),
            self._power[rows].copy(),
            self._energy[rows].copy(),
            self._saturated_time[rows].copy(),
            self._saturated_torque[rows].copy(),
            self._needed[rows].copy(),
            self._position[rows].copy(),
        )

    def advance(
        self,
        rows: NDArray[np.int_],
        step: float,
        attempt: Callable[[NDArray[np.int_], Floats], Floats],
    ) -> None:
        """Advance the simulations `rows` by one physics step.

        Args:
            rows: the simulations (R,).
            step: the physics step [s].
            attempt: steps the simulations (A,) from their state before the step at belt speeds (A,
                T) [m/s], and returns the tractions (A, T) [N]. Each simulation keeps the result of
                its last attempt.
        """
        radius = self._radius
        start = self.speed[rows] / radius
        goal = self._goal[rows] / radius
        inertia = self._inertia[rows]
        limit = self._limit[rows]
        smallest, largest = self._law.limits(start, limit)
        weaker = np.minimum(np.abs(smallest), np.abs(largest))
        strength = np.where(np.isinf(weaker), 0.0, weaker)
        balance = Balance(
            law=self._law,
            torque_limit=limit,
            inertia_per_step=inertia / step,
            start=start,
            goal=goal,
            owed=self._owed[rows] / step,
            tolerance=TOLERANCE * strength + self._noise,
        )

        # first, a belt on its way to its set point changes its speed as in the last step
        as_before = start + self._change[rows] / radius
        is_under_way = (goal - start) * (goal - as_before) > 0
        first = np.where(is_under_way, as_before, goal)

        def speeds(going: NDArray[np.int_], omega: Floats) -> Floats:
            """Belt speeds (A, T) at sprocket speeds (A, T), without rounding at set points
            [m/s].
            """
            return np.where(omega == goal[going], self._goal[rows[going]], omega * radius)

        solution, slope = balance.solve(
            first,
            self._slope[rows],
            lambda going, omega: radius * attempt(rows[going], speeds(going, omega)),
        )

        omega = solution.omega
        torque = solution.torque
        impulse = step * (torque - solution.load - self._law.loss(omega))
        self._owed[rows] += impulse - inertia * (omega - start)
        self._power[rows] = torque * (start + omega) / 2
        self._energy[rows] += self._power[rows] * step
        self._torque[rows] = torque
        smallest, largest = self._law.limits(omega, limit)
        is_saturated = (torque <= smallest) | (torque >= largest)
        self._saturated_time[rows] += is_saturated * step
        self._saturated_torque[rows] = np.where(is_saturated, torque, self._saturated_torque[rows])
        speed = speeds(np.arange(len(rows)), omega)
        self._position[rows] += (self.speed[rows] + speed) / 2 * step
        self._change[rows] = speed - self.speed[rows]
        self.speed[rows] = speed
        self._slope[rows] = slope


def _numbers(name: str, values: ArrayLike, shape: tuple[int, int], most: float = np.inf) -> Floats:
    """Checked numbers: a scalar, one per belt (T,), or one per simulation and belt (R, T)."""
    try:
        given = np.asarray(values, float)
    except (TypeError, ValueError):
        given = np.array(np.nan)
    fits = given.shape in ((), shape[1:], shape) and ((given >= 0.0) & (given <= most)).all()
    require(fits, name, values, f"a number of at least 0, or one for each of {shape[1]} belts")
    return given
