"""The protocol of locators, and what they return: arrays with a row per scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


@dataclass(frozen=True)
class Rows:
    """Base of dataclasses of arrays that share their first axis."""

    def take(self, rows: np.ndarray) -> Self:
        """The rows `rows`, in that order, possibly repeated."""
        return type(self)(**{name: values[rows] for name, values in vars(self).items()})

    def put(self, rows: np.ndarray, other: Self) -> None:
        """Overwrite the rows `rows` (R,) with the R rows of `other`."""
        for mine, others in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = others


@dataclass(frozen=True)
class PoseEstimate(Rows):
    """Poses of the robot in the world."""

    pose: Array  # (S, 3) [m, m, rad]
    covariance: Array  # (S, 3, 3) of (x, y, phi); NaN where a locator found no valid pose
    valid: np.ndarray  # (S,) bool; where false, the pose of a locator is meaningless, that of a tracker is predicted


class Locator(Protocol):
    """Finds the plate in each scan independently, so the heading is known only up to half a turn (see `Tracker`)."""

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses in scans with ranges (S, B); `predicted` (S, 3) are expected poses of the robot in the world."""
