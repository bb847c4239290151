"""References through waypoints from an array or a CSV file, with reversals by the headings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, LogError, ReferenceFileError, require
from trackslip.kinematics import Array
from trackslip.logs.columns import Columns
from trackslip.logs.logfile import read_table
from trackslip.trajectory.base import PiecewiseReference, Reference
from trackslip.trajectory.path import (
    LIMITS,
    MAX_LENGTH,
    MotionLimits,
    ParametricPath,
    ProfiledReference,
)

WAYPOINT_COLUMNS: Final = ("x", "y", "yaw", "v")
"""Columns of a waypoint file [m, m, rad, m/s]; yaw and v are optional."""
MIN_POINTS: Final = 3
"""Smallest allowed number of waypoints."""
MAX_POINTS: Final = 10_000
"""Largest allowed number of waypoints."""
MAX_COORDINATE: Final = 100.0
"""Maximum absolute value in a waypoint's columns, above all of a coordinate [m]."""
MIN_SPACING: Final = 1e-3
"""Minimum distance between neighbouring waypoints [m]."""
# cosine of the largest angle between a chord and the headings at its ends
_MIN_COSINE: Final = np.cos(np.radians(45))


class Stretches(PiecewiseReference):
    """Several references in sequence, with headings unwrapped from each to the next."""

    def __init__(self, references: Sequence[ProfiledReference]) -> None:
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

    def curvature_in(self, k: np.ndarray, distance: Array) -> Array:
        """See PiecewiseReference."""
        curvatures = np.empty(k.shape)
        for reference, mask, first, _ in self._parts(k):
            curvatures[mask] = reference.curvature_in(k[mask] - first, distance[mask])
        return curvatures

    def _parts(self, k: np.ndarray) -> Iterator[tuple[ProfiledReference, np.ndarray, int, float]]:
        """Yield each reference, a mask (...) of cells k in it, its first cell and turn [rad]."""
        for index, reference in enumerate(self._references):
            first = self._first[index]
            mask = (first <= k) & (k < self._first[index + 1])
            yield reference, mask, first, self._turns[index]


@checks_arguments
def read_waypoints(path: Path, limits: MotionLimits = LIMITS) -> Reference:
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
        return waypoints(points, limits, values.get("yaw"), values.get("v"))
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
) -> Reference:
    """Build a smooth reference through all points in order.

    It is a cubic spline parametrised by chord length. The curvature is continuous and, without
    `yaw`, zero at both ends. Among the usual spline parameters, chord length gives the widest bends
    for unevenly spaced points. The robot drives in reverse where successive points lie against the
    headings, and stops where its direction of travel changes.

    Args:
        points: world positions (N, 2) [m].
        limits: limits on speed, acceleration and yaw rate.
        yaw: headings (N,) [rad], which determine where the robot reverses, and its headings at
            starts and stops.
        speed: speed limits (N,) at the points [m/s]; between points the squared limit is linear.

    Raises:
        InvalidValueError: if there are too few or too many points, points too far away or too close
            together, bends too tight to drive, or headings across the path.
    """
    points = np.asarray(points, float)
    planar = points.ndim == 2 and points.shape[1] == 2
    require(planar, "shape of the waypoints", points.shape, "(N, 2): columns x and y")
    yaw = None if yaw is None else np.asarray(yaw, float)
    speed = None if speed is None else np.asarray(speed, float)
    _require_drivable(points, yaw, speed)
    directions = np.ones(len(points) - 1, int)
    if yaw is not None:
        directions = _directions(points, yaw)
    if speed is not None:
        _require_speeds(speed, directions)

    # a stretch ends where the direction changes
    changes = np.flatnonzero(np.diff(directions)) + 1
    ends = [0, *changes.tolist(), len(points) - 1]
    references = []
    for first, last in pairwise(ends):
        stretch = slice(first, last + 1)
        reference = _stretch(
            points[stretch],
            None if yaw is None else yaw[stretch],
            None if speed is None else speed[stretch],
            int(directions[first]),
            limits,
        )
        references.append(reference)
    return references[0] if len(references) == 1 else Stretches(references)


def _require_drivable(points: Array, yaw: Array | None, speed: Array | None) -> None:
    """Raise InvalidValueError for a wrong number of points, or for one too far or too close."""
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

    lengths = np.hypot(*np.diff(points, axis=0).T)
    k = int(np.argmin(lengths))
    allowed = f"at least {MIN_SPACING:g} m from point {k + 1}"
    require(lengths[k] >= MIN_SPACING, f"point {k + 2}", tuple(points[k + 1].tolist()), allowed)

    length = float(lengths.sum().round(3))
    require(length <= MAX_LENGTH, "way through all points", length, f"at most {MAX_LENGTH:g} m")


def _require_speeds(speed: Array, directions: np.ndarray) -> None:
    """Raise InvalidValueError for a negative speed (N,) where `directions` (N - 1,) are forwards.

    A point counts as forwards if the robot drives forwards before and after it.
    """
    before = np.insert(directions, 0, 1)
    after = np.append(directions, 1)
    is_forwards = before + after == 2
    row = int(np.argmin(speed * is_forwards))
    is_allowed = speed[row] >= 0 or not is_forwards[row]
    allowed = "at least 0, unless a column yaw says reverse"
    require(is_allowed, f"point {row + 1}, column v", float(speed[row]), allowed)


def _directions(points: Array, yaw: Array) -> np.ndarray:
    """Directions of travel (N - 1,) between points (N, 2) with headings (N,): 1, in reverse -1."""
    chords = np.diff(points, axis=0)
    headings = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    means = headings[:-1] + headings[1:]
    lengths = np.hypot(*means.T) * np.hypot(*chords.T)
    # the smallest number avoids 0 / 0 for opposite headings
    cosine = np.sum(means * chords, axis=1) / (lengths + np.finfo(float).tiny)
    across = int(np.argmin(np.abs(cosine)))
    row = across + 1
    is_along = np.abs(cosine[across]) >= _MIN_COSINE
    allowed = f"within 45 deg of the way from point {row}, forwards or in reverse"
    require(is_along, f"point {row + 1}, column yaw", float(yaw[row]), allowed)
    return np.sign(cosine).astype(int)


def _stretch(
    points: Array, yaw: Array | None, speed: Array | None, direction: int, limits: MotionLimits
) -> ProfiledReference:
    """The reference from rest to rest through points (N, 2) that are driven in one direction."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    parameter = np.concatenate([[0.0], np.cumsum(lengths)])
    ends: str | tuple[tuple[int, complex], tuple[int, complex]] = "natural"  # no curvature
    if yaw is not None:
        # first derivatives, against the headings in reverse
        first = direction * np.exp(1j * yaw[0])
        last = direction * np.exp(1j * yaw[-1])
        ends = ((1, first), (1, last))
    curve = scipy.interpolate.CubicSpline(parameter, points @ [1, 1j], bc_type=ends)
    path = ParametricPath(curve, parameter)
    if speed is None:
        return ProfiledReference(path, limits, direction=direction)

    def speed_at(s: Array) -> Array:
        return np.sqrt(np.interp(path.parameter(s), parameter, speed**2))

    return ProfiledReference(path, limits, speed_at, direction)
