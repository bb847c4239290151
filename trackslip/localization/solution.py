"""Intermediate results of the locator, before it decides which poses are valid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

UNKNOWN = 1e6
"""Variance of what a scan does not determine."""


@dataclass(frozen=True)
class Solution:
    """The pose of each scan, assuming that its cluster is the plate."""

    pose: Array  # (S, 3) in the LRF's frame
    covariance: Array  # (S, 3, 3)
    misfit: Array  # (S,) rms residual of ranges and edges under the Huber loss [standard deviations]
    score: Array  # (S,) log likelihood of the scan relative to a scan without a plate
    doubtful: np.ndarray  # (S,) bool: something else may be among the returns or in front of the plate

    @classmethod
    def none(cls, scans: int) -> Solution:
        """Placeholder for scans in which nothing was found."""
        return cls(
            np.zeros((scans, 3)),
            np.full((scans, 3, 3), UNKNOWN),
            np.full(scans, np.inf),
            np.full(scans, -np.inf),
            np.zeros(scans, bool),
        )

    def take(self, rows: np.ndarray) -> Solution:
        """The scans `rows`."""
        return Solution(
            self.pose[rows], self.covariance[rows], self.misfit[rows], self.score[rows], self.doubtful[rows]
        )

    def put(self, rows: np.ndarray, other: Solution) -> None:
        """Overwrite the scans `rows` (R,) with the R scans of `other`."""
        for mine, others in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = others

    def improve(self, rows: np.ndarray, other: Solution) -> None:
        """Overwrite those of the scans `rows` (R,) that the R solutions of `other` explain better."""
        better = other.score > self.score[rows]
        self.put(rows[better], other.take(better))
