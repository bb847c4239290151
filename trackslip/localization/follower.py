"""Tracks through recorded scans: a few are located independently, then all of them near the track between these.

Locating a scan independently takes fits from several starts. Near an expected pose, one start is enough.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from scipy.interpolate import interp1d

from trackslip.kinematics import Array
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.likelihood import EDGE_ON, viewing_angle
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

EVERY = 8  # number of scans out of which one is located independently


class Follower:
    """Follows N robots through recorded scans, which come in blocks.

    What is found does not depend on the blocks if all but the last one have a multiple of EVERY scans.
    """

    def __init__(self, locator: Locator, tracker: Tracker) -> None:
        """`tracker` follows the N robots from their first scan."""
        self._locator, self._tracker, self._of_keys = locator, tracker, copy.deepcopy(tracker)

    def follow(self, scan: Scan, angle: Array) -> PoseEstimate:
        """Poses (N, T) in the next scans, with ranges (N, T, B), of each robot.

        `angle` is how far the sprockets turned since the scan before each, (N, T, 2) [rad].
        """
        rows = scan.ranges.shape[1]
        keys = np.append(np.arange(EVERY - 1, rows - 1, EVERY), rows - 1)
        start = self._of_keys.predict(angle[:, 0], 0.0)  # where the block before ended
        turned = np.add.reduceat(angle, np.append(0, keys[:-1] + 1), axis=1)
        known = self._tracked(self._of_keys, replace(scan, ranges=scan.ranges[:, keys]), turned)
        path = np.concatenate([start[:, None], known.pose], axis=1)
        expected = interp1d(np.append(-1, keys), path, axis=1)(np.arange(rows))
        return self._tracked(self._tracker, scan, angle, expected.reshape(-1, 3))

    def _tracked(self, tracker: Tracker, scan: Scan, angle: Array, expected: Array | None = None) -> PoseEstimate:
        """Tracked poses (N, T) in scans that are all located at once, near expected poses (N T, 3) if there are any.

        Where the tracker rejects a pose, something else was taken for the plate, and the plate is searched for again,
        near the predicted pose.
        """
        robots, rows, beams = scan.ranges.shape
        single = self._locator.locate(replace(scan, ranges=scan.ranges.reshape(-1, beams)), expected)
        tracked = []
        for row in range(rows):
            predicted = tracker.predict(angle[:, row], 1.0)
            here = single.take(rows * np.arange(robots) + row)
            edge_on = viewing_angle(scan.from_world(predicted)) < EDGE_ON
            doubted = np.flatnonzero(~tracker.believes(here) & ~edge_on)
            if doubted.size:
                part = replace(scan, ranges=scan.ranges[doubted, row])
                here.put(doubted, self._locator.locate(part, predicted[doubted]))
            tracked.append(tracker.update(here))
        parts = zip(*(vars(track).values() for track in tracked), strict=True)
        return PoseEstimate(*(np.stack(part, axis=1) for part in parts))
