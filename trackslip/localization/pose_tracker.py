"""Tracking of robots through the poses from single scans, scan by scan or in recorded scans.

Half turns are resolved, outliers rejected, and gaps bridged by the encoders. A few of the recorded
scans are located independently, by fits from several initial poses; then all scans are located near
the track through these few.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import ClassVar, Final

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
"""Error of dead reckoning without slip, relative to the distance and turn since the last valid pose
[-].
"""
BLIND_TURN: Final = np.radians(60.0)
"""Expected heading error above which the robot is lost [rad]. The sum with GATE_HEADING must be
below pi / 2.
"""
EVERY: Final = 8
"""Interval between scans that are located independently [scans]."""


class Tracker(Restorable):
    """Tracker of N robots from scan to scan.

    The heading of a plate is ambiguous by half a turn, so the heading nearest to the prediction is
    used. The prediction propagates the last pose by the encoders without slip, and is off by less
    than a millimetre over one scan.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_pose", "_unseen", "_last_covariance")

    def __init__(self, start: Array, geometry: RobotGeometry) -> None:
        """Start from the known poses `start` (N, 3) of the robots in the world frame."""
        self._pose: Array = np.array(start, float)
        self.geometry = geometry
        robots = len(self._pose)
        # (N, 2) distance [m] and turn [rad] since the last valid poses
        self._unseen = np.zeros((robots, 2))
        # (N, 3, 3) covariances of the last valid poses
        self._last_covariance: Array = np.zeros((robots, 3, 3))
        # (N,) errors of dead reckoning relative to the distance and turn [-]
        self._growth: Array = np.full(robots, GROWTH)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Restart the tracks of some `robots` (R,) at known poses `start` (R, 3)."""
        self._pose[robots] = start
        self._unseen[robots] = 0.0
        self._last_covariance[robots] = 0.0

    def predict(self, omega: Array, duration: float) -> Array:
        """Propagate the poses by sprocket speeds (N, 2) [rad/s] held for `duration` [s], and return
        them (N, 3).
        """
        # without slip
        twist = twist_of_tracks(self.geometry.sprocket_radius * omega, self.geometry.half_gauge)
        self._pose = advance(self._pose, twist, duration)
        self._unseen += np.abs(twist) * duration
        return self._pose.copy()

    def believes(self, estimate: PoseEstimate) -> np.ndarray:
        """Mask (N,) of the robots whose estimates are valid and close enough to the predictions."""
        error = self._nearest_half_turn(estimate.pose) - self._pose
        distance = np.hypot(error[:, 0], error[:, 1])
        turn = np.abs(error[:, 2])
        growth = self._growth[:, None] * self._unseen
        is_near = distance <= GATE_POSITION + growth[:, 0]
        is_aligned = turn <= GATE_HEADING + growth[:, 1]
        is_lost = growth[:, 1] > BLIND_TURN
        return estimate.valid & is_near & is_aligned & ~is_lost

    def update(self, estimate: PoseEstimate) -> PoseEstimate:
        """Continue the tracks with one estimate per robot. Predictions, marked invalid, replace
        rejected estimates.
        """
        pose = self._nearest_half_turn(estimate.pose)
        valid = self.believes(estimate)
        self._pose[valid] = pose[valid]
        self._unseen[valid] = 0.0
        self._last_covariance[valid] = estimate.covariance[valid]
        return PoseEstimate(self._pose.copy(), self._covariance(), valid)

    def _nearest_half_turn(self, pose: Array) -> Array:
        """Poses (N, 3) with headings shifted by half turns, so that they are nearest to the
        predictions.
        """
        shifted = pose.copy()
        half_turns = np.rint((pose[:, 2] - self._pose[:, 2]) / np.pi)
        shifted[:, 2] -= half_turns * np.pi
        return shifted

    def _covariance(self) -> Array:
        """Covariances (N, 3, 3) of the last valid poses plus their growth over the distance driven
        since.

        Slip is not white noise: its error grows in proportion to distance, and a heading error adds
        a lateral error. So with the distance l and the turn t driven since, the share g of both
        that is wrong, and the variance V of the last heading, the heading's variance grows by
        (g t)^2, and those of x and y by (g l)^2 + l^2 (V + (g t)^2).
        """
        distance, turn = self._unseen.T
        heading_error = self._growth * turn
        lateral_error = distance * np.sqrt(self._last_covariance[:, 2, 2] + heading_error**2)
        position_variance = (self._growth * distance) ** 2 + lateral_error**2
        covariance = self._last_covariance.copy()
        covariance[:, 0, 0] += position_variance
        covariance[:, 1, 1] += position_variance
        covariance[:, 2, 2] += heading_error**2
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
        self._locator = locator
        self._tracker = tracker
        self._key_tracker = copy.deepcopy(tracker)  # through the scans located independently

    def follow(self, scan: Scan, angle: Array) -> PoseEstimate:
        """Track the N robots through the next block of T scans, with ranges (N, T, B).

        `angle` (N, T, 2) are the angles by which the sprockets turned from the previous scan to
        each scan [rad].
        """
        rows = scan.ranges.shape[1]
        keys = np.append(np.arange(EVERY - 1, rows - 1, EVERY), rows - 1)

        # a track through a few scans, from the pose at the end of the previous block
        start = self._key_tracker.predict(angle[:, 0], 0.0)
        first_after_key = np.append(0, keys[:-1] + 1)
        angle_to_key = np.add.reduceat(angle, first_after_key, axis=1)
        key_scan = replace(scan, ranges=scan.ranges[:, keys])
        track = self._tracked(self._key_tracker, key_scan, angle_to_key)

        # all scans, near that track
        known_rows = np.append(-1, keys)
        known_poses = np.concatenate([start[:, None], track.pose], axis=1)
        expected = interp1d(known_rows, known_poses, axis=1)(np.arange(rows))
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
        all_scans = replace(scan, ranges=scan.ranges.reshape(-1, beams))
        located = self._locator.locate(all_scans, expected)
        tracked = []
        for row in range(rows):
            predicted = tracker.predict(angle[:, row], 1.0)
            here = located.take(rows * np.arange(robots) + row)

            # rejected poses are located again, except where a scan determines none
            is_edge_on = viewing_angle(scan.from_world(predicted)) < EDGE_ON
            rejected = np.flatnonzero(~tracker.believes(here) & ~is_edge_on)
            if rejected.size:
                part = replace(scan, ranges=scan.ranges[rejected, row])
                here.put(rejected, self._locator.locate(part, predicted[rejected]))
            tracked.append(tracker.update(here))
        return PoseEstimate(
            pose=np.stack([one.pose for one in tracked], axis=1),
            covariance=np.stack([one.covariance for one in tracked], axis=1),
            valid=np.stack([one.valid for one in tracked], axis=1),
        )
