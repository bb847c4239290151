"""Shear of the ground under a fleet's tracks: the displacement of each track element, and the share
of the friction that it mobilises.

An element of track touches down at the front of a belt that drives forwards and is carried to the
rear. P(t, x) is the world position of the robot's point x, V the belt speed. In a period dt, the
displacement at the point x_i becomes

    j_i <- j(x_i + V dt) + P(t + dt, x_i) - P(t, x_i + V dt)                                     (1)

with j = 0 where elements touch down. Between points, j is a cubic through four points, one of them
downstream; a parabola through three points, as at the point next to the entry, would cause ripples
that hardly decay. The share of the friction that acts at a point is the mean of

    1 - exp(-a),    a = |j + tau dj/dt| / K                                                      (2)

over the point's cell, in which a varies linearly (Janosi and Hanamoto 1961, Wong and Chiang 2001).
tau removes a ripple of the speed with the servo's period, of which it is twice the usual 10 ms;
steady states hardly depend on it. The share only scales the engine's coefficients of friction, and
the engine finds the direction of the force.

Displacements are stored as arrays (p, 2, R, T): the p points of a patch from rear to front, x and y
in the world, R robots and T patches. The points are on the first axis because (1) needs neighbours
together.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

LARGEST: Final = 20.0
"""Largest stored displacement, relative to the shear modulus, at which friction is fully mobilised
[-].
"""
LEAST_SHARE: Final = 1e-5
"""Smallest share of the friction, as the engine needs friction above zero [-]."""
_LEAD: Final = 0.02  # tau [s]
_COURANT: Final = 0.5  # largest part of a cell by which an element moves in a step [-]
# least variation over a cell, relative to the shear modulus, that has an effect; also the least
# force and share that are divided by [-]
_FLAT: Final = 1e-6
_RESERVE: Final = 1.02  # friction mobilised at rest over the push, so that no point slides [-]
_MOST_AT_REST: Final = 0.999  # largest share of the friction at rest [-]
_ROUNDS: Final = 10
_STILL: Final = 1e-9  # travel of a belt in a step that carries no elements [m]
_TINY: Final = 1e-300
_FRONT: Final = -1
_REAR: Final = 0
_Rows = np.ndarray | slice


class _Air(NamedTuple):
    """Numbers of steps until elements in the air touch down, 0 for those on the ground."""

    at_points: Array  # (p, R, T)
    beyond: Array  # (R, T) a cell beyond the end where elements enter, 0 unless the end is lifted


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
        self._patches = patches
        points = len(place) // (2 * patches)
        by_patch = place.reshape(2 * patches, points, 2)
        self._along = by_patch[..., 0].T[:, None]  # (p, 1, T) [m]
        self._across = by_patch[:, 0, 1]  # (T,) [m]
        self._cell = length / points
        self._period = period
        farthest = top_speed * period
        self._steps = max(1, math.ceil(farthest / (_COURANT * self._cell)))
        self._moved = np.zeros((points, 2, size, 2 * patches))  # displacements [m]
        self.share = np.ones((size, len(place)))
        """Share (N, P) of the friction that acts at each point in the next period [-]."""

    @property
    def displacement(self) -> Array:
        """Shear displacements (N, P, 2) along the world's axes [m]."""
        by_robot = self._moved.transpose(2, 3, 0, 1)
        return by_robot.reshape(*self.share.shape, 2).copy()

    @property
    def by_robot(self) -> tuple[Array, Array]:
        """Views of all arrays that change, with the robots on the first axis."""
        return self._moved.transpose(2, 0, 1, 3), self.share

    def forget(self, rows: _Rows) -> None:
        """Mobilise the full friction under the robots `rows` (R,), as on Coulomb ground."""
        self._moved[:, :, rows] = 0.0
        self.share[rows] = 1.0

    def advance(
        self,
        rows: _Rows,
        before: Array,
        after: Array,
        belt: Array,
        modulus: Array,
        lifted: Array | None = None,
    ) -> None:
        """Update displacements and shares for a period in which the robots `rows` (R,) move.

        Args:
            rows: indices of the robots that have moved.
            before, after: places of the robots (4, R): position x, y [m], cosine and sine of the
                heading.
            belt: belt speeds (R, 2), positive forwards [m/s].
            modulus: shear moduli (R, P) under the points [m].
            lifted: lengths (R, T) of the patches that are in the air at the end where elements
                enter; None for none [m].
        """
        belt = belt.repeat(self._patches, axis=1)  # (R, T)
        modulus = modulus.reshape(*belt.shape, -1).transpose(2, 0, 1)  # (p, R, T)
        old: Array = np.ascontiguousarray(self._moved[:, :, rows])

        # equation (1) in steps so short that elements stay between neighbours; a period's turn is
        # so small that its chord suffices
        travel = belt * (self._period / self._steps)
        change = (after - before) / self._steps
        place = before
        new: Array = old
        air = None if lifted is None else self._air(lifted, travel)
        for _ in range(self._steps):
            new = self._carried(new, place, change, travel, air)
            place = place + change

        # equation (2)
        ahead = new + (new - old) * (_LEAD / self._period)
        distance = _size(ahead)
        if air is not None:
            distance = np.where(air.at_points > 0, 0.0, distance)
        self.share[rows] = _share(distance, modulus, belt)

        # far beyond full friction, displacements have no effect
        size = _size(new)
        largest = LARGEST * modulus
        shortened = np.where(size > largest, largest / np.maximum(size, _TINY), 1.0)
        self._moved[:, :, rows] = new * shortened[:, None]

    def _air(self, lifted: Array, travel: Array) -> _Air:
        """Times until elements touch down that belts carry by `travel` (R, T) [m] in a step;
        `lifted` as in `advance`.
        """
        count = len(self._along)
        from_rear = self._cell * (np.arange(count) + 0.5)[:, None, None]
        from_entry = np.where(travel > 0, from_rear[::-1], from_rear)  # (p, R, T)
        distance = np.abs(travel)
        step = np.where(distance > _STILL, distance, np.inf)
        at_points = np.maximum(lifted - from_entry, 0.0) / step
        beyond = np.where(lifted > 0, lifted + self._cell / 2, 0.0) / step
        return _Air(at_points, beyond)

    def _carried(
        self, moved: Array, place: Array, change: Array, travel: Array, air: _Air | None
    ) -> Array:
        """Displacements (p, 2, R, T) after a step of equation (1), in which belts travel by
        `travel` (R, T) [m] and places (4, R) change by `change` (4, R).

        A point s ahead of the robot's origin and l to its left is in the world at

            (x + s cos - l sin,    y + s sin + l cos).

        The element that the belt carries there was at s + v before, with the travel v. By (1), its
        displacement changes by

            (dx - l dsin - v cos) + s dcos,    (dy + l dcos - v sin) + s dsin.

        Elements in the air have the displacement that makes j = 0 where they touch down: minus the
        changes until then.
        """
        _, _, cos, sin = place[..., None]
        x_change, y_change, cos_change, sin_change = change[..., None]
        x_moved = x_change - self._across * sin_change - cos * travel
        y_moved = y_change + self._across * cos_change - sin * travel
        changes = np.empty_like(moved)
        changes[:, 0] = x_moved + cos_change * self._along
        changes[:, 1] = y_moved + sin_change * self._along

        cells = travel / self._cell
        if air is None:
            return _interpolated(moved, cells) + changes
        ends = (-air.beyond * changes[_REAR], -air.beyond * changes[_FRONT])
        new = _interpolated(moved, cells, air.beyond > 0, ends) + changes
        in_air = air.at_points[:, None]
        return np.where(in_air > 0, -in_air * changes, new)

    def rest(
        self, rows: np.ndarray, heading: Array, load: Array, push: Array, surface: Array
    ) -> None:
        """Shear the ground under resting robots `rows` (R,) by the smallest displacement that holds
        them.

        Friction acts within an ellipse: the share that a point needs is the length of its push in
        units of the friction along and across. All points mobilise 2 % more than they need. Points
        at their limits can't, and leave the rest to the others, whose share is raised until the sum
        of the forces is reached.

        Args:
            rows: indices of the robots.
            heading: headings (R,) of the robots [rad].
            load: normal forces (R, P) at the points, relative to their mean [-].
            push: forces (R, P, 2) of the ground at the points, along and across the robots, over
                the load there [-].
            surface: friction along and across, and shear modulus, (R, P, 3) at the points [-, -,
                m].
        """
        friction = surface[..., :2]
        modulus = surface[..., 2]
        needed = np.sqrt(((push / friction) ** 2).sum(axis=-1))  # share of the friction
        force = load * np.sqrt((push**2).sum(axis=-1))
        total = np.maximum(force.sum(axis=1), _FLAT)
        factor = np.full((len(rows), 1), _RESERVE)  # mobilised over needed
        for _ in range(_ROUNDS):
            possible = np.minimum(factor, _MOST_AT_REST / np.maximum(needed, _FLAT))
            exerted = (force * possible).sum(axis=1) / total
            raised = np.where(exerted > 0, _RESERVE / np.maximum(exerted, _FLAT), 1.0)
            factor = factor * raised[:, None]
        share = np.minimum(factor * needed, _MOST_AT_REST)

        # the displacement that mobilises a share, from equation (2) at rest, in the direction in
        # which an element slides, by maximum dissipation
        distance = -modulus * np.log1p(-share)
        direction = -push / friction**2
        length = np.sqrt((direction**2).sum(axis=-1))
        moved = direction * (distance / np.where(length > 0, length, 1.0))[..., None]

        in_world = se2.rotate(heading[:, None], moved)  # (R, P, 2)
        by_patch = in_world.reshape(len(rows), 2 * self._patches, -1, 2)
        self._moved[:, :, rows] = by_patch.transpose(2, 3, 0, 1)
        self.share[rows] = np.where(modulus > 0, np.maximum(share, LEAST_SHARE), 1.0)


def _size(moved: Array) -> Array:
    """Sizes (p, R, T) of displacements (p, 2, R, T) [m]."""
    return np.asarray(np.sqrt(moved[:, 0] ** 2 + moved[:, 1] ** 2))


def _interpolated(
    moved: Array,
    c: Array,
    is_lifted: NDArray[np.bool_] | None = None,
    in_air: tuple[Array, Array] | None = None,
) -> Array:
    """Displacements (p, 2, R, T) at `c` (R, T) cells ahead of the points, along the robot [m].

    Where a patch `is_lifted` (R, T) at the end where elements enter, the displacement a cell beyond
    its rear or front end is that `in_air`, (2, R, T) each.

    With the value m at a point, a behind it and b ahead of it, the parabola is

        (1 - c^2) m + (c^2 + c) / 2 b + (c^2 - c) / 2 a.

    Newton's form of the cubic adds the third difference of the values times c (c^2 - 1) / 6.
    """
    forwards = c > 0
    backwards = c < 0
    padded = np.empty((len(moved) + 2, *moved.shape[1:]))
    padded[1:-1] = moved
    padded[_FRONT] = _beyond(moved[-1], moved[-2], moved[-3], forwards)
    padded[_REAR] = _beyond(moved[0], moved[1], moved[2], backwards)
    if is_lifted is not None and in_air is not None:
        padded[_REAR] = np.where(is_lifted & backwards, in_air[0], padded[_REAR])
        padded[_FRONT] = np.where(is_lifted & forwards, in_air[1], padded[_FRONT])

    square = c * c
    new = (1 - square) * moved
    new += ((square + c) / 2) * padded[2:]
    new += ((square - c) / 2) * padded[:-2]

    # from parabola to cubic by a second point upstream
    slope = padded[1:] - padded[:-1]
    bend = slope[1:] - slope[:-1]
    cubic = (bend[1:] - bend[:-1]) * (c * (square - 1) / 6)
    new[:-1] += np.where(forwards, cubic, 0.0)
    new[1:] += np.where(backwards, cubic, 0.0)
    return new


def _beyond(first: Array, second: Array, third: Array, enters: NDArray[np.bool_]) -> Array:
    """Displacements (2, R, T) a cell beyond the end of a patch, from those at its first three
    points.

    Where elements enter (R, T), they are on the parabola through the first two points and j = 0 at
    the end of the contact, half a cell beyond the first point; elsewhere, on the parabola through
    all three.
    """
    entering = second / 3 - 2 * first
    leaving = 3 * (first - second) + third
    return np.where(enters, entering, leaving)


def _share(distance: Array, modulus: Array, belt: Array) -> Array:
    """Shares (R, P) of the friction at displacements and moduli (p, R, T) [m], under belts with
    speeds (R, T) [m/s].

    If a in equation (2) varies by h to either side of a point within its cell, the mean is

        1 - (exp(h - a) - exp(-h - a)) / (2 h).

    In this form, no exponential exceeds 1 by more than _FLAT, however firm the ground, because h <=
    a for a above _FLAT.
    """
    a = distance / np.where(modulus > 0, modulus, 1.0)
    # h, half the change over a cell; where elements enter, a rises from 0 at the edge of the cell
    half = np.empty_like(a)
    half[1:-1] = (a[2:] - a[:-2]) / 4
    half[_FRONT] = np.where(belt > 0, a[-1], (a[-1] - a[-2]) / 2)
    half[_REAR] = np.where(belt < 0, a[0], (a[1] - a[0]) / 2)
    half = np.maximum(np.minimum(np.abs(half), a), _FLAT)

    mobilised = 1 - (np.exp(half - a) - np.exp(-half - a)) / (2 * half)
    share = np.maximum(mobilised, LEAST_SHARE)
    share = np.where(modulus > 0, share, 1.0)
    return share.transpose(1, 2, 0).reshape(len(belt), -1)
