"""Tracks through recorded scans: a few are located independently, the others between them.

Locating a scan independently takes fits from several starts. Between two known poses, one start is enough.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.likelihood import EDGE_ON, viewing_angle
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

EVERY = 8  # number of scans out of which one is located independently


class Follower:
    """Follows N robots through recorded scans, which come in blocks.

    What is found does not depend on the blocks if all but the last one end with a scan whose number, counted from 0, is
    a multiple of EVERY.
    """

    def __init__(self, locator: Locator, tracker: Tracker) -> None:
        """`tracker` follows the N robots from their first scan."""
        self._locator, self._tracker = locator, tracker
        self._of_keys = copy.deepcopy(tracker)
        self._rows = 0  # scans so far
        self._last: PoseEstimate | None = None  # (N, 1) at the last of them

    def follow(self, scan: Scan, angle: Array) -> PoseEstimate:
        """Poses (N, T) in the next scans, with ranges (N, T, B), of each robot.

        Where the tracker rejects a pose, something else was taken for the plate, and the plate is searched for again,
        near the predicted pose. `angle` is how far the sprockets turned since the scan before each, (N, T, 2) [rad].
        """
        locator = self._locator
        robots, rows, _ = scan.ranges.shape
        covariance, valid = np.empty((robots, rows, 3, 3)), np.zeros((robots, rows), bool)
        single = PoseEstimate(np.empty((robots, rows, 3)), covariance, valid)
        keys = np.flatnonzero((np.arange(self._rows, self._rows + rows) % EVERY == 0) | (np.arange(rows) == rows - 1))
        alone = np.zeros((robots, rows), bool)
        alone[:, keys] = True
        _locate(locator, scan, single, alone)
        turned = np.add.reduceat(angle, np.append(0, keys[:-1] + 1), axis=1)
        known = _track(locator, scan, single, self._of_keys, keys, turned)
        last = _at(known, [-1])
        if self._last is not None:
            known, keys = _joined(self._last, known), np.append(-1, keys)
        if not alone.all():
            between, expected = _between(known, keys, rows)
            _locate(locator, scan, single, between & ~alone, expected)
            _locate(locator, scan, single, ~(between & single.valid) & ~alone)
        self._rows, self._last = self._rows + rows, last
        return _track(locator, scan, single, self._tracker, np.arange(rows), angle)


def _locate(
    locator: Locator, scan: Scan, single: PoseEstimate, where: np.ndarray, expected: Array | None = None
) -> None:
    """Locate the scans `where` (N, T), near expected poses (N, T, 3) if there are any, and put them into `single`."""
    if where.any():
        part = replace(scan, ranges=scan.ranges[where])
        single.put(where, locator.locate(part, None if expected is None else expected[where]))


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
        edge_on = viewing_angle(scan.from_world(expected)) < EDGE_ON
        doubted = np.flatnonzero(~tracker.believes(here) & ~edge_on)
        if doubted.size:
            here.put(doubted, locator.locate(replace(scan, ranges=scan.ranges[doubted, row]), expected[doubted]))
        tracked.append(tracker.update(here))
    parts = zip(*(vars(track).values() for track in tracked), strict=True)
    return PoseEstimate(*(np.stack(part, axis=1) for part in parts))


def _at(estimate: PoseEstimate, rows: Sequence[int]) -> PoseEstimate:
    return PoseEstimate(estimate.pose[:, rows], estimate.covariance[:, rows], estimate.valid[:, rows])


def _joined(first: PoseEstimate, second: PoseEstimate) -> PoseEstimate:
    parts = zip(vars(first).values(), vars(second).values(), strict=True)
    return PoseEstimate(*(np.concatenate(part, axis=1) for part in parts))


def _between(known: PoseEstimate, keys: np.ndarray, rows: int) -> tuple[np.ndarray, Array]:
    """Mask (N, T) of the rows between valid poses `known` (N, K), and poses (N, T, 3) interpolated between these.

    The first of the rows `keys` (K,) may be -1, the one before them.
    """
    row = np.arange(rows)
    after = np.maximum(np.searchsorted(keys, row), 1)
    before = after - 1
    share = ((row - keys[before]) / (keys[after] - keys[before]))[:, None]
    expected = (1 - share) * known.pose[:, before] + share * known.pose[:, after]
    return known.valid[:, before] & known.valid[:, after], expected
