"""What turns residuals of poses into uncorrelated ones of one size, where the poses' covariances are known.

A plate seen broadside is known to a millimetre across and to several along it; a satellite receiver's errors grow under
trees. Only the shape and the relative size of the covariances are used: their scale is estimated with the other noise.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

_MOST = 10.0  # ratio of a standard deviation to the usual one, and of that to it, at most [-]
_MIN_STATED = 0.5  # share of the poses that must state a covariance


def whitening(pose: Array, covariance: Array | None) -> Array | None:
    """Lower left blocks W (K, 3, 3) for poses (K, 3) with covariances (K, 3, 3), NaN where not measured or stated.

    W times a residual of a pose is uncorrelated, and as large as a usual one: two components in m, and the heading's in
    rad, which depends on nothing else. A pose without covariance counts as a usual one. None if hardly any has one, or
    all are alike.
    """
    if covariance is None:
        return None
    known = np.asarray(np.isfinite(pose[:, :2]).all(axis=1))
    stated = known & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
    headed = stated & np.isfinite(pose[:, 2]) & np.isfinite(covariance).all(axis=(1, 2))
    headed &= covariance[:, 2, 2] > 0
    turn = np.where(headed, covariance[:, 2, 2], 1.0)
    lever = np.where(headed[:, None], covariance[:, :2, 2], 0.0) / turn[:, None]
    block = covariance[:, :2, :2] - turn[:, None, None] * lever[:, :, None] * lever[:, None, :]
    block = np.where(stated[:, None, None], block, np.eye(2))
    values, axes = np.linalg.eigh((block + block.swapaxes(1, 2)) / 2)
    stated &= values[:, 0] > 0
    if stated.sum() < _MIN_STATED * known.sum():
        return None
    usual = float(np.sqrt(np.median(values[stated].mean(axis=1))))
    scale = np.where(stated[:, None], _limited(usual / np.sqrt(np.maximum(values, 1e-300))), 1.0)
    found = np.zeros((len(pose), 3, 3))
    found[:, :2, :2] = np.einsum("kij,kj,klj->kil", axes, scale, axes)
    found[:, :2, 2] = -np.einsum("kij,kj->ki", found[:, :2, :2], np.where(stated[:, None], lever, 0.0))
    heading = float(np.sqrt(np.median(turn[headed]))) if headed.any() else 1.0
    found[:, 2, 2] = np.where(headed, _limited(heading / np.sqrt(turn)), 1.0)
    return None if np.allclose(found, np.eye(3)) else found


def _limited(ratio: Array) -> Array:
    return np.clip(ratio, 1 / _MOST, _MOST)
