"""References through waypoints from an array or a CSV file, with reversals and turns on the spot by
the headings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import (
    InvalidValueError,
    LogError,
    ReferenceFileError,
    require,
    require_within,
)
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.columns import Columns
from trackslip.logs.logfile import read_table
from trackslip.trajectory.base import PiecewiseReference, Reference
from trackslip.trajectory.path import (
    LIMITS,
    MAX_LENGTH,
    Complex,
    MotionLimits,
    ParametricPath,
    ProfiledReference,
)
from trackslip.trajectory.places import MAX_BEND, Places, places_of, turning_points
from trackslip.trajectory.smoothing import Ends, chord_lengths, interpolated, smoothed
from trackslip.trajectory.turns import TurnOnTheSpot

WAYPOINT_COLUMNS: Final = ("x", "y", "yaw", "v")
"""Columns of a waypoint file [m, m, rad, m/s]; yaw and v are optional."""
MIN_POINTS: Final = 3
"""Smallest allowed number of waypoints."""
MAX_POINTS: Final = 10_000
"""Largest allowed number of waypoints."""
MAX_COORDINATE: Final = 100.0
"""Maximum absolute value in a waypoint's columns, above all of a coordinate [m]."""
TOLERANCE_SHARE: Final = 0.1
"""Distance by which a path may miss its waypoints, by default, over the robot's half gauge [-]."""
TOLERANCE: Final = TOLERANCE_SHARE * 0.168
"""The same for the shipped robot [m]."""
MAX_TOLERANCE: Final = 1.0
"""Largest distance by which a path may miss its waypoints [m]."""
# duration of the smoothed path over that of the spline through all points from which it is used
_LEAST_GAIN: Final = 0.9
_EQUAL_HEADINGS: Final = 1e-9  # largest difference of equal headings [rad]


class Stretches(PiecewiseReference):
    """Several references in sequence, with headings unwrapped from each to the next."""

    def __init__(self, references: Sequence[PiecewiseReference]) -> None:
        self._references = references
        counts = [len(reference.knots) - 1 for reference in references]
        self._first = np.cumsum([0, *counts])  # first cell of each reference, and number of cells

        # whole turns by which each reference's heading is off the end of the one before
        headings = [reference.pose([0.0, reference.duration])[:, 2] for reference in references]
        start, end = np.array(headings).T
        turns = np.round((end[:-1] - start[1:]) / (2 * np.pi))
        self._turns = 2 * np.pi * np.append(0.0, np.cumsum(turns))  # [rad]

        cells = np.concatenate([reference.cells for reference in references], axis=1)
        durations, start_speeds, end_speeds = cells
        super().__init__(durations, start_speeds, end_speeds)

    def pose_in(self, k: np.ndarray, distance: Array) -> Array:
        """See PiecewiseReference."""
        poses = np.empty((*k.shape, 3))
        for reference, mask, first, turn in self._parts(k):
            poses[mask] = reference.pose_in(k[mask] - first, distance[mask])
            poses[mask, 2] += turn
        return poses

    def twist_in(self, k: np.ndarray, distance: Array, speed: Array) -> Array:
        """See PiecewiseReference."""
        twists = np.empty((*k.shape, 2))
        for reference, mask, first, _ in self._parts(k):
            twists[mask] = reference.twist_in(k[mask] - first, distance[mask], speed[mask])
        return twists

    def _parts(self, k: np.ndarray) -> Iterator[tuple[PiecewiseReference, np.ndarray, int, float]]:
        """Yield each reference, a mask (...) of cells k in it, its first cell and turn [rad]."""
        for index, reference in enumerate(self._references):
            first = self._first[index]
            mask = (first <= k) & (k < self._first[index + 1])
            yield reference, mask, first, self._turns[index]


@checks_arguments
def read_waypoints(
    path: Path, limits: MotionLimits = LIMITS, tolerance: float = TOLERANCE
) -> Reference:
    """Build the reference through the points in a CSV file: see `waypoints`.

    The file has the columns x, y and optionally yaw and v. Raises ReferenceFileError if the file
    cannot be read or its path cannot be driven. The message names the column and the row, counted
    from 1 without the header.
    """
    try:
        table = read_table(path)
        columns = Columns(table, str(path))
        columns.require(["x", "y"])
        present = [name for name in WAYPOINT_COLUMNS if name in table.column_names]
        values = {name: columns.cells(name).values for name in present}
        for name, column in values.items():
            is_missing = np.isnan(column)
            if is_missing.any():
                row = int(np.argmax(is_missing))
                raise LogError(f"{path}: {columns.complaint(name, row)}")
        points = np.column_stack([values["x"], values["y"]])
        return waypoints(points, limits, values.get("yaw"), values.get("v"), tolerance)
    except LogError as error:
        raise ReferenceFileError(str(error)) from error
    except InvalidValueError as error:
        raise ReferenceFileError(f"{path}: {error}") from error


@checks_arguments
def waypoints(
    points: ArrayLike,
    limits: MotionLimits = LIMITS,
    yaw: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
) -> Reference:
    """Build a smooth reference through all points in order.

    It is a cubic spline parametrised by chord length. The curvature is continuous and, without
    `yaw`, zero at both ends. Among the usual spline parameters, chord length gives the widest bends
    for unevenly spaced points.

    Where points are so dense or noisy that bends between them slow the robot, the spline misses
    them by up to `tolerance`, and is the smoothest one that does.

    With `yaw`, the robot drives in reverse where successive points lie against the headings, and
    stops where its direction of travel changes. It turns on the spot (v = 0) where points repeat
    each other with other headings, and at its start, its goal, reversals and corners between
    distant points, if its heading there is more than 60 deg off the path. Without `yaw`, it turns
    on the spot at corners of more than 45 deg that are given twice.

    Args:
        points: world positions (N, 2) [m].
        limits: limits on speed, acceleration and yaw rate.
        yaw: headings (N,) [rad], which determine where the robot reverses and where it turns on
            the spot, and its headings at starts and stops.
        speed: speed limits (N,) at the points [m/s]; between points the squared limit is linear.
        tolerance: largest distance of a point from the path [m].

    Raises:
        InvalidValueError: if there are too few or too many points, points too far away or too close
            together, bends too tight to drive, or headings across the path.
    """
    points = np.asarray(points, float)
    planar = points.ndim == 2 and points.shape[1] == 2
    require(planar, "shape of the waypoints", points.shape, "(N, 2): columns x and y")
    yaw = None if yaw is None else np.asarray(yaw, float)
    speed = None if speed is None else np.asarray(speed, float)
    require_within("tolerance", tolerance, 0.0, MAX_TOLERANCE, "m")
    _require_drivable(points, yaw, speed)

    places = places_of(points @ [1, 1j], yaw, tolerance, _dense(limits, tolerance))
    directions = places.directions()
    if speed is not None:
        speed = _place_speeds(speed, places, directions)
    stops = places.stops(directions)
    stretches = []
    for first, last in pairwise(stops):
        stretch_speed = None if speed is None else speed[first : last + 1]
        direction = int(directions[first])
        stretches.append(_stretch(places, first, last, direction, stretch_speed, limits))
    references = _with_turns(places, stops, stretches, limits)
    require(references, "points", "all equal, with equal headings", "a way or a turn on the spot")
    return references[0] if len(references) == 1 else Stretches(references)


def _dense(limits: MotionLimits, tolerance: float) -> float:
    """Distance below which neighbouring points are dense [m].

    An arc that can just be driven at full speed bulges from a chord of this length by `tolerance`.
    Moving points that are further apart by the tolerance hardly changes the bends between them.
    """
    full_speed_radius = limits.speed / limits.yaw_rate
    return float(np.sqrt(8 * full_speed_radius * tolerance))


def _require_drivable(points: Array, yaw: Array | None, speed: Array | None) -> None:
    """Raise InvalidValueError for a wrong number of points, or for one too far."""
    count = len(points)
    allowed = f"from {MIN_POINTS} to {MAX_POINTS}"
    require(MIN_POINTS <= count <= MAX_POINTS, "number of waypoints", count, allowed)

    allowed = f"from {-MAX_COORDINATE:g} to {MAX_COORDINATE:g}"
    for name, values in zip(WAYPOINT_COLUMNS, (*points.T, yaw, speed), strict=True):
        if values is None:
            continue
        is_far = ~(np.abs(values) <= MAX_COORDINATE)  # NaN counts as too far
        row = int(np.argmax(is_far))
        require(not is_far.any(), f"point {row + 1}, column {name}", float(values[row]), allowed)

    length = float(np.hypot(*np.diff(points, axis=0).T).sum().round(3))
    require(length <= MAX_LENGTH, "way through all points", length, f"at most {MAX_LENGTH:g} m")


def _place_speeds(speed: Array, places: Places, directions: np.ndarray) -> Array:
    """Smallest speeds (P,) at places from those of waypoints (N,) [m/s].

    Raises InvalidValueError for a negative speed where the robot drives forwards before and after.
    """
    before = np.insert(directions, 0, 1)
    after = np.append(directions, 1)
    is_forwards = np.repeat(before + after == 2, np.diff(places.rows))
    row = int(np.argmin(speed * is_forwards))
    is_allowed = speed[row] >= 0 or not is_forwards[row]
    allowed = "at least 0, unless a column yaw says reverse"
    require(is_allowed, f"point {row + 1}, column v", float(speed[row]), allowed)
    return np.minimum.reduceat(np.abs(speed), places.rows[:-1])


def _stretch(
    places: Places,
    first: int,
    last: int,
    direction: int,
    speed: Array | None,
    limits: MotionLimits,
) -> ProfiledReference:
    """The reference from rest to rest through the places from `first` to `last`, in one direction.

    If some of them are dense, it is the one of the smoothest curve within the tolerance, if that is
    quicker by more than a tenth than the spline through all places.
    """
    points = places.points[first : last + 1]
    ends = Ends(
        _clamped(direction * places.way(first, last), places.headings(first)[-1:], direction),
        _clamped(-direction * places.way(last, first), places.headings(last)[:1], direction),
    )

    def along(parameter: Array, through: Complex, limit: Array | None) -> ProfiledReference:
        """The reference along the spline of these parameters (N,) through points (N,), where the
        speed is limited to `limit` (N,).
        """
        path = ParametricPath(interpolated(parameter, through, ends), parameter)
        if limit is None:
            return ProfiledReference(path, limits, direction=direction)

        def speed_at(s: Array) -> Array:
            return np.sqrt(np.interp(path.parameter(s), parameter, limit**2))

        return ProfiledReference(path, limits, speed_at, direction)

    is_dense = places.lengths[first:last].min() < places.dense
    if len(points) < MIN_POINTS or not is_dense:
        return along(chord_lengths(points), points, speed)
    slack = places.slack[first : last + 1]
    away = _away_from_ends(points, slack)
    limit = None if speed is None else speed[away]
    try:
        smoother = along(*smoothed(points[away], slack[away], ends), limit)
    except InvalidValueError as error:
        larger = f"; noise of the points needs a larger tolerance than {places.tolerance:.3g} m"
        raise InvalidValueError(error.field, error.value, error.allowed + larger) from error
    # a curve turns at least as far as the chords between points on it (Milnor 1950)
    chords = np.diff(points)
    turned = float(np.abs(np.angle(chords[1:] / chords[:-1])).sum())
    if smoother.duration < _LEAST_GAIN * turned / limits.yaw_rate:
        return smoother
    try:
        exact = along(chord_lengths(points), points, speed)
    except InvalidValueError:  # too tight, or a cusp
        return smoother
    return smoother if smoother.duration < _LEAST_GAIN * exact.duration else exact


def _away_from_ends(points: Complex, slack: Array) -> np.ndarray:
    """Rows of the first and the last of some points (N,), and of those between that no path from
    the first to the last comes within their `slack` (N,) of merely by beginning and ending [m].

    Noise moves points beside an end against the way, so that a path would have to turn there.
    """
    from_first = np.abs(points - points[0])
    from_last = np.abs(points - points[-1])
    last = len(points) - 1
    start = 1
    while start < last and from_first[start] <= slack[start]:
        start += 1
    end = last - 1
    while end >= start and from_last[end] <= slack[end]:
        end -= 1
    return np.array([0, *range(start, end + 1), last])


def _clamped(way: complex, heading: Array, direction: int) -> complex | None:
    """Direction of a path at an end with a `heading` (1,) or (0,), where the robot, facing ahead,
    drives the `way`; None if the heading is unknown, or too far off it for a bend.
    """
    if not heading.size or abs(wrap_angle(heading[0] - np.angle(way))) > MAX_BEND:
        return None
    return complex(direction * np.exp(1j * heading[0]))


def _with_turns(
    places: Places,
    stops: Sequence[int],
    stretches: Sequence[ProfiledReference],
    limits: MotionLimits,
) -> list[PiecewiseReference]:
    """The stretches between the places `stops`, with turns on the spot at these places."""
    references: list[PiecewiseReference] = []
    for k, place in enumerate(stops):
        headings = places.headings(place)
        if k > 0:
            end = stretches[k - 1].duration
            headings = _joined(stretches[k - 1].pose(end)[2:], headings)
        if k < len(stretches):
            headings = _joined(headings, stretches[k].pose(0.0)[2:])

        # from each heading at which the robot changes its direction of turning to the next
        extremes = turning_points(headings, _EQUAL_HEADINGS)
        point = places.points[place]
        for first, last in pairwise([0, *extremes, len(headings) - 1]):
            angle = headings[last] - headings[first]
            if abs(angle) > _EQUAL_HEADINGS:
                start = (point.real, point.imag, headings[first])
                references.append(TurnOnTheSpot(start, angle, limits))
        references += stretches[k : k + 1]
    return references


def _joined(before: Array, after: Array) -> Array:
    """Headings (n,) and (m,) in sequence, (n + m,), with half a turn at most between them [rad]."""
    if before.size and after.size:
        difference = before[-1] - after[0]
        after = after + difference - wrap_angle(difference)
    return np.concatenate([before, after])
