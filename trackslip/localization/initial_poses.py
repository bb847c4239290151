"""Starting poses, and the portions of scans that are fitted together."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.line import fit_line
from trackslip.localization.scan import MIN_RETURNS, Cluster, Plate

MAX_STARTS = 6
"""Maximum number of starts per cluster, reached with an expected pose."""
_BESIDE = np.radians(2.0)  # angle between the line of sight and the two starts beside it
_FROM_SIDE = np.sin(np.radians(30.0))  # of the angle between line and sight
_WHOLE = 0.8  # fraction of a side above which both of its visible ends locate it
_CHUNK = 120_000  # returns times starts processed at a time, which stay in the cache


def starts(cluster: Cluster, plate: Plate, beam_step: float, near: Array | None) -> Array:
    """Poses (S, K, 3) to start from.

    These have the heading of the line, its mirror image, and headings on both sides of edge-on; then follows the
    expected pose. If the line is seen from the side, the edge-on starts are replaced by the pose of the line, shifted
    slightly towards both ends or, if part of the plate is out of sight, as far as it may extend.
    """
    line = fit_line(cluster)
    distance = np.hypot(line.middle[:, 0], line.middle[:, 1])
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    from_side = np.abs(np.sin(line.heading - sight)) > _FROM_SIDE
    whole = line.extent > _WHOLE * plate.length
    slide = np.where(from_side, np.where(whole, distance * beam_step / 2, plate.length - line.extent), 0.0)
    end = slide[:, None] * np.stack([np.cos(line.heading), np.sin(line.heading), np.zeros(len(slide))], axis=-1)
    poses = [place(cluster, heading, line.middle, plate) for heading in (line.heading, 2 * sight - line.heading)]
    for sign in (1, -1):
        heading = np.where(from_side, line.heading, sight + sign * _BESIDE)
        poses.append(place(cluster, heading, line.middle, plate) + sign * end)
    if near is not None:
        poses += [place(cluster, near[:, 2], line.middle, plate), near]
    return np.stack(poses, axis=1)


def place(cluster: Cluster, heading: Array, middle: Array, plate: Plate) -> Array:
    """Poses (S, 3) of plates with `heading` (S,) whose near faces touch the returns around `middle` (S, 2)."""
    row = cluster.row
    x, y = cluster.range * np.cos(cluster.bearing), cluster.range * np.sin(cluster.bearing)
    e = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    n = np.stack([-e[:, 1], e[:, 0]], axis=-1)
    centre = np.zeros((len(heading), 2))
    for axis, size in ((e, plate.length), (n, plate.thickness)):
        low, high = cluster.extremes(x * axis[row, 0] + y * axis[row, 1])
        away = np.sum(axis * middle, axis=1) > 0  # the LRF is on the low side
        near = np.where(away, low + size / 2, high - size / 2)  # unless almost all of a side is seen, its near end is
        centre += np.where(high - low > _WHOLE * size, (low + high) / 2, near)[:, None] * axis
    return np.concatenate([centre, heading[:, None]], axis=-1)


def portions(cluster: Cluster, starts_each: int, among: np.ndarray | None = None) -> list[np.ndarray]:
    """Rows of clusters with MIN_RETURNS or more returns, in portions whose memory is bounded, of those in a mask."""
    wanted = cluster.count >= MIN_RETURNS
    rows = np.flatnonzero(wanted if among is None else wanted & among)
    total = starts_each * cluster.count[rows].cumsum()
    if not rows.size or total[-1] <= _CHUNK:
        return [rows] if rows.size else []
    return np.split(rows, np.searchsorted(total, np.arange(_CHUNK, total[-1], _CHUNK)))
