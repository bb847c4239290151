"""References through waypoints from an array or a CSV file, with reversals where the headings
require them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

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

# columns of a waypoint file [m, m, rad, m/s]; yaw and v are optional
COLUMNS = ("x", "y", "yaw", "v")
MIN_POINTS, MAX_POINTS = 3, 10_000  # allowed number of waypoints
MAX_COORDINATE = 100.0  # maximum absolute coordinate of a waypoint [m]
MIN_SPACING = 1e-3  # minimum distance between neighbouring waypoints [m]
# cosine of the largest angle between a chord and the headings at its ends
_ALONG = np.cos(np.radians(45))


class Stretches(PiecewiseReference):
    """Several references in sequence, with headings that are unwrapped from each reference to the
    next.
    """

    def __init__(self, references: Sequence[ProfiledReference]) -> None:
        self._references = references
        # first cell of each reference
        self._first = np.cumsum([0, *(len(each.knots) - 1 for each in references)])
        start, end = np.array([each.pose([0.0, each.duration])[:, 2] for each in references]).T
        self._turns = (
            2 * np.pi * np.append(0.0, np.cumsum(np.round((end[:-1] - start[1:]) / (2 * np.pi))))
        )
        super().__init__(*np.concatenate([each.cells for each in references], axis=1))

    def pose_in(self, k: np.ndarray, way: Array) -> Array:
        """See PiecewiseReference."""
        poses = np.empty((*k.shape, 3))
        for reference, at, first, turn in self._driven_in(k):
            poses[at] = reference.pose_in(k[at] - first, way[at])
            poses[at, 2] += turn
        return poses

    def curvature_in(self, k: np.ndarray, way: Array) -> Array:
        """See PiecewiseReference."""
        curvatures = np.empty(k.shape)
        for reference, at, first, _ in self._driven_in(k):
            curvatures[at] = reference.curvature_in(k[at] - first, way[at])
        return curvatures

    def _driven_in(
        self, k: np.ndarray
    ) -> Iterator[tuple[ProfiledReference, np.ndarray, int, float]]:
        """Yield each reference, a mask (...) of the cells k in it, its first cell and its headings'
        offset [rad].
        """
        for reference, first, end, turn in zip(
            self._references, self._first[:-1], self._first[1:], self._turns, strict=True
        ):
            yield reference, (first <= k) & (k < end), first, turn


def read_waypoints(path: Path, limits: MotionLimits = LIMITS) -> Reference:
    """Build the reference through the points in a CSV file with columns x, y and optionally yaw and
    v: see `waypoints`.

    Raises ReferenceFileError if the file cannot be read or its path cannot be driven. The message
    names the column and the row, counted from 1 without the header.
    """
    try:
        table = read_table(path)
        columns = Columns(table, str(path))
        columns.require(COLUMNS[:2])
        values = {
            name: columns.cells(name).values for name in COLUMNS if name in table.column_names
        }
        for name, column in values.items():
            if np.isnan(column).any():
                raise LogError(
                    f"{path}: {columns.complaint(name, int(np.argmax(np.isnan(column))))}"
                )
        points = np.column_stack([values["x"], values["y"]])
        return waypoints(points, limits, values.get("yaw"), values.get("v"))
    except LogError as error:
        raise ReferenceFileError(str(error)) from error
    except InvalidValueError as error:
        raise ReferenceFileError(f"{path}: {error}") from error


def waypoints(
    points: ArrayLike,
    limits: MotionLimits = LIMITS,
    yaw: ArrayLike | None = None,
    speed: ArrayLike | None = None,
) -> Reference:
    """Build a smooth reference through all points in order: a cubic spline parametrised by chord
    length.

    The curvature is continuous and, without `yaw`, zero at both ends. Among the usual spline
    parameters, chord length gives the widest bends for unevenly spaced points. The robot drives in
    reverse where successive points lie against the headings, and stops where its direction of
    travel changes.

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
    yaw, speed = (None if column is None else np.asarray(column, float) for column in (yaw, speed))
    _require_drivable(points, yaw, speed)
    directions = np.ones(len(points) - 1, int) if yaw is None else _directions(points, yaw)
    if speed is not None:
        # forwards before and after a point
        forwards = np.append(directions, 1) + np.insert(directions, 0, 1) == 2
        row, allowed = (
            int(np.argmin(speed * forwards)),
            "at least 0, unless a column yaw says reverse",
        )
        require(
            speed[row] >= 0 or not forwards[row],
            f"point {row + 1}, column v",
            float(speed[row]),
            allowed,
        )
    ends = [0, *(np.flatnonzero(np.diff(directions)) + 1).tolist(), len(points) - 1]
    stretches = [slice(first, last + 1) for first, last in pairwise(ends)]
    references = [
        _stretch(
            points[s],
            None if yaw is None else yaw[s],
            None if speed is None else speed[s],
            sign,
            limits,
        )
        for s, sign in zip(stretches, directions[ends[:-1]].tolist(), strict=True)
    ]
    return references[0] if len(references) == 1 else Stretches(references)


def _require_drivable(points: Array, yaw: Array | None, speed: Array | None) -> None:
    count = len(points)
    require(
        MIN_POINTS <= count <= MAX_POINTS,
        "number of waypoints",
        count,
        f"from {MIN_POINTS} to {MAX_POINTS}",
    )
    for name, values in zip(COLUMNS, (*points.T, yaw, speed), strict=True):
        if values is None:
            continue
        far = ~(np.abs(values) <= MAX_COORDINATE)  # NaN counts as too far
        row = int(np.argmax(far))
        allowed = f"from {-MAX_COORDINATE:g} to {MAX_COORDINATE:g}"
        require(not far.any(), f"point {row + 1}, column {name}", float(values[row]), allowed)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    k = int(np.argmin(lengths))
    allowed = f"at least {MIN_SPACING:g} m from point {k + 1}"
    require(lengths[k] >= MIN_SPACING, f"point {k + 2}", tuple(points[k + 1].tolist()), allowed)
    way = float(lengths.sum().round(3))
    require(way <= MAX_LENGTH, "way through all points", way, f"at most {MAX_LENGTH:g} m")


def _directions(points: Array, yaw: Array) -> np.ndarray:
    """Directions of travel (N - 1,) between points (N, 2) with headings (N,): 1 for forwards, -1
    for reverse.
    """
    chords = np.diff(points, axis=0)
    headings = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    means = headings[:-1] + headings[1:]
    along = np.sum(means * chords, axis=1) / (
        np.hypot(*means.T) * np.hypot(*chords.T) + np.finfo(float).tiny
    )
    row = int(np.argmin(np.abs(along))) + 1
    allowed = f"within 45 deg of the way from point {row}, forwards or in reverse"
    require(np.abs(along).min() >= _ALONG, f"point {row + 1}, column yaw", float(yaw[row]), allowed)
    return np.sign(along).astype(int)


def _stretch(
    points: Array, yaw: Array | None, speed: Array | None, direction: int, limits: MotionLimits
) -> ProfiledReference:
    """The reference from rest to rest through points (N, 2) that are driven in one direction."""
    parameter = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    ends = (
        "natural"
        if yaw is None
        else tuple((1, direction * np.exp(1j * end)) for end in (yaw[0], yaw[-1]))
    )
    path = ParametricPath(
        scipy.interpolate.CubicSpline(parameter, points @ [1, 1j], bc_type=ends), parameter
    )
    if speed is None:
        return ProfiledReference(path, limits, direction=direction)
    return ProfiledReference(
        path,
        limits,
        lambda s: np.sqrt(np.interp(path.parameter(s), parameter, speed**2)),
        direction,
    )
