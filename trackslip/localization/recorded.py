"""Tracks through scans that have all been recorded: a few are located on their own, the others between them.

Locating a scan on its own takes fits from several starts. Between two known poses the encoders tell where the robot was
so well that one start is enough.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, advance, body_twist
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

_EVERY = 8  # one scan of so many is located on its own


def follow(locator: Locator, scan: Scan, tracker: Tracker, angle: Array) -> PoseEstimate:
    """Poses (N, T) of N robots in scans with ranges (N, T, B).

    Where the tracker rejects a pose, something else was taken for the plate, and the plate is searched for again, near
    the predicted pose.

    Args:
        locator: finds the plate.
        scan: T successive scans of each robot.
        tracker: of the N robots at the scan before the first; led on to the last one.
        angle: how far the sprockets turned since the scan before each, (N, T, 2) [rad].
    """
    robots, rows, _ = scan.ranges.shape
    single = PoseEstimate(np.empty((robots, rows, 3)), np.empty((robots, rows, 3, 3)), np.zeros((robots, rows), bool))
    keys = np.unique(np.append(np.arange(0, rows, _EVERY), rows - 1))
    alone = np.zeros((robots, rows), bool)
    alone[:, keys] = True
    _locate(locator, scan, single, alone)
    if not alone.all():
        turned = np.add.reduceat(angle, np.append(0, keys[:-1] + 1), axis=1)
        known = _track(locator, scan, single, copy.deepcopy(tracker), keys, turned)
        between, expected = _between(known, keys, _reckoned(angle, tracker.geometry))
        _locate(locator, scan, single, between & ~alone, expected)
        _locate(locator, scan, single, ~(between & single.valid) & ~alone)
    return _track(locator, scan, single, tracker, np.arange(rows), angle)


def _locate(
    locator: Locator, scan: Scan, single: PoseEstimate, where: np.ndarray, expected: Array | None = None
) -> None:
    """Locate the scans `where` (N, T), near expected poses (N, T, 3) if there are any, and put them into `single`."""
    if where.any():
        part = replace(scan, ranges=scan.ranges[where])
        _put(single, where, locator.locate(part, None if expected is None else expected[where]))


def _track(
    locator: Locator, scan: Scan, single: PoseEstimate, tracker: Tracker, rows: np.ndarray, angle: Array
) -> PoseEstimate:
    """Tracked poses (N, R) in the scans `rows` (R,), between which the sprockets turn by `angle` (N, R, 2) [rad].

    Those that the tracker rejects are located again in place, in `single` (N, T).
    """
    tracked = []
    for k, row in enumerate(rows):
        expected = tracker.predict(angle[:, k], 1.0)
        here = PoseEstimate(single.pose[:, row], single.covariance[:, row], single.valid[:, row])  # views
        doubted = np.flatnonzero(~tracker.believes(here))
        if doubted.size:
            _put(here, doubted, locator.locate(replace(scan, ranges=scan.ranges[doubted, row]), expected[doubted]))
        tracked.append(tracker.update(here))
    parts = zip(*(vars(one).values() for one in tracked), strict=True)
    return PoseEstimate(*(np.stack(part, axis=1) for part in parts))


def _put(estimate: PoseEstimate, where: np.ndarray, part: PoseEstimate) -> None:
    estimate.pose[where], estimate.covariance[where], estimate.valid[where] = part.pose, part.covariance, part.valid


def _reckoned(angle: Array, geometry: RobotGeometry) -> Array:
    """Poses (N, T, 3) to which sprockets that turn by `angle` (N, T, 2) lead without slip, from any start."""
    twist = body_twist(angle, 0.0, geometry)
    pose = np.zeros((*twist.shape[:2], 3))
    pose[..., 2] = np.cumsum(twist[..., 1], axis=1)
    before = pose.copy()
    before[..., 2] -= twist[..., 1]
    pose[..., :2] = np.cumsum(advance(before, twist, 1.0)[..., :2], axis=1)
    return pose


def _between(known: PoseEstimate, keys: np.ndarray, reckoned: Array) -> tuple[np.ndarray, Array]:
    """Whether the poses `known` (N, K) before and after each row are valid (N, T), and where they lead (N, T, 3).

    Each of the two leads along the path `reckoned` (N, T, 3), and the closer one counts for more.
    """
    rows = np.arange(reckoned.shape[1])
    after = np.maximum(np.searchsorted(keys, rows), 1)
    before = after - 1
    share = ((rows - keys[before]) / (keys[after] - keys[before]))[:, None]
    expected = np.zeros(reckoned.shape)
    for side, weight in ((before, 1 - share), (after, share)):
        start, pose = reckoned[:, keys[side]], known.pose[:, side]
        step = reckoned - start
        cos, sin = (f(pose[..., 2] - start[..., 2]) for f in (np.cos, np.sin))
        turned = np.stack([cos * step[..., 0] - sin * step[..., 1], sin * step[..., 0] + cos * step[..., 1]], axis=-1)
        expected += weight * (pose + np.concatenate([turned, step[..., 2:]], axis=-1))
    return known.valid[:, before] & known.valid[:, after], expected
