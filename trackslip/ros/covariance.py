"""Covariances of poses as messages state them: those that mean something."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

_PLANE = [0, 1, 5]  # x, y and yaw out of x, y, z, roll, pitch, yaw
MAX_VARIANCE = np.array([1e3, 1e3, 10.0])
"""Variances of x, y [m^2] and heading [rad^2] above which they stand for "unknown"."""


def planar(stated: Array) -> Array:
    """Covariances (n, 3, 3) of x, y and heading out of those (n, 36) of poses in space."""
    return np.asarray(stated.reshape(-1, 6, 6)[:, _PLANE][:, :, _PLANE])


def knows_heading(covariance: Array) -> np.ndarray:
    """(n,) bool: whether covariances (n, 3, 3) don't call the heading unknown."""
    return np.asarray(~(covariance[:, 2, 2] > MAX_VARIANCE[2]))


def meaningful(covariance: Array, heading: bool) -> Array | None:
    """The covariances (n, 3, 3), NaN where zero or absurd; None if none means anything.

    Absurd are those that aren't finite, not symmetric or not positive, and those above MAX_VARIANCE. Without `heading`,
    its entries are NaN and don't count.
    """
    size = 3 if heading else 2
    block = np.full_like(covariance, np.nan)
    part = covariance[:, :size, :size]
    finite = np.isfinite(part).all(axis=(1, 2))
    variance = np.einsum("nii->ni", part)
    good = finite & (variance > 0).all(axis=1) & (variance <= MAX_VARIANCE[:size]).all(axis=1)
    tame = np.where(good[:, None, None], part, np.eye(size))
    scale = np.sqrt(np.einsum("nii->ni", tame))
    correlation = tame / (scale[:, :, None] * scale[:, None, :])
    good &= np.abs(correlation - correlation.swapaxes(1, 2)).max(axis=(1, 2)) < 1e-6
    good &= np.linalg.eigvalsh((correlation + correlation.swapaxes(1, 2)) / 2)[:, 0] > -1e-9
    if not good.any():
        return None
    block[:, :size, :size] = np.where(good[:, None, None], part, np.nan)
    return block
