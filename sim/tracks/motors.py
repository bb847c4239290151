"""Belt motors: the belt speeds after a physics step for which motors, belts and ground are in
balance.

A belt with the inertia J and the sprocket radius r obeys J dw/dt = T - r F for the motor torque T
and the traction F. The ground responds within a step: where it holds a robot, the traction rises by
some 200 robot weights per m/s, so an explicit step diverges whatever the belt inertia. A step is
therefore implicit: it is repeated until each motor can exert the force that its belt needs at the
new speed. That force may have any value within the motor's limits at the set point, and is equal to
a limit at other speeds. In the engine's contacts, the traction is the gradient of a convex function
of the speeds, so the solution is unique; quasi-Newton steps find it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import RobotWarning, counted, require

# tolerance on a motor's force, relative to its limit; the next step corrects the error
_TOLERANCE = 0.005
# numerical noise in the ground's forces, which the engine iterates, relative to the robot's weight
_ROUGHNESS = 2e-4

Floats = NDArray[Any]
Rows = NDArray[Any]
_ATTEMPTS = 40
_FLATTEST = 0.1  # least slope of the traction for sliding belts, relative to the previous slope [-]


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


class Motors:
    """Motors of T belts in each of N simulations; all states are (N, T)."""

    def __init__(self, size: int, radius: Floats, weight: float, slope: float) -> None:
        """Start at rest, without limits.

        Args:
            size: number of simulations.
            radius: radii of the sprockets (T,) [m].
            weight: the robot's weight [N].
            slope: increase in traction with belt speed for a robot that is free to move [N s/m].
        """
        shape = size, len(radius)
        self._radius, self._noise = radius, _ROUGHNESS * weight / len(radius)
        self._least = np.eye(len(radius)) * slope / len(radius)  # (T, T)
        # (N, T, T) slopes of the traction over belt speed
        self._slope = np.zeros((*shape, len(radius)))
        self._state = np.zeros((9, *shape))
        self._goal, self._change, self._late, self._inertia, self._limit = self._state[:5]
        self.speed, self._torque, self._power, self._energy = self._state[5:]
        self.begin(np.arange(size))

    def begin(self, rows: NDArray[np.int_]) -> None:
        """Reset the motors in the simulations `rows` to rest, without limits."""
        self._state[:, rows], self._limit[rows], self._slope[rows] = 0.0, np.inf, self._least

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
        """Change set points (R, T) in the simulations `rows`; belts without a limit reach these
        speeds at once.
        """
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
        """Set points (R, T) in the simulations `rows` [m/s]."""
        return self._goal[rows]

    def limited(self, rows: NDArray[np.int_]) -> bool:
        """Whether any motor in the simulations `rows` has a limit."""
        return bool(np.isfinite(self._limit[rows]).any())

    def hold(self, rows: NDArray[np.int_], step: float, traction: Floats) -> NDArray[np.bool_]:
        """Advance the simulations with motors that are strong enough for their set points; return
        their mask (R,).

        `traction` (R, S, T) has the tractions at the set points in S physics steps [N].
        """
        goal, start, limit = self._goal[rows], self.speed[rows], self._limit[rows] / self._radius
        force = traction.copy()
        force[:, 0] += (
            self._inertia[rows] / self._radius**2 * (goal - start) - self._late[rows]
        ) / step
        held: NDArray[np.bool_] = np.logical_and.reduce(
            np.abs(force) <= limit[:, None], axis=(1, 2)
        )
        power = force * goal[:, None]
        power[:, 0] = force[:, 0] * (start + goal) / 2
        kept = rows[held]
        self.speed[kept], self._late[kept], self._change[kept] = goal[held], 0.0, 0.0
        self._torque[kept], self._power[kept] = (force[:, -1] * self._radius)[held], power[held, -1]
        self._energy[kept] += power[held].sum(axis=1) * step
        return held

    def read(self, rows: int | slice = slice(None)) -> MotorReading:
        """Motor readings (N, T), or (T,) for a single simulation."""
        return MotorReading(
            *(each[rows].copy() for each in (self._torque, self.speed, self._power, self._energy))
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
            required=lambda going, speed, traction: (
                mass[going] / step * speed - offset[going] + traction
            ),
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
    """Checked numbers: a scalar, one per belt (T,), or one per simulation and belt (R, T)."""
    try:
        given = np.asarray(values, float)
    except (TypeError, ValueError):
        given = np.array(np.nan)
    fits = given.shape in ((), shape[1:], shape) and ((given >= 0.0) & (given <= most)).all()
    require(fits, name, values, f"a number of at least 0, or one for each of {shape[1]} belts")
    return given


@dataclass
class Balance:
    """Balance of T belt motors on each of R robots in a step, in consistent units of force (or
    torque) and speed.
    """

    goal: Floats  # (R, T) set points of the speeds
    speed: Floats  # (R, T) speeds to try first
    # (R, T, T) approximate slopes of the traction over the speeds, which `solve` improves
    slope: Floats
    tolerance: Floats  # (R, T) tolerance on the motors' forces
    required: Callable[[Rows, Floats, Floats], Floats]
    """Forces (A, T) that the belts of robots (A,) need at speeds and tractions (A, T); they rise
    with the speed.
    """
    limits: Callable[[Rows, Floats], tuple[Floats, Floats]]
    """Smallest and largest forces (A, T) of the motors on robots (A,) at speeds (A, T)."""
    stiffness: Callable[[Rows, Floats], Floats]
    """Slopes (A, T) at speeds (A, T) of `required` minus those of `limits`, for a constant
    traction.
    """

    def solve(self, attempt: Callable[[Rows, Floats], Floats]) -> tuple[Floats, Floats]:
        """Find the speeds, store them in `speed`, and return tractions and motor forces (R, T) at
        these speeds.

        `attempt` steps robots (A,) from their state before the step, at speeds (A, T), and returns
        tractions (A, T). Each robot keeps the result of its last attempt; a RobotWarning reports
        robots that haven't converged after 40 attempts.
        """
        going = np.arange(len(self.goal))
        tried, traction, force = self.speed.copy(), *np.zeros((2, *self.goal.shape))
        # speed, traction and excess, from which a search begins
        base = tried.copy(), *np.zeros((2, *self.goal.shape))
        for _ in range(_ATTEMPTS):
            tried[going] = self.speed[going]
            traction[going] = attempt(going, tried[going])
            force[going], excess = self._force(going, tried[going], traction[going])
            further: Rows = np.logical_or.reduce(np.abs(excess) > self.tolerance[going], axis=1)
            with np.errstate(all="ignore"):  # in case a simulation diverges
                self._next(
                    going, tried[going], traction[going], force[going], excess, base, further
                )
            going = going[further]
            if not going.size:
                break
        else:
            what = (
                f"after {_ATTEMPTS} attempts in a step, motors are not in balance with the ground"
            )
            warnings.warn(
                f"{what}: those of {counted(len(going), 'robot')}", RobotWarning, stacklevel=4
            )
        self.speed = tried
        return traction, force

    def _force(self, rows: Rows, speed: Floats, traction: Floats) -> tuple[Floats, Floats]:
        """Motor forces (A, T), and the excess (A, T) of the required forces over the motor
        forces.
        """
        needed, (least, most), goal = (
            self.required(rows, speed, traction),
            self.limits(rows, speed),
            self.goal[rows],
        )
        force = np.where(
            speed == goal, np.clip(needed, least, most), np.where(speed < goal, most, least)
        )
        return force, needed - force

    def _next(
        self,
        rows: Rows,
        speed: Floats,
        traction: Floats,
        force: Floats,
        excess: Floats,
        base: tuple[Floats, ...],
        further: Rows,
    ) -> None:
        """Update the slopes, and choose the next speeds to try for the robots in the mask `further`
        (A,).
        """
        moved = speed - base[0][rows]
        self.slope[rows] = _updated(
            self.slope[rows], moved, traction - base[1][rows], self.tolerance[rows]
        )
        if not further.any():
            return
        parts = rows, speed, traction, force, excess, moved
        rows, speed, traction, force, excess, moved = (each[further] for each in parts)
        goal, slope, from_speed, from_excess = (
            self.goal[rows],
            self.slope[rows],
            base[0][rows],
            base[2][rows],
        )
        # the excess rises along a line
        short, over = -(from_excess * moved).sum(axis=1), (excess * moved).sum(axis=1)

        whole = slope + self.stiffness(rows, speed)[..., None] * np.eye(speed.shape[1])
        to = _newton(whole, excess, speed, goal, force)

        # far past zero excess: try a speed in between
        back = ((over > 0.7 * short) & (short > 0))[:, None]
        # at most 1 / 1.7
        part = np.maximum(short / np.where(back[:, 0], short + over, 1.0), 0.3)[:, None]
        self.speed[rows] = np.where(back, from_speed + part * moved, to)
        for began, now in zip(base, (speed, traction, excess), strict=True):
            began[rows] = np.where(back, began[rows], now)


def _newton(slope: Floats, excess: Floats, speed: Floats, goal: Floats, force: Floats) -> Floats:
    """Speeds (A, T) without excess force, given slopes (A, T, T); no belt moves past its set
    point.
    """
    each = np.eye(speed.shape[1])
    moving, to = (speed != goal) | (excess != 0), speed
    for _ in each:
        at_rest = np.where(moving, 0.0, to - speed)
        left = np.where(moving, excess + np.einsum("nij,nj->ni", slope, at_rest), 0.0)
        alone = np.where(moving[:, :, None] & moving[:, None], slope, each)
        to = np.where(moving, speed - np.linalg.solve(alone, left[..., None])[..., 0], to)
        passes = moving & (force * (to - goal) > 0)
        part = np.where(passes, (goal - speed) / np.where(passes, to - speed, 1.0), np.inf)
        # stays at its set point; next, solve for the others
        first = passes & (part == part.min(axis=1, keepdims=True))
        to, moving = np.where(first, goal, to), moving & ~first
    return to


def _updated(slope: Floats, moved: Floats, risen: Floats, noise: Floats) -> Floats:
    """Slopes (A, T, T) that explain the rise in tractions (A, T) after a change in speeds `moved`
    (A, T).

    The update is that of Broyden, Fletcher, Goldfarb and Shanno with Powell's damping.
    """
    along = np.einsum("nij,nj->ni", slope, moved)
    expected = (moved * along).sum(axis=1)[:, None, None]
    clear = (np.maximum(np.abs(along), np.abs(risen)) > noise).any(axis=1)[:, None, None]
    moves = (expected > 0) & clear
    # if the traction rises by less than _FLATTEST of the expected rise, mix both rises to keep the
    # slope positive
    rise = (moved * risen).sum(axis=1)[:, None, None]
    flat = rise < _FLATTEST * expected
    part = np.where(flat, (1 - _FLATTEST) * expected / np.where(flat, expected - rise, 1.0), 1.0)[
        ..., 0
    ]
    risen = part * risen + (1 - part) * along
    rise = np.maximum(rise, _FLATTEST * expected)
    before = along[:, :, None] * along[:, None] / np.where(moves, expected, 1.0)
    after = risen[:, :, None] * risen[:, None] / np.where(moves, rise, 1.0)
    return np.where(moves, slope - before + after, slope)
