"""Cramér-Rao bound of the pose from one scan, by finite differences of its ranges and of the
silhouette's edges.

With independent normal errors of standard deviation sigma, the Fisher information of the beams that
hit is J^T J / sigma^2, where J has one row (dr/dx, dr/dy, dr/dphi) per beam. It is singular for a
plate seen broadside: sliding it along itself changes no range. That direction is fixed only by
which beams hit the plate. The corner that forms the edge of the silhouette is uniformly distributed
between the last beam that hit and the first that missed: its bearing is measured with the variance
delta^2 / 12, where delta is the beam step.

The bound doesn't apply where the ranges are not smooth functions of the pose: within a few degrees
of edge-on, where the face that a beam meets determines the heading.
"""

import numpy as np
from beside import rectangle

from trackslip.kinematics import Array
from trackslip.localization.likelihood import viewing_angle
from trackslip.localization.scan import Plate, Scan

MIN_ANGLE = np.radians(3.0)
"""The bound means little at smaller angles from edge-on [rad]."""
_STEP = 1e-7  # of differences [m], [rad]


def pose_bound(pose: Array, plate: Plate, bearings: Array, noise: float) -> Array:
    """Covariances (S, 3, 3) of poses (S, 3) in the LRF's frame that no unbiased estimator beats;
    NaN: undetermined.

    The bearings (B,) ascend in equal steps; `noise` is the standard deviation of a range [m].
    """
    size = plate.length, plate.thickness
    sight = np.arctan2(pose[:, 1], pose[:, 0])
    distance = np.hypot(pose[:, 0], pose[:, 1])
    step = (bearings[-1] - bearings[0]) / (len(bearings) - 1)

    # as many beams towards every plate as the nearest needs; those outside the field of view don't
    # count
    half_diagonal = np.hypot(*size) / 2
    half_angle = np.arcsin(np.minimum(half_diagonal / distance, 1.0))
    spread = int(half_angle.max() / step) + 2
    central = np.round((sight[:, None] - bearings[0]) / step).astype(int)
    beam = central + np.arange(-spread, spread + 1)
    outside = (beam < 0) | (beam >= len(bearings))
    angle = bearings[0] + step * beam
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def ranges(pose: Array) -> Array:
        """Ranges (S, beams)."""
        return rectangle(pose[:, None], size)(np.zeros(2), directions, np.zeros(1))

    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    corners = signs / 2 * size @ [1, 1j]  # of the plate in its own frame, x + iy

    def edges(pose: Array) -> Array:
        """Bearings (S, 2) of the silhouette's two ends from the line of sight."""
        centre = pose[:, None, :2] @ [1, 1j]
        placed = centre + corners * np.exp(1j * pose[:, 2:])  # (S, 4)
        ahead = np.angle(placed * np.exp(-1j * sight[:, None]))
        return np.stack([ahead.min(axis=1), ahead.max(axis=1)], axis=-1)

    # J / sigma of the ranges, and of the edges where they are seen
    with np.errstate(invalid="ignore"):
        by_range = _jacobian(ranges, pose) / noise
    by_range[~np.isfinite(by_range)] = 0.0  # of beams that miss
    by_range[outside] = 0.0
    is_seen = np.abs(edges(pose) + sight[:, None]) < bearings[-1]
    edge_weight = is_seen * np.sqrt(12) / step
    by_edge = _jacobian(edges, pose) * edge_weight[..., None]

    information = by_range.mT @ by_range + by_edge.mT @ by_edge
    bound = np.full_like(information, np.nan)
    full = np.linalg.matrix_rank(information, hermitian=True) == 3
    bound[full] = np.linalg.inv(information[full])
    return bound


def _jacobian(values, pose: Array) -> Array:
    """Central differences (..., 3) of `values` by x, y and heading."""
    columns = []
    for h in _STEP * np.eye(3):
        change = values(pose + h) - values(pose - h)
        columns.append(change / (2 * _STEP))
    return np.stack(columns, axis=-1)


def ratio_to_bound(error: Array, bound: Array) -> Array:
    """Ratios (3,) of the root mean square errors (S, 3) of x, y and heading to the root of the mean
    bound (S, 3, 3).
    """
    mean_square = np.mean(error**2, axis=0)
    variances = np.einsum("sii->si", bound)
    return np.sqrt(mean_square / np.mean(variances, axis=0))


def beside_bound(pose: Array, true_pose: Array, plate: Plate, scan: Scan) -> tuple[Array, Array]:
    """Errors (R, 3) in the world and their bounds (R, 3, 3), of the R scans that determine the
    pose.
    """
    local = scan.from_world(true_pose)
    rows = viewing_angle(local) > MIN_ANGLE
    error = (pose - true_pose)[rows]
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    local_bound = pose_bound(local[rows], plate, scan.bearings, scan.noise)
    bound = scan.covariance_to_world(local_bound)
    full = np.isfinite(bound).all(axis=(1, 2))
    return error[full], bound[full]
