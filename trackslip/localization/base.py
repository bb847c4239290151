"""The protocol of locators, and what they return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


@dataclass(frozen=True)
class PoseEstimate:
    """Poses of the robot in the world."""

    pose: Array  # (S, 3) [m, m, rad]
    covariance: Array  # (S, 3, 3) of (x, y, phi); NaN where a locator found no valid pose
    valid: np.ndarray  # (S,) bool; where false, the pose of a locator is meaningless, that of a tracker is predicted


class Locator(Protocol):
    """Finds the plate in each scan independently, so the heading is known only up to half a turn (see `Tracker`)."""

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses in scans with ranges (S, B); `predicted` (S, 3) are expected poses of the robot in the world."""
