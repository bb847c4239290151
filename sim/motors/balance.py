"""The balance of motors, belts and ground: the speeds that motors of limited torque reach in a
step.

A sprocket with the moment of inertia J and the radius r, from the speed w0 at the beginning of a
step of length h, obeys the implicit equation

    J (w - w0) / h - owed + loss(w) + r F(w) = T,                                                (1)

in which F is the traction of its belt, averaged over the step, and T the torque of its motor.
Earlier steps are solved within tolerances only; what is missing of their angular momentum, over h,
is `owed` to this one. The left side is the torque that the sprocket *needs* at the speed w. What
its motor exerts depends on the demanded speed g: a belt's set point, or the speed at which a servo
with a lag wants to be at the end of its period. The motor pulls or brakes as hard as it can
elsewhere, and as hard as it must there,

    T = largest(w)                        for w < g,
    T = smallest(w)                       for w > g,                                             (2)
    smallest(g) <= T <= largest(g)        for w = g.

Why implicit: the ground responds within the step. Where it holds a robot, the traction rises by
hundreds of robot weights per m/s, so an explicit step diverges with the inertia of any real belt.

Why it has one solution: with the speed, the needed torque rises (in the engine's contacts, the
traction is the gradient of a convex function of the speeds), while (2) falls. The *excess* of the
needed torque over the motor's therefore crosses zero once. The same holds for all sprockets of a
robot together: the excesses are a monotone function of the speeds. Over several steps of the
engine, as in a servo period, that isn't proved, but found to hold.

How it is found: only the engine knows F(w), and each evaluation is a step from the same state. The
slopes of the load r F over the speeds of all sprockets of a robot are a symmetric matrix S (T, T),
which is learnt from the differences between tries. Each round has three parts:

    try      the engine's step at the proposed speeds, which gives loads, torques and excesses;
    update   S from the change in loads since the beginning of the move (BFGS, damped by Powell);
    propose  new speeds: where the excess would vanish if the load had the slope S (Newton), but not
             past a demanded speed; or, if the last move went far too far, a speed in between.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim.motors.motor import TorqueLaw
from trackslip.errors import RobotWarning, counted

Array = NDArray[np.floating[Any]]
Rows = NDArray[np.int_]
Mask = NDArray[np.bool_]
Attempt = Callable[[Rows, Array], Array]
"""Steps the robots (A,) from their state before the step, with sprocket speeds (A, T) [rad/s], and
returns their loads (A, T), the tractions times the radii [N m].
"""

ROUGHNESS: Final = 2e-4
"""Numerical noise in the ground's forces, which the engine iterates, relative to the weight [-].
Worlds add it to `Balance.tolerance`.
"""
TOLERANCE: Final = 0.001
"""Part of `Balance.tolerance` that is in proportion to the torque of which a motor is capable [-].
With 0.005, flat ground and terrain differ by more than 0.5 % (test_worlds).
"""
_ATTEMPTS: Final = 40
_FLATTEST: Final = 0.1  # least slope of the load for sliding belts, relative to the previous one
# speed step for the slopes of losses and limits, shorter than losses take to change sign [rad/s]
_STEP: Final = 0.01
_OVERSHOT: Final = 0.7  # excess beyond zero, relative to that before, from which a move is undone
_SHORTEST: Final = 0.3  # least part of a move that is kept when it is undone


@dataclass
class Tries:
    """Speeds that R robots with T sprockets each have tried, and what came of them."""

    numbers: Array
    """The four arrays below, together (4, R, T)."""

    @classmethod
    def of(cls, omega: Array, load: Array, torque: Array, excess: Array) -> Tries:
        """Tries from their speeds, loads, torques and excesses, each (R, T)."""
        return cls(np.array([omega, load, torque, excess]))

    @property
    def omega(self) -> Array:
        """Speeds (R, T) [rad/s]."""
        return self.numbers[0]

    @property
    def load(self) -> Array:
        """Loads (R, T), the tractions times the radii [N m]."""
        return self.numbers[1]

    @property
    def torque(self) -> Array:
        """Torques (R, T) of the motors [N m]."""
        return self.numbers[2]

    @property
    def excess(self) -> Array:
        """Needed torques minus those of the motors (R, T) [N m]."""
        return self.numbers[3]

    def __getitem__(self, rows: Rows | Mask) -> Tries:
        """The tries of some robots."""
        return Tries(self.numbers[:, rows])

    def __setitem__(self, rows: Rows | Mask, tries: Tries) -> None:
        """Replace the tries of some robots."""
        self.numbers[:, rows] = tries.numbers


@dataclass(frozen=True)
class Balance:
    """The equations (1) and (2) for R robots with T sprockets each."""

    law: TorqueLaw
    """Limits and losses of all motors."""
    torque_limit: Array
    """Torque limits (R, T), of the amplifiers' current; infinite without a limit [N m]."""
    inertia_per_step: Array
    """Moments of inertia over the length of the step (R, T) [kg m^2/s]."""
    start: Array
    """Speeds (R, T) at the beginning of the step [rad/s]."""
    goal: Array
    """Demanded speeds (R, T) [rad/s]."""
    owed: Array
    """Angular momenta that earlier steps have given too little of, over the length of the step (R,
    T) [N m].
    """
    tolerance: Array
    """Largest excesses (R, T) of a solution [N m]."""

    def solve(self, omega: Array, slope: Array, attempt: Attempt) -> tuple[Tries, Array]:
        """Solve the equations; return the solution, and the slopes (R, T, T) of the loads over the
        speeds [N m s/rad].

        `omega` (R, T) are the speeds to try first, `slope` (R, T, T) the slopes so far. The last
        attempt of each robot is the solution. A RobotWarning reports robots that haven't converged
        after 40 attempts.
        """
        proposal = omega.copy()
        slope = slope.copy()
        zero = np.zeros_like(omega)
        last = Tries.of(omega, zero, zero, zero)  # of each robot
        base = Tries.of(omega, zero, zero, zero)  # where the current move of each robot began
        going: Rows = np.arange(len(omega))
        with np.errstate(all="ignore"):  # in case a simulation diverges
            for number in range(_ATTEMPTS):
                tried = self._try(going, proposal[going], attempt)
                last[going] = tried
                began = base[going]
                if number > 0:  # before the first move, there is nothing to learn from
                    slope[going] = updated_slope(
                        slope[going],
                        tried.omega - began.omega,
                        tried.load - began.load,
                        self.tolerance[going],
                    )

                # Robots that are in balance have finished, and so have those that have diverged:
                # their excess isn't a number, and the engine's warnings tell of them.
                unbalanced = np.logical_or.reduce(
                    np.abs(tried.excess) > self.tolerance[going], axis=1
                )
                going = going[unbalanced]
                if not going.size:
                    return last, slope
                tried = tried[unbalanced]
                began = began[unbalanced]
                proposal[going], moved_on = self._propose(going, slope[going], tried, began)
                base[going[moved_on]] = tried[moved_on]
        what = f"after {_ATTEMPTS} attempts in a step, motors are not in balance with the ground"
        warnings.warn(
            f"{what}: those of {counted(len(going), 'robot')}", RobotWarning, stacklevel=3
        )
        return last, slope

    def own_torque(self, rows: Rows, omega: Array) -> Array:
        """Torques (..., A, T) that the sprockets of the robots `rows` (A,) need besides their
        loads, at speeds (..., A, T).
        """
        accelerating = self.inertia_per_step[rows] * (omega - self.start[rows])
        return accelerating + self.law.loss(omega) - self.owed[rows]

    def _try(self, rows: Rows, omega: Array, attempt: Attempt) -> Tries:
        """Try speeds (A, T) of the robots `rows` (A,)."""
        load = attempt(rows, omega)
        needed = self.own_torque(rows, omega) + load
        smallest, largest = self.law.limits(omega, self.torque_limit[rows])
        goal = self.goal[rows]
        within = np.minimum(np.maximum(needed, smallest), largest)
        torque = np.where(omega < goal, largest, np.where(omega > goal, smallest, within))
        return Tries.of(omega, load, torque, needed - torque)

    def _propose(
        self, rows: Rows, slope: Array, tried: Tries, began: Tries
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Speeds (A, T) to try next, and a mask (A,) of the robots whose next move begins at
        `tried`; those of the others begin where the last one did.
        """
        moved = tried.omega - began.omega
        # Along the move, the excess rises from below zero to above zero. Both, times the changes in
        # speed, are a robot's `short` and `over`.
        short = -(began.excess * moved).sum(axis=1)
        over = (tried.excess * moved).sum(axis=1)
        overshot = (over > _OVERSHOT * short) & (short > 0)
        share = short / np.where(overshot, short + over, 1.0)  # where the excess is zero
        between = began.omega + np.maximum(share, _SHORTEST)[:, None] * moved

        each = np.eye(slope.shape[-1])
        whole = slope + self._own_slope(rows, tried.omega)[..., None] * each
        newton = without_excess(whole, tried, self.goal[rows])
        return np.where(overshot[:, None], between, newton), ~overshot

    def _own_slope(self, rows: Rows, omega: Array) -> Array:
        """Slopes (A, T) of the excess over the speeds (A, T) for constant loads: of inertia, losses
        and limits.
        """
        around = np.array([omega - _STEP, omega + _STEP])
        smallest, largest = self.law.limits(around, self.torque_limit[rows])
        limit = np.where(omega < self.goal[rows], largest, smallest)
        limit = np.where(np.isinf(limit), 0.0, limit)  # of a motor that is always at its set point
        below, above = self.law.loss(around) - limit
        return np.asarray(self.inertia_per_step[rows] + (above - below) / (2 * _STEP))


def without_excess(slope: Array, tried: Tries, goal: Array) -> Array:
    """Speeds (A, T) without excess torque, given the slopes (A, T, T) of the excess over the
    speeds; no sprocket moves past its set point `goal` (A, T).

    A sprocket at its set point without an excess stays there. If others would pass theirs, the
    first to arrive stays there, too, and the equations are solved again for the rest.
    """
    each = np.eye(tried.omega.shape[1])
    moving = (tried.omega != goal) | (tried.excess != 0)
    # Where the set point is: ahead (1) or behind (-1). A sprocket that is there with an excess
    # slows down, so that its set point will lie ahead.
    side = np.where(tried.omega == goal, np.sign(tried.excess), np.sign(goal - tried.omega))
    to = tried.omega
    sprockets = len(each)
    for _ in range(sprockets):
        # the sprockets that stay have moved, too, which changes the excess of the others
        stayed = np.where(moving, 0.0, to - tried.omega)
        excess = tried.excess + np.einsum("nij,nj->ni", slope, stayed)
        excess = np.where(moving, excess, 0.0)
        equations = np.where(moving[:, :, None] & moving[:, None], slope, each)
        change = -np.linalg.solve(equations, excess[..., None])[..., 0]
        to = np.where(moving, tried.omega + change, to)

        passes = moving & (side * (to - goal) > 0)
        way = np.where(passes, to - tried.omega, 1.0)
        share = np.where(passes, (goal - tried.omega) / way, np.inf)
        first = passes & (share == share.min(axis=1, keepdims=True))
        to = np.where(first, goal, to)
        moving = moving & ~first
    return to


def updated_slope(slope: Array, moved: Array, risen: Array, noise: Array) -> Array:
    """Slopes (A, T, T) that explain the rise of the loads `risen` (A, T) after a change in speeds
    `moved` (A, T); changes within the `noise` (A, T) are ignored.

    The update of Broyden, Fletcher, Goldfarb and Shanno replaces the curvature along the move m,
    with the expected rise S m, by the seen rise y:

        S - (S m)(S m)' / (m' S m) + y y' / (m' y).

    It keeps S positive while m' y > 0. Powell's damping mixes y with S m, so that m' y is at least
    a tenth of m' S m: sliding belts have no slope.
    """
    foreseen = np.einsum("nij,nj->ni", slope, moved)
    curvature = (moved * foreseen).sum(axis=1)[:, None, None]
    is_clear = (np.maximum(np.abs(foreseen), np.abs(risen)) > noise).any(axis=1)[:, None, None]
    is_usable = (curvature > 0) & is_clear

    seen = (moved * risen).sum(axis=1)[:, None, None]
    is_flat = seen < _FLATTEST * curvature
    mixed = (1 - _FLATTEST) * curvature / np.where(is_flat, curvature - seen, 1.0)
    share = np.where(is_flat, mixed, 1.0)[..., 0]
    risen = share * risen + (1 - share) * foreseen
    seen = np.maximum(seen, _FLATTEST * curvature)

    before = foreseen[:, :, None] * foreseen[:, None] / np.where(is_usable, curvature, 1.0)
    after = risen[:, :, None] * risen[:, None] / np.where(is_usable, seen, 1.0)
    return np.where(is_usable, slope - before + after, slope)
