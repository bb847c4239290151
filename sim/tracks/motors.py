"""Motors of belts: the speeds at which they and the ground are in balance at the end of each physics step.

A belt with the inertia J of its sprocket, of radius r, obeys J dw/dt = T - r F under the torque T and the traction F.
The ground answers within a step: where it holds a robot, F rises by some 200 robot weights per m/s, so that an explicit
step diverges whatever J is. Each step is therefore implicit: it is tried until F at the new speeds u leaves
r F + J (u - u0) / (r h) within the torque's limit, at the set point, or equal to the limit on the way there. Because
F is the gradient of a convex function of u, as the engine's contacts are, there is one solution; quasi-Newton steps
find it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import require

_ATTEMPTS = 25
_TOLERANCE = 0.005  # of a motor's force, relative to its limit; the next step makes up for it
_ROUGHNESS = 2e-4  # noise of the ground's forces, which the engine finds by iteration, relative to the weight
_FLATTEST = 1e-4  # slope of the traction where the belts slide, relative to the slope before

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
            radius: radii of the sprockets (T,), unless others are set [m].
            weight: of the robot [N].
            slope: of the traction of a robot that is free to move over the belts' speed [N s/m].
        """
        shape = size, len(radius)
        self._default, self._noise = radius, _ROUGHNESS * weight / len(radius)
        self._slope = np.tile(np.eye(len(radius)) * slope / len(radius), (size, 1, 1))  # (N, T, T) of the traction
        self._goal, self._change, self._late, self._inertia = np.zeros((4, *shape))
        self._limit, self._radius = np.full(shape, np.inf), np.tile(radius, (size, 1))
        self.speed, self._torque, self._power, self._energy = np.zeros((4, *shape))

    def set(
        self,
        rows: NDArray[np.int_],
        speeds: Floats,
        torque_limit: ArrayLike | None,
        inertia: ArrayLike,
        radius: ArrayLike | None,
    ) -> None:
        """Set the set points (R, T) of some simulations; belts without a limit have these speeds at once."""
        shape = len(rows), self.speed.shape[1]
        limit: ArrayLike = np.inf
        if torque_limit is not None:
            limit = _numbers("torque_limit", torque_limit, shape, least=0.0)
        self._radius[rows] = self._default if radius is None else _numbers("radius", radius, shape, least=1e-3)
        self._inertia[rows] = _numbers("inertia", inertia, shape, least=0.0, most=1e6)
        self._limit[rows], self._goal[rows] = limit, speeds
        free = np.isinf(limit)
        self.speed[rows] = np.where(free, speeds, self.speed[rows])
        for state in (self._change, self._late):
            state[rows] = np.where(free, 0.0, state[rows])

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
        radius, start, goal = self._radius[rows], self.speed[rows], self._goal[rows]
        mass, limit = self._inertia[rows] / radius**2, self._limit[rows] / radius
        guess = start + self._change[rows]
        short = (goal - start) * (goal - guess) > 0
        search = _Search(
            goal=goal,
            limit=limit,
            mass=mass / step,
            offset=mass / step * start + self._late[rows] / step,
            tolerance=_TOLERANCE * np.where(np.isinf(limit), 0.0, limit) + self._noise,
            slope=self._slope[rows],
            speed=np.where(short, guess, goal),
        )
        going = np.arange(len(rows))
        for _ in range(_ATTEMPTS):
            going = search.improve(going, attempt(rows[going], search.speed[going]))
            if not going.size:
                break
        speed, force = search.tried, search.force
        self._late[rows] += step * (force - search.traction) - mass * (speed - start)
        self._power[rows] = force * (start + speed) / 2
        self._energy[rows] += self._power[rows] * step
        self._torque[rows], self._change[rows] = force * radius, speed - start
        self.speed[rows], self._slope[rows] = speed, search.slope


class _Search:
    """Search for the speeds (R, T) at which motors, belts and the ground are in balance, by quasi-Newton steps."""

    def __init__(
        self,
        goal: Floats,
        limit: Floats,
        mass: Floats,
        offset: Floats,
        tolerance: Floats,
        slope: Floats,
        speed: Floats,
    ) -> None:
        """A motor has to push with mass * speed - offset + traction, in N, to within the `tolerance`."""
        self._goal, self._limit, self._mass, self._offset, self._tolerance = goal, limit, mass, offset, tolerance
        self.slope, self.speed, self.tried = slope, speed, speed.copy()
        self.traction, self.force = np.zeros((2, *goal.shape))
        self._base = speed.copy(), np.zeros(goal.shape), np.zeros(goal.shape)  # where the last line began

    def improve(self, going: NDArray[np.int_], traction: Floats) -> NDArray[np.int_]:
        """Those of the simulations `going` (A,) that need another attempt, given the tractions (A, T) at `speed`."""
        goal, limit, mass, speed = self._goal[going], self._limit[going], self._mass[going], self.speed[going]
        needed = mass * speed - self._offset[going] + traction
        reached = speed == goal
        ahead = np.sign(goal - speed) * np.where(reached, 0.0, limit)  # all it has, until the set point is reached
        force = np.where(reached, np.clip(needed, -limit, limit), ahead)
        missing = needed - force
        self.tried[going], self.traction[going], self.force[going] = speed, traction, force

        base, traction_there, missing_there = (each[going] for each in self._base)
        moved = speed - base
        slope = self.slope[going] = _updated(self.slope[going], moved, traction - traction_there)
        short, over = -(missing_there * moved).sum(axis=1), (missing * moved).sum(axis=1)  # it rises along a line

        free = ~reached | (missing != 0)
        each = np.eye(speed.shape[1])
        stiff = np.where(free[:, :, None] & free[:, None], slope + mass[..., None] * each, each)
        to = speed - np.linalg.solve(stiff, np.where(free, missing, 0.0)[..., None])[..., 0]
        to = np.where(force * (to - goal) > 0, goal, to)  # no further than the set point

        back = (over > 0.7 * short)[:, None]  # much too far: between the two
        part = np.clip(short / np.where(back[:, 0], short + over, 1.0), 0.1, 0.9)[:, None]
        self.speed[going] = np.where(back, base + part * moved, to)
        for kept, new in zip(self._base, (speed, traction, missing), strict=True):
            kept[going] = np.where(back, kept[going], new)
        return going[(np.abs(missing) > self._tolerance[going]).any(axis=1)]


def _updated(slope: Floats, moved: Floats, risen: Floats) -> Floats:
    """Slopes (R, T, T) that explain by how much tractions have risen (R, T) when speeds moved (R, T): BFGS."""
    along = np.einsum("nij,nj->ni", slope, moved)
    expected = (moved * along).sum(axis=1)[:, None, None]
    moves = expected > 0
    rise = np.maximum((moved * risen).sum(axis=1)[:, None, None], _FLATTEST * expected)
    before = along[:, :, None] * along[:, None] / np.where(moves, expected, 1.0)
    after = risen[:, :, None] * risen[:, None] / np.where(moves, rise, 1.0)
    return np.where(moves, slope - before + after, slope)


def _numbers(name: str, values: ArrayLike, shape: tuple[int, int], least: float, most: float = np.inf) -> Floats:
    """Numbers of this shape (R, T) from one for all, one a belt, or all of them."""
    try:
        found = np.broadcast_to(np.asarray(values, float), shape)
    except (TypeError, ValueError):
        found = np.full(shape, np.nan)
    allowed = f"a number of at least {least:g}, or one for each of {shape[1]} belts"
    require(((found >= least) & (found <= most)).all(), name, values, allowed)
    return found
