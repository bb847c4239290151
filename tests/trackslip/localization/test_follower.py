"""Following robots through recorded scans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.kinematics import RobotGeometry, advance, body_twist
from trackslip.localization.follower import EVERY, Follower
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Plate

GEOMETRY = RobotGeometry(half_gauge=0.17, sprocket_radius=0.06)
ROWS = 8 * EVERY + 4


def test_what_is_found_does_not_depend_on_the_blocks(scan_rectangle):
    """Nor does it need the encoders to be right: the sprockets slip by a tenth."""
    angle = np.tile([[0.10, 0.14], [0.13, 0.09]], (ROWS, 1, 1)).swapaxes(0, 1)  # (2, ROWS, 2)
    angle[:, 0] = 0.0
    poses = np.empty((2, ROWS, 3))
    poses[:, -1] = [[2.0, 0.4, 0.3], [1.8, -0.5, 2.4]]
    for k in range(ROWS):
        poses[:, k] = advance(poses[:, k - 1], body_twist(0.9 * angle[:, k], 0.0, GEOMETRY), 1.0)
    flat = scan_rectangle(poses.reshape(-1, 3), np.random.default_rng(3))
    scan = replace(flat, ranges=flat.ranges.reshape(2, ROWS, -1))

    def followed(ends):
        follower = Follower(PlateLocator(Plate()), Tracker(poses[:, 0], GEOMETRY))
        blocks = zip([0, *ends], [*ends, ROWS], strict=True)
        found = [follower.follow(replace(scan, ranges=scan.ranges[:, a:b]), angle[:, a:b]) for a, b in blocks]
        return [
            np.concatenate([getattr(one, name) for one in found], axis=1) for name in ("pose", "covariance", "valid")
        ]

    whole = followed([])
    for ends in ([EVERY], [2 * EVERY, 3 * EVERY, 5 * EVERY]):
        for one, other in zip(followed(ends), whole, strict=True):
            np.testing.assert_array_equal(one, other)
    assert whole[2].mean() > 0.95
    error = whole[0] - poses
    assert np.sqrt(np.mean(error[whole[2]][:, :2] ** 2)) < 0.005
