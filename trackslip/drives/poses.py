"""Measured poses: those that repeat the pose before or were interpolated are left out."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import STANDING


def changing(log: RunLog, rows: np.ndarray) -> np.ndarray:
    """(n,) bool: false for a held pose in `rows` (n,), which equals the previous pose although the
    sprockets turned.

    Poses without positions always count as changing, since headings are constant on a straight.
    """
    turned = np.append(0.0, np.cumsum(np.abs(log.omega[1:]).max(axis=1) * np.diff(log.time)))[rows]
    pose = np.nan_to_num(log.pose[rows])
    same = (np.diff(pose, axis=0) == 0).all(axis=1) & np.isfinite(log.pose[rows[1:], 0])
    return np.append(True, ~(same & (np.diff(turned) > STANDING)))[: len(rows)]


def measured_poses(time: Array, pose: Array) -> tuple[Array, Array]:
    """Drop poses that were interpolated linearly between measured poses: only ends of straight
    stretches are kept.

    If a stretch ends between two rows, the measured pose is where the lines through both stretches
    meet.
    """
    finite = np.nan_to_num(pose)
    first, last = _straight_stretches(time, finite, _resolution(finite))
    inside = last - first > 1
    if (last - first)[inside].sum() < max(10, 0.5 * len(time)):
        return time, pose
    time, pose = time.copy(), pose.copy()
    rate = (finite[last] - finite[first]) / np.maximum(time[last] - time[first], 1e-300)[:, None]
    for k in np.flatnonzero(inside[:-1] & inside[1:]):
        end, begin, bend = last[k], first[k + 1], rate[k] - rate[k + 1]
        step = finite[begin] - finite[end] - rate[k + 1] * (time[begin] - time[end])
        later = np.clip(step @ bend / max(bend @ bend, 1e-300), 0.0, time[begin] - time[end])
        time[end] += later
        pose[end] += rate[k] * later
    rows = np.unique(np.concatenate([first[:1], last, first[1:][~(inside[:-1] & inside[1:])]]))
    return time[rows], pose[rows]


def _straight_stretches(
    time: Array, pose: Array, resolution: Array
) -> tuple[np.ndarray, np.ndarray]:
    """First and last rows of the longest stretches of poses (n, 3) that lie on a line to within
    `resolution` (3,).

    A stretch continues as long as some line from its first pose passes through all later poses (J.
    O'Rourke, *An on-line algorithm for fitting straight lines between data ranges*, 1981).
    """
    firsts, begin, bounds = [0], 0, [(-np.inf, np.inf)] * 3
    times, poses, spans = time.tolist(), pose.tolist(), resolution.tolist()
    for row in range(1, len(times)):
        step = times[row] - times[begin]
        changes = zip(bounds, poses[row], poses[begin], spans, strict=True)
        narrower = [
            (max(low, (now - then - span) / step), min(high, (now - then + span) / step))
            for (low, high), now, then, span in changes
        ]
        if any(low > high for low, high in narrower):
            firsts.append(row)
            begin, narrower = row, [(-np.inf, np.inf)] * 3
        bounds = narrower
    begins = np.array(firsts)
    return begins, np.append(begins[1:], len(times)) - 1


def _resolution(pose: Array) -> Array:
    """Unit (3,) to which each column of poses (n, 3) was rounded, between 1e-2 and 1e-6."""
    # headings may be rounded before or after unwrapping
    columns = np.column_stack([pose, wrap_angle(pose[:, 2])])
    places = 10.0 ** -np.arange(2, 7)
    rounded = [
        (np.abs(columns - place * np.round(columns / place)) < 1e-8).all(axis=0) for place in places
    ]
    x, y, *phi = places[np.where(np.any(rounded, axis=0), np.argmax(rounded, axis=0), -1)]
    return np.array([x, y, max(phi)])
