"""The places of waypoints, with their headings, and where a robot that visits them stops.

Recorded waypoints are noisy: a robot that stands moves by millimetres between them. Places, and
the directions between them, are found in spite of noise up to the tolerance of the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from trackslip.errors import require
from trackslip.kinematics import Array, wrap_angle
from trackslip.trajectory.path import Complex

MIN_SPACING: Final = 1e-3
"""Distance below which waypoints repeat each other [m]."""
MAX_BEND: Final = np.radians(60)
"""Largest angle between a heading and the way from or to it that a bend makes up for; for a larger
one, the robot turns on the spot [rad].
"""
_LEAST_TURN: Final = 0.1  # smallest change of the heading at a place that counts as a turn [rad]
_LEAST_REVERSAL: Final = 0.2  # smallest turn back in a turn that is more than noise [rad]
_SWING: Final = np.radians(45)  # turn by which points within the tolerance are one place [rad]
_CORNER: Final = np.radians(45)  # least corner at a repeated point where the robot turns [rad]
# points so close that they were meant to be equal [m]
_EQUAL: Final = 1e-9
# length of the ways whose directions are compared with headings [tolerance]
_WAY: Final = 2.0


@dataclass(frozen=True)
class Places:
    """P places, each of one or more successive waypoints, in the order of the visits."""

    rows: np.ndarray  # (P + 1,) first waypoint of each place, and the number of waypoints
    points: Complex  # (P,) their positions [m]
    repeated: np.ndarray  # (P,) whether some of their waypoints are equal
    slack: Array  # (P,) distance by which a path may miss them [m]
    yaw: Array | None  # (N,) headings of the waypoints, unwrapped, if any [rad]
    tolerance: float
    """Distance by which a path may miss a waypoint [m]."""
    dense: float
    """Distance below which neighbours are dense: bends between them are no intention [m]."""

    @property
    def lengths(self) -> Array:
        """Distances (P - 1,) between neighbours [m]."""
        return np.abs(np.diff(self.points))

    def headings(self, place: int) -> Array:
        """Headings (n,) at a place: those of its first and its last waypoint, and those between
        them at which the robot changes its direction of turning; empty without headings.
        """
        if self.yaw is None:
            return np.empty(0)
        own = self.yaw[self.rows[place] : self.rows[place + 1]]
        kept = [0, *turning_points(own, _LEAST_REVERSAL), len(own) - 1]
        return own[np.unique(kept)]

    def _is_turn(self, place: int) -> bool:
        """Whether the headings at a place say that the robot turns there."""
        headings = self.headings(place)
        return len(headings) > 2 or abs(headings[-1] - headings[0]) >= _LEAST_TURN

    def way(self, place: int, last: int) -> complex:
        """The way from a place towards the place `last`, before or after it, as far as it is longer
        than the noise.
        """
        return complex(self.points[self._following(place, last)] - self.points[place])

    def _following(self, place: int, last: int) -> int:
        """The next place towards `last` that is further away than the noise, or `last`."""
        step = 1 if last > place else -1
        following = place + step
        least = _WAY * self.tolerance
        while following != last and abs(self.points[following] - self.points[place]) < least:
            following += step
        return following

    def directions(self) -> np.ndarray:
        """Directions of travel (P - 1,) between neighbours: 1, in reverse -1.

        The way driven is the sum of the distances along the headings. It grows while the robot
        drives forwards; a fall by less than the tolerance is noise. Raises InvalidValueError for
        headings across the way.
        """
        count = len(self.points) - 1
        directions = np.ones(count, int)
        if self.yaw is None or count == 0:
            return directions
        leaving, arriving = self._motions(self.yaw)
        travelled = np.concatenate([[0.0], np.cumsum((leaving + arriving).real / 2)])
        reversals = turning_points(travelled, max(self.tolerance, _EQUAL))
        reversals = [self._turn_beside(place) for place in reversals]
        for start, end in pairwise([0, *reversals, count]):
            self._require_along(self.yaw, start, end)
            if travelled[end] < travelled[start]:
                directions[start:end] = -1
        return directions

    def _turn_beside(self, place: int) -> int:
        """The place of a turn on the spot, if it is as close to this place as noise moves points,
        else this place.
        """
        least = _WAY * self.tolerance
        beside = np.flatnonzero(np.abs(self.points - self.points[place]) <= least).tolist()
        near = [k for k in beside if abs(k - place) <= len(beside)]
        turns = [k for k in near if self._is_turn(k)]
        return min(turns, key=lambda k: abs(k - place), default=place)

    def _motions(self, yaw: Array) -> tuple[Complex, Complex]:
        """Motions (P - 1,) between neighbours, forwards + i leftwards [m], in the frames of the
        robot at their starts and at their ends.
        """
        ways = np.diff(self.points)
        leaving = ways * np.exp(-1j * yaw[self.rows[1:-1] - 1])
        arriving = ways * np.exp(-1j * yaw[self.rows[1:-1]])
        return leaving, arriving

    def _require_along(self, yaw: Array, start: int, end: int) -> None:
        """Raise InvalidValueError for headings across the way, between places `start` and `end`.

        The robot can turn on the spot to the heading of either end of a way, but a heading between
        two ways must be along one of them. Ways that aren't longer than the noise are added up.
        """
        leaving, arriving = self._motions(yaw)
        motions = np.where(np.abs(leaving.real) > np.abs(arriving.real), leaving, arriving)
        first = start
        for place in range(start + 1, end + 1):
            if place < end:
                to_robot = np.exp(-1j * yaw[self.rows[place]])
                ways = (self.way(place, start) * to_robot, self.way(place, end) * to_robot)
                beside = (*ways, arriving[place - 1], leaving[place])
                self._require(any(map(_is_along, beside)), place)
            motion = motions[first:place].sum()
            if abs(motion) >= _WAY * self.tolerance:
                self._require(_is_along(motion), place)
                first = place

    def _require(self, is_along: bool, place: int) -> None:
        """Raise InvalidValueError for the heading of a place unless it `is_along` the way."""
        assert self.yaw is not None
        row = int(self.rows[place])
        allowed = f"within 45 deg of the way from point {row}, forwards or in reverse"
        require(is_along, f"point {row + 1}, column yaw", float(self.yaw[row]), allowed)

    def stops(self, directions: np.ndarray) -> list[int]:
        """Places at which the robot stops: the first, the last, where it changes its direction of
        travel (P - 1,), and where it turns on the spot.
        """
        last = len(self.points) - 1
        stops = {0, last}
        stops.update((np.flatnonzero(np.diff(directions)) + 1).tolist())
        for place in range(1, last):
            if self._turns_at(place, directions):
                stops.add(place)
        return sorted(stops)

    def _turns_at(self, place: int, directions: np.ndarray) -> bool:
        """Whether the robot turns on the spot at a place between others."""
        if self.yaw is None:
            if not self.repeated[place]:
                return False
            arriving = -self.way(place, 0)
            leaving = self.way(place, len(self.points) - 1)
            return bool(abs(np.angle(leaving / arriving)) > _CORNER)
        if self._is_turn(place):
            return True
        headings = self.headings(place)
        # a heading that says where a corner between points far apart is turned
        arriving = directions[place - 1] * (self.points[place] - self.points[place - 1])
        leaving = directions[place] * (self.points[place + 1] - self.points[place])
        for way, heading in ((arriving, headings[0]), (leaving, headings[-1])):
            is_across = abs(wrap_angle(heading - np.angle(way))) > MAX_BEND
            if is_across and abs(way) > self.dense:
                return True
        return False


def _is_along(motion: complex) -> bool:
    """Whether a motion, forwards + i leftwards, is along the robot rather than across it."""
    return abs(motion.imag) <= abs(motion.real) + _EQUAL


def places_of(points: Complex, yaw: Array | None, tolerance: float, dense: float) -> Places:
    """Join waypoints (N,) with headings (N,) [rad] to places.

    Points that repeat the one before belong to its place, as do those within the tolerance between
    which the robot turns. Raises InvalidValueError for points closer than MIN_SPACING that aren't
    equal, if the tolerance is smaller.
    """
    turned = None if yaw is None else np.unwrap(yaw)
    count = len(points)
    starts = []
    repeated = []
    slack = []
    row = 0
    turn = (0, 0)  # rows of the next turn on the spot
    while row < count:
        if turned is not None and row >= turn[1]:
            turn = _turn(points, turned, row, tolerance)
        end = turn[1]
        if row < turn[0] or row >= turn[1]:
            last = turn[0] if row < turn[0] else count
            end = _repeated(points, row, last, tolerance)
        missed = np.abs(points[row:end] - points[row])
        starts.append(row)
        repeated.append(np.count_nonzero(missed < _EQUAL) > 1)
        slack.append(tolerance - missed.max())
        row = end
    first = np.array(starts)
    rows = np.append(first, count)
    return Places(
        rows, points[first], np.array(repeated), np.array(slack), turned, tolerance, dense
    )


def _repeated(points: Complex, row: int, last: int, tolerance: float) -> int:
    """The end of the rows from `row`, before `last`, whose points repeat it."""
    end = row + 1
    while end < last and abs(points[end] - points[row]) < MIN_SPACING:
        is_allowed = tolerance >= MIN_SPACING or abs(points[end] - points[row]) < _EQUAL
        value = (float(points[end].real), float(points[end].imag))
        allowed = f"at least {MIN_SPACING:g} m from point {end}, or equal to it"
        require(is_allowed, f"point {end + 1}", value, allowed)
        end += 1
    return end


def _turn(points: Complex, yaw: Array, row: int, tolerance: float) -> tuple[int, int]:
    """The first and the end of the rows of a turn on the spot, within the tolerance of the point of
    `row` and of each other; twice `row` if the robot doesn't turn there.
    """

    def end_from(first: int) -> int:
        end = first + 1
        while end < len(points) and abs(points[end] - points[first]) <= tolerance:
            end += 1
        return end

    swing = np.ptp(yaw[row : end_from(row)])
    if swing <= _SWING:
        return row, row

    # without the way to the turn, but with all points that repeat its first
    start = row
    while np.ptp(yaw[start + 1 : end_from(start + 1)]) > swing - _LEAST_TURN:
        start += 1
    while start > row and abs(points[start - 1] - points[start]) < MIN_SPACING:
        start -= 1
    return start, end_from(start)


def turning_points(values: Array, least: float) -> list[int]:
    """Rows of the extremes of `values` (N,), between which they change by more than `least`.

    The ends are no extremes. Of equal values, the first is the extreme.
    """
    extremes = []
    lowest = 0
    highest = 0
    direction = 0
    for row, value in enumerate(values):
        if value > values[highest]:
            highest = row
        if value < values[lowest]:
            lowest = row
        if direction >= 0 and value < values[highest] - least:
            if direction > 0:
                extremes.append(highest)
            direction = -1
            lowest = row
        elif direction <= 0 and value > values[lowest] + least:
            if direction < 0:
                extremes.append(lowest)
            direction = 1
            highest = row
    return extremes
