"""Shear of the ground under a fleet's tracks: the displacement of each track element, and the share
of the friction that it mobilises.

An element of track touches down at the front of a belt that drives forwards and is carried to the
rear. P_i(t) is the world position of the robot's point x_i, V the belt speed. In a period dt, the
displacement at that point becomes

    j_i <- j(x_i + V dt) + P_i(t + dt) - P(t, x_i + V dt)

with j = 0 where elements touch down. Between points, j is a cubic through four points, one of them
downstream; a parabola through three points would cause ripples that hardly decay. The share is the
mean of 1 - exp(-a) over a point's cell, in which a = |j + tau dj/dt| / K varies linearly (Janosi
and Hanamoto 1961, Wong and Chiang 2001). tau removes a speed ripple due to the servo's period;
steady states don't depend on it.
"""

from __future__ import annotations

import math

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

LARGEST = 20.0
"""Largest stored displacement, relative to the shear modulus, at which friction is fully mobilised
[-].
"""
LEAST_SHARE = 1e-5
"""Smallest share of the friction, as the engine needs friction above zero [-]."""
_AHEAD = 0.02  # tau [s]
_COURANT = 0.5  # largest part of a cell by which an element moves in a step [-]
_FLAT = 1e-6  # least variation over a cell, relative to the shear modulus, that has an effect
_HELD = 1.02  # share of the friction at rest over the share needed, so that no point slides
_MOST_AT_REST = 0.999
_ROUNDS = 10
_TINY = 1e-300
_FRONT, _REAR = -1, 0
_Rows = np.ndarray | slice


class Shear(Restorable):
    """Displacements and shares at the P points of N robots' tracks, whose pads touch the ground at
    one point each.

    A wheel counts as a track with the length of its patch.
    """

    STATE = ("_moved", "share")

    def __init__(
        self, place: Array, patches: int, length: float, size: int, period: float, top_speed: float
    ) -> None:
        """Start without shear.

        Args:
            place: points (P, 2) on the robot, left side first, from rear to front on each side [m].
            patches: number of patches per side, all with the same number of points.
            length: length of a patch [m].
            size: number of robots.
            period: period of the servos [s].
            top_speed: largest speed of a belt [m/s].
        """
        self._patches, points = patches, len(place) // (2 * patches)
        along, across = (column.reshape(2 * patches, points) for column in place.T)
        # (points of a patch, 1, patches), (patches,)
        self._along, self._across = along.T[:, None], across[:, 0]
        self._cell = length / points
        self._period = period
        self._steps = max(1, math.ceil(top_speed * period / (_COURANT * self._cell)))
        # x, y in the world; the first axis is a patch's points, from the rear, because neighbours
        # are needed together
        self._moved = np.zeros((points, 2, size, 2 * patches))
        self.share = np.ones((size, len(place)))
        """Share (N, P) of the friction that acts at each point in the next period [-]."""

    @property
    def displacement(self) -> Array:
        """Shear displacements (N, P, 2) along the world's axes [m]."""
        return self._moved.transpose(2, 3, 0, 1).reshape(*self.share.shape, 2).copy()

    @property
    def by_robot(self) -> tuple[Array, Array]:
        """Views of all arrays that change, with the robots on the first axis."""
        return self._moved.transpose(2, 0, 1, 3), self.share

    def forget(self, rows: _Rows) -> None:
        """Mobilise the full friction under the robots `rows` (R,), as on Coulomb ground."""
        self._moved[:, :, rows], self.share[rows] = 0.0, 1.0

    def advance(
        self, rows: _Rows, before: Array, after: Array, belt: Array, modulus: Array
    ) -> None:
        """Update displacements and shares for a period in which the robots `rows` (R,) move.

        Args:
            rows: indices of the robots that have moved.
            before, after: places of the robots (4, R): position x, y [m], cosine and sine of the
                heading.
            belt: belt speeds (R, 2), positive forwards [m/s].
            modulus: shear moduli (R, P) under the points [m].
        """
        old: Array = np.ascontiguousarray(self._moved[:, :, rows])
        belt = belt.repeat(self._patches, axis=1)
        travel = belt * (self._period / self._steps)
        new: Array = old
        place, part = before, (after - before) / self._steps
        for _ in range(self._steps):  # a period's turn is so small that its chord suffices
            new = self._carried(new, place, part, travel)
            place = place + part
        ahead = new + (new - old) * (_AHEAD / self._period)
        by_patch = modulus.reshape(*belt.shape, -1).transpose(2, 0, 1)
        size, most = np.sqrt(new[:, 0] ** 2 + new[:, 1] ** 2), LARGEST * by_patch
        new = new * np.where(size > most, most / np.maximum(size, _TINY), 1.0)[:, None]
        self._moved[:, :, rows] = new
        self.share[rows] = _share(np.sqrt(ahead[:, 0] ** 2 + ahead[:, 1] ** 2), by_patch, belt)

    def _carried(self, moved: Array, place: Array, part: Array, travel: Array) -> Array:
        """Displacements (p, 2, R, T) after belts travel by `travel` (R, T) [m] and places change by
        `part` (4, R).
        """
        new = _interpolated(moved, travel / self._cell)
        _, _, cos, sin = place[..., None]
        x, y, more_cos, more_sin = part[..., None]
        new[:, 0] += (x - self._across * more_sin - cos * travel) + more_cos * self._along
        new[:, 1] += (y + self._across * more_cos - sin * travel) + more_sin * self._along
        return new

    def rest(
        self, rows: np.ndarray, heading: Array, load: Array, push: Array, surface: Array
    ) -> None:
        """Shear the ground under resting robots `rows` (R,) by the smallest displacement that holds
        them.

        Args:
            rows: indices of the robots.
            heading: headings (R,) of the robots [rad].
            load: normal forces (R, P) at the points, relative to their mean [-].
            push: forces (R, P, 2) of the ground at the points, along and across the robots, over
                the load there [-].
            surface: friction along and across, and shear modulus, (R, P, 3) at the points [-, -,
                m].
        """
        friction, modulus = surface[..., :2], surface[..., 2]
        needed = np.sqrt(((push / friction) ** 2).sum(axis=-1))
        force = load * np.sqrt((push**2).sum(axis=-1))
        more = np.full((len(rows), 1), _HELD)
        for _ in range(_ROUNDS):  # points at their limits leave the rest to other points
            held = np.minimum(more, _MOST_AT_REST / np.maximum(needed, _FLAT))
            exerted = (force * held).sum(axis=1) / np.maximum(force.sum(axis=1), _FLAT)
            more = more * np.where(exerted > 0, _HELD / np.maximum(exerted, _FLAT), 1.0)[:, None]
        share = np.minimum(more * needed, _MOST_AT_REST)
        to = -push / friction**2  # direction in which an element slides, by maximum dissipation
        size = np.sqrt((to**2).sum(axis=-1))
        moved = to * (-modulus * np.log1p(-share) / np.where(size > 0, size, 1.0))[..., None]
        world = se2.rotate(heading[:, None], moved).swapaxes(1, 2)  # (R, 2, P)
        self._moved[:, :, rows] = world.reshape(len(rows), 2, 2 * self._patches, -1).transpose(
            3, 1, 0, 2
        )
        self.share[rows] = np.where(modulus > 0, np.maximum(share, LEAST_SHARE), 1.0)


def _interpolated(moved: Array, c: Array) -> Array:
    """Displacements (p, 2, R, T) at `c` (R, T) cells ahead of the points, along the robot [m]."""
    padded = np.empty((len(moved) + 2, *moved.shape[1:]))
    padded[1:-1] = moved
    forwards, backwards = c > 0, c < 0
    for end, inwards, enters in ((_FRONT, -1, forwards), (_REAR, 1, backwards)):
        first, second, third = (moved[end + k * inwards] for k in range(3))
        # parabolas through the end of the contact, where j = 0, or extended beyond the last point
        padded[end] = np.where(enters, second / 3 - 2 * first, 3 * (first - second) + third)
    square = c * c
    new = (1 - square) * moved
    new += ((square + c) / 2) * padded[2:]
    new += ((square - c) / 2) * padded[:-2]
    slope = padded[1:] - padded[:-1]
    bend = slope[1:] - slope[:-1]
    # from parabola to cubic by a second point upstream
    third = (bend[1:] - bend[:-1]) * (c * (square - 1) / 6)
    new[:-1] += np.where(forwards, third, 0.0)
    new[1:] += np.where(backwards, third, 0.0)
    return new


def _share(distance: Array, modulus: Array, belt: Array) -> Array:
    """Shares (R, P) of the friction at displacements and moduli (p, R, T) [m], under belts with
    speeds (R, T) [m/s].
    """
    a = distance / np.where(modulus > 0, modulus, 1.0)
    half = np.empty_like(a)  # half the change over a cell
    half[1:-1] = (a[2:] - a[:-2]) / 4
    half[_FRONT] = np.where(belt > 0, a[_FRONT], (a[-1] - a[-2]) / 2)
    half[_REAR] = np.where(belt < 0, a[_REAR], (a[1] - a[0]) / 2)
    half = np.maximum(np.minimum(np.abs(half), a), _FLAT)
    # in this form, no exponential exceeds 1, however firm the ground
    share = np.maximum(1 - (np.exp(half - a) - np.exp(-half - a)) / (2 * half), LEAST_SHARE)
    share = np.where(modulus > 0, share, 1.0)
    return share.transpose(1, 2, 0).reshape(len(belt), -1)
