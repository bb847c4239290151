"""Robots on circles, and their poses tracked through scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, advance
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

PERIOD = 0.05
GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
_ICR = 0.05  # how much farther apart than the tracks the centres of rotation are: the slip [m]


@dataclass(frozen=True)
class Drive:
    """N robots that drive steadily, each on its circle."""

    pose: Array  # (T, N, 3) true
    omega: Array  # (N, 2) sprocket speeds, with slip [rad/s]


def circles(radius: Array, rate: Array, start: Array, rows: int) -> Drive:
    """Drive with radii and turn rates (N,) from poses (N, 3), a row a scan."""
    twist = np.column_stack([np.abs(rate) * radius, rate])
    poses = [start]
    for _ in range(rows - 1):
        poses.append(advance(poses[-1], twist, PERIOD))
    lever = (GEOMETRY.half_gauge + _ICR) * rate
    tracks = np.column_stack([twist[:, 0] - lever, twist[:, 0] + lever])
    return Drive(np.stack(poses), tracks / GEOMETRY.sprocket_radius)


def track_afterwards(scan: Scan, drive: Drive, locator: Locator) -> PoseEstimate:
    """Poses (T * N) from scans (T * N, B), located all at once; those refused are located again where expected."""
    single = locator.locate(scan)

    def estimate(rows: slice, expected: Array, tracker: Tracker) -> PoseEstimate:
        found = PoseEstimate(single.pose[rows], single.covariance[rows], single.valid[rows])
        refused = np.flatnonzero(~tracker.believes(found))
        if refused.size:
            again = locator.locate(replace(scan, ranges=scan.ranges[rows][refused]), expected[refused])
            for old, new in zip(vars(found).values(), vars(again).values(), strict=True):
                old[refused] = new
        return found

    return _tracked(drive, estimate)


def track_online(scan: Scan, drive: Drive, locator: Locator) -> PoseEstimate:
    """Poses (T * N) from scans (T * N, B), each located where its robot is expected."""
    return _tracked(drive, lambda rows, at, _: locator.locate(replace(scan, ranges=scan.ranges[rows]), at))


def _tracked(drive: Drive, estimate: Callable[[slice, Array, Tracker], PoseEstimate]) -> PoseEstimate:
    count = drive.pose.shape[1]
    tracker = Tracker(drive.pose[0], GEOMETRY)
    found = []
    for k in range(len(drive.pose)):
        expected = tracker.predict(drive.omega, PERIOD if k > 0 else 0.0)
        found.append(tracker.update(estimate(slice(k * count, (k + 1) * count), expected, tracker)))
    return PoseEstimate(*(np.concatenate(parts) for parts in zip(*(vars(e).values() for e in found), strict=True)))
