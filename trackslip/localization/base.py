"""What a locator is and returns."""

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
    covariance: Array  # (S, 3, 3) of (x, y, phi); of a locator NaN where not valid
    valid: np.ndarray  # (S,) bool; where false, a locator's pose means nothing, a tracker's is a prediction


class Locator(Protocol):
    """Finds the plate in scans, each on its own: the heading is known only up to half a turn (see `Tracker`)."""

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B).

        Args:
            scan: the scans.
            predicted: poses (S, 3) in the world where the robot is expected, if anything is known.
        """
        ...
