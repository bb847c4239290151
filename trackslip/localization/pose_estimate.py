"""Poses of robots as estimated from scans, and the protocol of locators that estimate them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import Scan
from trackslip.viewable import ShortRepr


@dataclass(frozen=True, repr=False)
class PoseEstimate(ShortRepr, Rows):
    """Poses of the robot in the world frame, with covariances and validity."""

    pose: Array  # (S, 3) [m, m, rad]
    covariance: Array  # (S, 3, 3) of (x, y, phi); NaN where a locator found no valid pose
    # (S,) bool; a locator's invalid pose is meaningless, a tracker's is predicted
    valid: np.ndarray


class Locator(Protocol):
    """Locator of the plate in single scans, from which headings are ambiguous by half a turn (see
    `Tracker`).
    """

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Locate the plate in scans with ranges (S, B), near expected robot poses `predicted` (S,
        3) in the world.
        """
