"""What the locator holds of each scan until it says which pose it believes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

UNKNOWN = 1e6
"""Variance of what a scan says nothing about."""


@dataclass(frozen=True)
class Solution:
    """What a cluster says, if it is the plate."""

    pose: Array  # (S, 3) in the LRF's frame
    covariance: Array  # (S, 3, 3)
    misfit: Array  # (S,) rms residual of the ranges [standard deviations]
    score: Array  # (S,) log likelihood of the scan, over that of a scan without a plate
    strained: np.ndarray  # (S,) bool: the returns scatter more about the plate than noise explains

    @classmethod
    def none(cls, scans: int) -> Solution:
        """Of scans in which nothing was found."""
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
            self.pose[rows], self.covariance[rows], self.misfit[rows], self.score[rows], self.strained[rows]
        )

    def put(self, rows: np.ndarray, other: Solution) -> None:
        """Overwrite the scans `rows` (R,) with `other`, R of them."""
        for mine, others in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = others

    def improve(self, rows: np.ndarray, other: Solution) -> None:
        """Overwrite those of the scans `rows` (R,) of which `other`, R of them, explains more."""
        better = other.score > self.score[rows]
        self.put(rows[better], other.take(better))
