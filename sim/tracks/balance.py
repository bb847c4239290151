"""The speeds at which motors, belts and the ground are in balance at the end of a step.

The ground answers within a step: where it holds a robot, the traction rises by some 200 robot weights per m/s, so that
an explicit step diverges whatever the inertia of the belts is. A step is therefore implicit: it is tried until the
force that each belt takes at its new speed is one that its motor has: any within its limits at the set point, and the
limit on the way there. Because the traction is the gradient of a convex function of the speeds, as the engine's
contacts are, there is one solution; quasi-Newton steps find it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackslip.errors import RobotWarning

_ATTEMPTS = 40
_FLATTEST = 0.1  # slope of the traction where the belts slide, relative to the slope before, at least [-]

Floats = NDArray[Any]
Rows = NDArray[Any]


@dataclass
class Balance:
    """The motors of T belts of R robots in a step, in one unit of force (or torque) and of speed."""

    goal: Floats  # (R, T) set points
    speed: Floats  # (R, T) to try first
    slope: Floats  # (R, T, T) of the traction over the speeds, about; afterwards as it was found
    tolerance: Floats  # (R, T) of the forces
    required: Callable[[Rows, Floats, Floats], Floats]
    """Forces (A, T) that the belts of some robots (A,) take at speeds and tractions (A, T); rising with the speed."""
    limits: Callable[[Rows, Floats], tuple[Floats, Floats]]
    """Smallest and largest forces (A, T) of their motors at speeds (A, T)."""
    stiffness: Callable[[Rows, Floats], Floats]
    """Slopes (A, T) of `required` without the traction, less those of the limits, over speeds (A, T)."""

    def solve(self, attempt: Callable[[Rows, Floats], Floats]) -> tuple[Floats, Floats]:
        """Tractions and forces (R, T) at the speeds found, `speed`.

        `attempt` steps some robots (A,) from where they were before, at speeds (A, T), and gives their tractions
        (A, T); each robot keeps its last attempt. What has not converged after 40 attempts is left as it is, with a
        RobotWarning.
        """
        going = np.arange(len(self.goal))
        tried, traction, force = self.speed.copy(), *np.zeros((2, *self.goal.shape))
        base = tried.copy(), *np.zeros((2, *self.goal.shape))  # speed, traction and excess where the last line began
        for _ in range(_ATTEMPTS):
            tried[going] = self.speed[going]
            traction[going] = attempt(going, tried[going])
            force[going], excess = self._force(going, tried[going], traction[going])
            further: Rows = np.logical_or.reduce(np.abs(excess) > self.tolerance[going], axis=1)
            with np.errstate(all="ignore"):  # a simulation that diverges
                self._next(going, tried[going], traction[going], force[going], excess, base, further)
            going = going[further]
            if not going.size:
                break
        else:
            what = f"motors of {len(going)} of {len(self.goal)} robots are not in balance with the ground"
            warnings.warn(f"{what} after {_ATTEMPTS} attempts in a step", RobotWarning, stacklevel=4)
        self.speed = tried
        return traction, force

    def _force(self, rows: Rows, speed: Floats, traction: Floats) -> tuple[Floats, Floats]:
        """Forces (A, T) of the motors, and what is required beyond them."""
        needed, (least, most), goal = self.required(rows, speed, traction), self.limits(rows, speed), self.goal[rows]
        force = np.where(speed == goal, np.clip(needed, least, most), np.where(speed < goal, most, least))
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
        """Learn the slopes, and choose the speeds to try next of the robots that go `further` (A,)."""
        moved = speed - base[0][rows]
        self.slope[rows] = _updated(self.slope[rows], moved, traction - base[1][rows], self.tolerance[rows])
        if not further.any():
            return
        parts = rows, speed, traction, force, excess, moved
        rows, speed, traction, force, excess, moved = (each[further] for each in parts)
        goal, slope, from_speed, from_excess = self.goal[rows], self.slope[rows], base[0][rows], base[2][rows]
        short, over = -(from_excess * moved).sum(axis=1), (excess * moved).sum(axis=1)  # it rises along a line

        whole = slope + self.stiffness(rows, speed)[..., None] * np.eye(speed.shape[1])
        to = _newton(whole, excess, speed, goal, force)

        back = ((over > 0.7 * short) & (short > 0))[:, None]  # much too far: between the two
        part = np.clip(short / np.where(back[:, 0], short + over, 1.0), 0.3, 0.7)[:, None]
        self.speed[rows] = np.where(back, from_speed + part * moved, to)
        for began, now in zip(base, (speed, traction, excess), strict=True):
            began[rows] = np.where(back, began[rows], now)


def _newton(slope: Floats, excess: Floats, speed: Floats, goal: Floats, force: Floats) -> Floats:
    """Speeds (A, T) at which nothing is in excess, by slopes (A, T, T); no belt is pushed beyond its set point."""
    each = np.eye(speed.shape[1])
    moving, to = (speed != goal) | (excess != 0), speed
    for _ in each:
        at_rest = np.where(moving, 0.0, to - speed)
        left = np.where(moving, excess + np.einsum("nij,nj->ni", slope, at_rest), 0.0)
        alone = np.where(moving[:, :, None] & moving[:, None], slope, each)
        to = np.where(moving, speed - np.linalg.solve(alone, left[..., None])[..., 0], to)
        passes = moving & (force * (to - goal) > 0)
        part = np.where(passes, (goal - speed) / np.where(passes, to - speed, 1.0), np.inf)
        first = passes & (part == part.min(axis=1, keepdims=True))  # the others, once it keeps its set point
        to, moving = np.where(first, goal, to), moving & ~first
    return to


def _updated(slope: Floats, moved: Floats, risen: Floats, noise: Floats) -> Floats:
    """Slopes (A, T, T) that explain by how much tractions have risen (A, T) when speeds moved (A, T).

    By the method of Broyden, Fletcher, Goldfarb and Shanno, damped as Powell does.
    """
    along = np.einsum("nij,nj->ni", slope, moved)
    expected = (moved * along).sum(axis=1)[:, None, None]
    tells = (np.maximum(np.abs(along), np.abs(risen)) > noise).any(axis=1)[:, None, None]
    moves = (expected > 0) & tells
    # where the tractions rise less than that, or fall, take part of what was expected, so that the slope stays positive
    rise = (moved * risen).sum(axis=1)[:, None, None]
    flat = rise < _FLATTEST * expected
    part = np.where(flat, (1 - _FLATTEST) * expected / np.where(flat, expected - rise, 1.0), 1.0)[..., 0]
    risen = part * risen + (1 - part) * along
    rise = np.maximum(rise, _FLATTEST * expected)
    before = along[:, :, None] * along[:, None] / np.where(moves, expected, 1.0)
    after = risen[:, :, None] * risen[:, None] / np.where(moves, rise, 1.0)
    return np.where(moves, slope - before + after, slope)
