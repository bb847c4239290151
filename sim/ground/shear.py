"""Shear of the ground under the tracks of a fleet: how far each element has moved over it, and what share of the
friction acts on it.

An element of track touches down at the front of a belt that drives forwards and is carried to the rear. P_i(t) is the
place of the point x_i of the robot in the world, V the belt's speed. In a period dt, the displacement there becomes

    j_i <- j(x_i + V dt) + P_i(t + dt) - P(t, x_i + V dt)

and j = 0 where elements touch down. Between points j is a parabola through three of them. The share is the mean of
1 - exp(-a) over the cell of a point, a = |j + tau dj/dt| / K varying linearly (Janosi and Hanamoto 1961, Wong and
Chiang 2001). tau takes away a ripple of speed that the servo's period causes; steady states don't depend on it.
"""

from __future__ import annotations

import math

import numpy as np

from sim.bodies import Rows
from sim.robot.robot import Robot
from trackslip.kinematics import Array, wrap_angle

LARGEST = 20.0
"""Displacement beyond which nothing is remembered, over the shear modulus: the friction acts in full."""
LEAST_SHARE = 1e-5
"""Smallest share of the friction, which the engine needs [-]."""
_AHEAD = 0.02  # tau [s]
_COURANT = 0.5  # largest part of a cell that an element moves in a step
_FLAT = 1e-6  # smallest variation over a cell that is accounted for, over the shear modulus
_HALVINGS = 60
_FRONT, _REAR = -1, 0


class Shear:
    """Displacements and shares at the P points of N robots' tracks, whose pads touch the ground at one point each."""

    def __init__(self, robot: Robot, size: int, period: float, top_speed: float) -> None:
        """`size` robots at rest; belts run no faster than `top_speed` [m/s], and a servo `period` is in [s]."""
        points = len(robot.pad_side) // 2
        self._along, self._across = (column.reshape(2, points) for column in robot.pad_position.T)
        self._cell = 2 * robot.contact_half_length / points
        self._period = period
        self._steps = max(1, math.ceil(top_speed * period / (_COURANT * self._cell)))
        self._moved = np.zeros((2, size, 2, points))  # x, y in the world; robots, tracks, points from the rear
        self.share = np.ones((size, 2 * points))
        """Share (N, P) of the friction that acts at each point in the next period [-]."""

    @property
    def displacement(self) -> Array:
        """Shear displacements (N, P, 2) in the world's axes [m]."""
        return np.moveaxis(self._moved, 0, -1).reshape(*self.share.shape, 2).copy()

    def snapshot(self, rows: Rows) -> tuple[Array, Array]:
        """The state of the robots `rows` (R,)."""
        return self._moved[:, rows].swapaxes(0, 1).copy(), self.share[rows].copy()

    def restore(self, rows: Rows, moved: Array, share: Array) -> None:
        """Go back to a snapshot of the robots `rows` (R,)."""
        self._moved[:, rows], self.share[rows] = moved.swapaxes(0, 1), share

    def forget(self, rows: Rows) -> None:
        """Let the friction act in full under the robots `rows` (R,), as on Coulomb ground."""
        self._moved[:, rows], self.share[rows] = 0.0, 1.0

    def advance(self, rows: Rows, before: Array, after: Array, belt: Array, modulus: Array) -> None:
        """Carry the elements under the robots `rows` (R,) on by a period.

        Args:
            rows: the robots that have moved.
            before, after: their poses (R, 3) [m, m, rad].
            belt: speeds (R, 2) of their belts, positive forwards [m/s].
            modulus: shear moduli (R, P) under their points [m].
        """
        old = self._moved[:, rows]
        travel = belt * (self._period / self._steps)
        change = after - before
        change[:, 2] = wrap_angle(change[:, 2])
        new, part = old, change / self._steps
        for step in range(self._steps):
            new = self._carried(new, before + step * part, part, travel)
        modulus = modulus.reshape(new.shape[1:])
        ahead = new + (new - old) * (_AHEAD / self._period)
        excess = np.sqrt(new[0] ** 2 + new[1] ** 2) / np.maximum(LARGEST * modulus, 1e-300)
        if (excess > 1).any():
            new = new / np.maximum(excess, 1.0)
        self._moved[:, rows] = new
        self.share[rows] = _share(np.sqrt(ahead[0] ** 2 + ahead[1] ** 2), modulus, belt).reshape(len(belt), -1)

    def _carried(self, moved: Array, pose: Array, part: Array, travel: Array) -> Array:
        """Displacements (2, R, 2, P) of elements that `travel` (R, 2) [m] while poses (R, 3) change by `part` (R, 3)."""
        padded = np.empty((*moved.shape[:-1], moved.shape[-1] + 2))
        padded[..., 1:-1] = moved
        for end, inwards, enters in ((_FRONT, -1, travel > 0), (_REAR, 1, travel < 0)):
            first, second, third = (moved[..., end + k * inwards] for k in range(3))
            # parabolas through the end of the contact, where j = 0, or on beyond the last point
            padded[..., end] = np.where(enters, second / 3 - 2 * first, 3 * (first - second) + third)
        c = (travel / self._cell)[..., None]
        new = (1 - c * c) * moved + (c * (c + 1) / 2) * padded[..., 2:] + (c * (c - 1) / 2) * padded[..., :-2]
        third = np.diff(padded, 3, axis=-1) * (c * (c * c - 1) / 6)
        new[..., :-1] += np.where(c > 0, third, 0.0)
        new[..., 1:] += np.where(c < 0, third, 0.0)
        heading, turned = pose[:, 2:], pose[:, 2:] + part[:, 2:]
        cos, sin = np.cos(heading), np.sin(heading)
        more_cos, more_sin = np.cos(turned) - cos, np.sin(turned) - sin
        across = self._across[:, 0]
        new[0] += (part[:, :1] - across * more_sin - cos * travel)[..., None] + more_cos[..., None] * self._along
        new[1] += (part[:, 1:2] + across * more_cos - sin * travel)[..., None] + more_sin[..., None] * self._along
        return new

    def rest(self, rows: np.ndarray, heading: Array, required: Array, surface: Array) -> None:
        """Let the ground hold the robots `rows` (R,) at rest: every element has moved equally far, and just far enough.

        Args:
            rows: the robots.
            heading: theirs (R,) [rad].
            required: forces (R, 2) that the ground exerts along and across them, over their normal force.
            surface: friction along and across and shear modulus (R, P, 3) at their points.
        """
        friction, modulus = surface[..., :2].mean(axis=1), surface[..., 2]
        needed = np.hypot(*(required / friction).T)
        low, high = np.zeros(len(rows)), LARGEST * modulus.max(axis=1)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            enough = self._share_at_rest(middle, modulus).mean(axis=1) >= needed
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        push = -required / friction**2  # where it slides to, by maximum dissipation
        size = np.hypot(*push.T)
        x, y = (push / np.where(size > 0, size, 1.0)[:, None] * high[:, None]).T
        cos, sin = np.cos(heading), np.sin(heading)
        world = np.stack([cos * x - sin * y, sin * x + cos * y])
        self._moved[:, rows] = world[..., None, None]
        self.share[rows] = self._share_at_rest(np.where(size > 0, high, 0.0), modulus)

    def _share_at_rest(self, distance: Array, modulus: Array) -> Array:
        """Shares (R, P) where all elements have moved by distances (R,) [m]."""
        by_track = modulus.reshape(len(modulus), 2, -1)
        even = np.broadcast_to(distance[:, None, None], by_track.shape)
        return _share(even, by_track, np.zeros(by_track.shape[:2])).reshape(modulus.shape)


def _share(distance: Array, modulus: Array, belt: Array) -> Array:
    """Shares (R, 2, P) after displacements (R, 2, P) [m] over moduli (R, 2, P) [m], of belts with speeds (R, 2)."""
    hard = modulus == 0
    a = distance / np.where(hard, 1.0, modulus)
    half = np.empty_like(a)  # of the change over a cell
    half[..., 1:-1] = (a[..., 2:] - a[..., :-2]) / 4
    half[..., _FRONT] = np.where(belt > 0, a[..., _FRONT], (a[..., -1] - a[..., -2]) / 2)
    half[..., _REAR] = np.where(belt < 0, a[..., _REAR], (a[..., 1] - a[..., 0]) / 2)
    half = np.maximum(np.minimum(np.abs(half), a), _FLAT)
    # in this form no exponential grows beyond 1, however firm the ground
    share = 1 - (np.exp(half - a) - np.exp(-half - a)) / (2 * half)
    return np.where(hard, 1.0, np.maximum(share, LEAST_SHARE))
