"""Tracking of robots through the poses from single scans, scan by scan or in recorded scans.

Half turns are resolved, outliers rejected, and gaps bridged by the encoders. A few of the recorded
scans are located independently, by fits from several initial poses; then all scans are located near
the track through these few.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.interpolate import interp1d

from trackslip.kinematics import Array, RobotGeometry, advance, twist_of_tracks
from trackslip.localization.likelihood import EDGE_ON, viewing_angle
from trackslip.localization.pose_estimate import Locator, PoseEstimate
from trackslip.localization.scan import Scan
from trackslip.restorable import Restorable

GATE_POSITION: Final = 0.10
"""Maximum distance of a valid pose from its prediction, plus an allowance for driving without poses
[m].
"""
GATE_HEADING: Final = np.radians(20.0)
"""The same for the heading [rad]."""
GROWTH: Final = 0.3
"""Error of dead reckoning relative to the distance and turn since the last valid pose [-]."""
BLIND_TURN: Final = np.radians(60.0)
"""Expected heading error above which the robot is lost [rad]. The sum with GATE_HEADING must be
below pi / 2.
"""
EVERY: Final = 8  # interval between scans that are located independently [scans]


class Tracker(Restorable):
    """Tracker of N robots from scan to scan.

    The heading of a plate is ambiguous by half a turn, so the heading nearest to the prediction is
    used. The prediction propagates the last pose by the encoders without slip, and is off by less
    than a millimetre over one scan.
    """

    STATE = ("_pose", "_blind", "_last")

    def __init__(self, start: Array, geometry: RobotGeometry) -> None:
        """Start from the known poses `start` (N, 3) of the robots in the world frame."""
        self._pose: Array = np.array(start, float)
        self.geometry = geometry
        # distance [m] and turn [rad] since the last valid poses
        self._blind = np.zeros((len(self._pose), 2))
        self._last: Array = np.zeros((len(self._pose), 3, 3))  # covariances of the last valid poses

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Restart the tracks of some `robots` (R,) at known poses `start` (R, 3)."""
        self._pose[robots] = start
        self._blind[robots] = 0.0
        self._last[robots] = 0.0

    def predict(self, omega: Array, duration: float) -> Array:
        """Propagate the poses by sprocket speeds (N, 2) [rad/s] held for `duration` [s], and return
        them (N, 3).
        """
        # without slip
        twist = twist_of_tracks(self.geometry.sprocket_radius * omega, self.geometry.half_gauge)
        self._pose = advance(self._pose, twist, duration)
        self._blind += np.abs(twist) * duration
        return self._pose.copy()

    def believes(self, estimate: PoseEstimate) -> np.ndarray:
        """Mask (N,) of the robots whose estimates are valid and close enough to the predictions."""
        away = self._unwrapped(estimate.pose) - self._pose
        growth = GROWTH * self._blind
        far = np.hypot(away[:, 0], away[:, 1]) > GATE_POSITION + growth[:, 0]
        turned = np.abs(away[:, 2]) > GATE_HEADING + growth[:, 1]
        lost = growth[:, 1] > BLIND_TURN
        return estimate.valid & ~far & ~turned & ~lost

    def update(self, estimate: PoseEstimate) -> PoseEstimate:
        """Continue the tracks with one estimate per robot. Predictions, marked invalid, replace
        rejected estimates.
        """
        pose, valid = self._unwrapped(estimate.pose), self.believes(estimate)
        self._pose[valid] = pose[valid]
        self._blind[valid] = 0.0
        self._last[valid] = estimate.covariance[valid]
        return PoseEstimate(self._pose.copy(), self._covariance(), valid)

    def _unwrapped(self, pose: Array) -> Array:
        """Poses (N, 3) with headings shifted by half turns, so that they are nearest to the
        predictions.
        """
        unwrapped = pose.copy()
        unwrapped[:, 2] -= np.rint((pose[:, 2] - self._pose[:, 2]) / np.pi) * np.pi
        return unwrapped

    def _covariance(self) -> Array:
        """Covariances (N, 3, 3) of the last valid poses plus their growth over the distance driven
        since.

        Slip is not white noise: its error grows in proportion to distance, and a heading error adds
        a lateral error.
        """
        way, turn = self._blind.T
        heading = GROWTH * turn
        astray = way * np.sqrt(self._last[:, 2, 2] + heading**2)
        covariance = self._last.copy()
        covariance[:, [0, 1], [0, 1]] += ((GROWTH * way) ** 2 + astray**2)[:, None]
        covariance[:, 2, 2] += heading**2
        return covariance


class Follower:
    """Tracker of N robots through recorded scans, which are processed in blocks.

    The result does not depend on the blocks if the number of scans in all but the last is a
    multiple of EVERY.
    """

    def __init__(self, locator: Locator, tracker: Tracker) -> None:
        """Store the locator, and the `tracker` with the poses of the N robots in their first
        scan.
        """
        self._locator, self._tracker, self._of_keys = locator, tracker, copy.deepcopy(tracker)

    def follow(self, scan: Scan, angle: Array) -> PoseEstimate:
        """Track the N robots through the next block of T scans, with ranges (N, T, B).

        `angle` (N, T, 2) are the angles by which the sprockets turned from the previous scan to
        each scan [rad].
        """
        rows = scan.ranges.shape[1]
        keys = np.append(np.arange(EVERY - 1, rows - 1, EVERY), rows - 1)
        start = self._of_keys.predict(angle[:, 0], 0.0)  # poses at the end of the previous block
        turned = np.add.reduceat(angle, np.append(0, keys[:-1] + 1), axis=1)
        known = self._tracked(self._of_keys, replace(scan, ranges=scan.ranges[:, keys]), turned)
        path = np.concatenate([start[:, None], known.pose], axis=1)
        expected = interp1d(np.append(-1, keys), path, axis=1)(np.arange(rows))
        return self._tracked(self._tracker, scan, angle, expected.reshape(-1, 3))

    def _tracked(
        self, tracker: Tracker, scan: Scan, angle: Array, expected: Array | None = None
    ) -> PoseEstimate:
        """Track the N robots through T scans that are all located at once, from expected poses (N
        T, 3) if known.

        Where the tracker rejects a pose, another object was mistaken for the plate, and the plate
        is located again from the predicted pose.
        """
        robots, rows, beams = scan.ranges.shape
        single = self._locator.locate(
            replace(scan, ranges=scan.ranges.reshape(-1, beams)), expected
        )
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
