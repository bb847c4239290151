"""Motors of belts: their speeds at the end of each physics step, by the balance of torques.

A belt with the inertia J of its sprocket, of radius r, obeys J dw/dt = T - r F under the torque T and the traction F.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.tracks.balance import Balance
from trackslip.errors import require

_TOLERANCE = 0.005  # of a motor's force, relative to its limit; the next step makes up for it
_ROUGHNESS = 2e-4  # noise of the ground's forces, which the engine finds by iteration, relative to the weight

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MotorReading:
    """Motors of T belts in the last physics step; a batch has a leading axis (N, T)."""

    torque: Floats
    """Torque of the motor at the sprocket, positive forwards (..., T) [N m]."""
    speed: Floats
    """Speed of the belt (..., T) [m/s]."""
    power: Floats
    """Mechanical power of the motor (..., T) [W]; negative when it brakes."""
    energy: Floats
    """Its integral over all steps so far (..., T) [J]."""


class Motors:
    """Motors of T belts in each of N simulations, (N, T) each."""

    def __init__(self, size: int, radius: Floats, weight: float, slope: float) -> None:
        """Start at rest, without limits.

        Args:
            size: number of simulations.
            radius: radii of the sprockets (T,) [m].
            weight: of the robot [N].
            slope: of the traction of a robot that is free to move over the belts' speed [N s/m].
        """
        shape = size, len(radius)
        self._radius, self._noise = radius, _ROUGHNESS * weight / len(radius)
        self._least = np.eye(len(radius)) * slope / len(radius)  # (T, T)
        self._slope = np.zeros((*shape, len(radius)))  # (N, T, T) of the traction
        self._state = np.zeros((9, *shape))
        self._goal, self._change, self._late, self._inertia, self._limit = self._state[:5]
        self.speed, self._torque, self._power, self._energy = self._state[5:]
        self.begin(np.arange(size))

    def begin(self, rows: NDArray[np.int_]) -> None:
        """Put some simulations to rest, without limits."""
        self._state[:, rows], self._limit[rows], self._slope[rows] = 0.0, np.inf, self._least

    def get_state(self) -> tuple[Floats, Floats]:
        """A copy of the state of all motors."""
        return self._state.copy(), self._slope.copy()

    def set_state(self, state: tuple[Floats, Floats]) -> None:
        """Return to a state."""
        self._state[:], self._slope[:] = state

    def set(self, rows: NDArray[np.int_], speeds: Floats, torque_limit: ArrayLike | None, inertia: ArrayLike) -> None:
        """Set the set points (R, T) of some simulations; belts without a limit have these speeds at once."""
        shape = len(rows), self.speed.shape[1]
        limit: ArrayLike = np.inf
        if torque_limit is not None:
            limit = _numbers("torque_limit", torque_limit, shape)
        self._inertia[rows] = _numbers("inertia", inertia, shape, most=1e6)
        self._limit[rows], self._goal[rows] = limit, speeds
        free = np.isinf(limit)
        self.speed[rows] = np.where(free, speeds, self.speed[rows])
        for state in (self._change, self._late):
            state[rows] = np.where(free, 0.0, state[rows])

    def goal(self, rows: NDArray[np.int_]) -> Floats:
        """Set points (R, T) of some simulations [m/s]."""
        return self._goal[rows]

    def limited(self, rows: NDArray[np.int_]) -> bool:
        """True if a motor of these simulations has a limit."""
        return bool(np.isfinite(self._limit[rows]).any())

    def hold(self, rows: NDArray[np.int_], step: float, traction: Floats) -> NDArray[np.bool_]:
        """Mask (R,) of the simulations whose motors are strong enough for their set points; these have advanced.

        `traction` (R, S, T) is that of S physics steps at the set points [N].
        """
        goal, start, limit = self._goal[rows], self.speed[rows], self._limit[rows] / self._radius
        force = traction.copy()
        force[:, 0] += (self._inertia[rows] / self._radius**2 * (goal - start) - self._late[rows]) / step
        held: NDArray[np.bool_] = np.logical_and.reduce(np.abs(force) <= limit[:, None], axis=(1, 2))
        power = force * goal[:, None]
        power[:, 0] = force[:, 0] * (start + goal) / 2
        kept = rows[held]
        self.speed[kept], self._late[kept], self._change[kept] = goal[held], 0.0, 0.0
        self._torque[kept], self._power[kept] = (force[:, -1] * self._radius)[held], power[held, -1]
        self._energy[kept] += power[held].sum(axis=1) * step
        return held

    def read(self, rows: int | slice = slice(None)) -> MotorReading:
        """Readings (N, T), or those of one simulation (T,)."""
        return MotorReading(*(each[rows].copy() for each in (self._torque, self.speed, self._power, self._energy)))

    def advance(
        self, rows: NDArray[np.int_], step: float, attempt: Callable[[NDArray[np.int_], Floats], Floats]
    ) -> None:
        """Advance some simulations by a physics step.

        Args:
            rows: the simulations (R,).
            step: the physics step [s].
            attempt: step the simulations (A,) from where they are now, at belt speeds (A, T) [m/s]; gives the tractions
                (A, T) [N]. Each simulation keeps its last attempt.
        """
        radius, start, goal = self._radius, self.speed[rows], self._goal[rows]
        mass, limit = self._inertia[rows] / radius**2, self._limit[rows] / radius
        guess = start + self._change[rows]
        short = (goal - start) * (goal - guess) > 0
        offset = mass / step * start + self._late[rows] / step
        balance = Balance(
            goal=goal,
            speed=np.where(short, guess, goal),
            slope=self._slope[rows],
            tolerance=_TOLERANCE * np.where(np.isinf(limit), 0.0, limit) + self._noise,
            required=lambda going, speed, traction: mass[going] / step * speed - offset[going] + traction,
            limits=lambda going, _: (-limit[going], limit[going]),
            stiffness=lambda going, _: mass[going] / step,
        )
        traction, force = balance.solve(lambda going, speed: attempt(rows[going], speed))
        speed = balance.speed
        self._late[rows] += step * (force - traction) - mass * (speed - start)
        self._power[rows] = force * (start + speed) / 2
        self._energy[rows] += self._power[rows] * step
        self._torque[rows], self._change[rows] = force * radius, speed - start
        self.speed[rows], self._slope[rows] = speed, balance.slope


def _numbers(name: str, values: ArrayLike, shape: tuple[int, int], most: float = np.inf) -> Floats:
    """One number for all, one a belt (T,), or all of them (R, T)."""
    try:
        given = np.asarray(values, float)
    except (TypeError, ValueError):
        given = np.array(np.nan)
    fits = given.shape in ((), shape[1:], shape) and ((given >= 0.0) & (given <= most)).all()
    require(fits, name, values, f"a number of at least 0, or one for each of {shape[1]} belts")
    return given
