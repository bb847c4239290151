"""What a covariance tells of a pose along an axis of its plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows


@dataclass(frozen=True)
class PlateAxis(Rows):
    """An axis of each of M plates, the long one or the one across it, and the uncertainty of their poses along it."""

    e: Array  # (M, 3) direction: a unit of (x, y, phi) along the axis
    leaning: Array  # (M, 3) covariance of the place along the axis with x, y and phi
    sigma: Array  # (M,) standard deviation of the place along the axis [m]

    @classmethod
    def of(cls, pose: Array, covariance: Array, sideways: bool = False) -> PlateAxis:
        """Of poses (M, 3) with covariances (M, 3, 3); `sideways` for the axis across the plate."""
        cos, sin, e = np.cos(pose[:, 2]), np.sin(pose[:, 2]), np.zeros(pose.shape)
        e[:, 0], e[:, 1] = (-sin, cos) if sideways else (cos, sin)
        leaning = np.einsum("mij,mj->mi", covariance, e)
        return cls(e, leaning, np.sqrt(np.maximum((leaning * e).sum(axis=1), 1e-12)))

    def change(self, variance: Array) -> Array:
        """What to add to the covariances (M, 3, 3) if the variance along the axis is `variance` (M,) [m2].

        The place along the axis becomes independent of the rest, which keeps the covariance that it has given it.
        """
        given = self.leaning[:, :, None] * self.leaning[:, None, :] / (self.sigma**2)[:, None, None]
        return variance[:, None, None] * self.e[:, :, None] * self.e[:, None, :] - given
