"""Measured poses: those that repeat the pose before or were interpolated are left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import STANDING

# least share, and number, of poses on lines between other poses for which poses are interpolated
_MOSTLY: Final = 0.5
_LEAST_INTERPOLATED: Final = 10
_UNITS: Final = 10.0 ** -np.arange(2, 7)  # units to which poses may be rounded [m, rad]
_ROUNDED: Final = 1e-8  # largest deviation of a rounded number from a multiple of its unit


@dataclass(frozen=True)
class Poses:
    """Measured poses, and the number of others."""

    time: Array  # (K,) [s]
    pose: Array  # (K, 3) [m, m, rad]; NaN where not measured
    repeated: int  # number of poses left out because they repeat the previous pose
    # number of poses left out because they lie on the line between other poses
    interpolated: int


def measured_poses(log: RunLog) -> Poses:
    """The measured poses in a log: valid, neither repeated nor interpolated."""
    rows = distinct_rows(log)
    time, pose = _not_interpolated(log.time[rows], log.pose[rows])
    return Poses(
        time,
        pose,
        repeated=int(log.is_valid.sum()) - len(rows),
        interpolated=len(rows) - len(time),
    )


def distinct_rows(log: RunLog) -> np.ndarray:
    """Rows (n,) of a log with valid poses, without those that equal the previous pose although the
    sprockets turned.

    Poses without positions never count as repeated, since headings are constant on a straight.
    """
    rows = np.flatnonzero(log.is_valid)
    pose = np.nan_to_num(log.pose[rows])
    same = (np.diff(pose, axis=0) == 0).all(axis=1)
    placed = np.isfinite(log.pose[rows[1:], 0])

    speed = np.abs(log.omega[1:]).max(axis=1)
    turned = np.append(0.0, np.cumsum(speed * np.diff(log.time)))
    drives = np.diff(turned[rows]) > STANDING
    return np.delete(rows, 1 + np.flatnonzero(same & placed & drives))


def _not_interpolated(time: Array, pose: Array) -> tuple[Array, Array]:
    """Drop poses that were interpolated linearly between measured poses: only ends of straight
    stretches are kept.

    If a measured pose lies between two rows, it isn't among the poses (n, 3) at `time` (n,). It is
    where the lines through two successive stretches meet. A stretch ends in pose p at the rate r,
    the next begins in pose q at the rate s, later by t. After the time u, both lines are closest:
    p + r u = q + s (u - t), so u (r - s) = q - p - s t, by least squares over the three columns.
    """
    finite = np.nan_to_num(pose)
    first, last = _straight_stretches(time, finite, _resolution(finite))
    long = last - first > 1  # with poses between its ends
    if (last - first)[long].sum() < max(_LEAST_INTERPOLATED, _MOSTLY * len(time)):
        return time, pose

    time = time.copy()
    pose = pose.copy()
    duration = np.maximum(time[last] - time[first], 1e-300)
    rate = (finite[last] - finite[first]) / duration[:, None]
    meets_next = long[:-1] & long[1:]
    for k in np.flatnonzero(meets_next):
        end = last[k]
        begin = first[k + 1]
        between = time[begin] - time[end]
        bend = rate[k] - rate[k + 1]
        step = finite[begin] - finite[end] - rate[k + 1] * between
        later = np.clip(step @ bend / max(bend @ bend, 1e-300), 0.0, between)
        time[end] += later
        pose[end] += rate[k] * later

    # where two stretches meet, one pose stands for both of their ends
    rows = np.unique(np.concatenate([first[:1], last, first[1:][~meets_next]]))
    return time[rows], pose[rows]


def _straight_stretches(
    time: Array, pose: Array, resolution: Array
) -> tuple[np.ndarray, np.ndarray]:
    """First and last rows of the longest stretches of poses (n, 3) that lie on a line to within
    `resolution` (3,).

    A stretch continues as long as some line from its first pose passes through all later poses (J.
    O'Rourke, *An on-line algorithm for fitting straight lines between data ranges*, 1981): as long
    as the bounds on its rates, which each pose narrows, leave one for every column.
    """
    # plain numbers, as this takes a step per row
    times = time.tolist()
    poses = pose.tolist()
    tolerances = resolution.tolist()
    unbounded = [(-np.inf, np.inf)] * 3

    firsts = [0]
    begin = 0
    bounds = unbounded
    for row in range(1, len(times)):
        step = times[row] - times[begin]
        columns = zip(bounds, poses[begin], poses[row], tolerances, strict=True)
        narrower = [
            (max(low, (now - then - tolerance) / step), min(high, (now - then + tolerance) / step))
            for (low, high), then, now, tolerance in columns
        ]
        if any(low > high for low, high in narrower):
            firsts.append(row)
            begin = row
            narrower = unbounded
        bounds = narrower
    first = np.array(firsts)
    return first, np.append(first[1:], len(times)) - 1


def _resolution(pose: Array) -> Array:
    """Unit (3,) to which each column of poses (n, 3) was rounded, between 1e-2 and 1e-6."""
    x, y, phi = pose.T
    # headings may be rounded before or after unwrapping
    phi_unit = max(_unit_of(phi), _unit_of(wrap_angle(phi)))
    return np.array([_unit_of(x), _unit_of(y), phi_unit])


def _unit_of(values: Array) -> float:
    """The largest of _UNITS of which all values (n,) are multiples, or else the smallest."""
    for unit in _UNITS.tolist():
        if (np.abs(values - unit * np.round(values / unit)) < _ROUNDED).all():
            return float(unit)
    return float(_UNITS[-1])
