r"""Cramér-Rao bound of the pose from one scan, by the ray model and the silhouette's edges.

A beam u from the LRF meets the face m.p = m.c - s of a plate centred on c, with outward normal -m and half size s, at

    r = (m.c - s) / (m.u),    dr/dc = m / (m.u),    dr/dphi = m'.(c - r u) / (m.u),

where m' = dm/dphi, so that m'.(c - r u) is the distance along the face from its middle to where the beam hits. With
independent normal errors of standard deviation sigma, the Fisher information of the beams that hit is J^T J / sigma^2,
where J has one row (dr/dx, dr/dy, dr/dphi) per beam.

When the plate is seen broadside, only the long face is hit, and (dr/dx, dr/dy) of every row is a multiple of the same
m: sliding the plate along itself changes no range, and the information is singular in that direction. (Across, with n
beams near the normal of the face, it is n / sigma^2.) That direction is fixed only by which beams hit the plate. The
corner that forms the edge of the silhouette is uniformly distributed between the last beam that hit and the first that
missed: a measurement of its bearing b with an error that is uniform over the beam step delta and has the variance

    integral of e^2 / delta over -delta/2..delta/2  =  delta^2 / 12,

with db = (-y dx + x dy + (x d_x + y d_y) dphi) / (x^2 + y^2) for a corner at (x, y) that lies (d_x, d_y) from c.
Each of the two edges adds its 12 / delta^2 to the information, unless it lies outside the field of view.

If a beam that hits returns nothing with probability p, only a share 1 - p of the information of the ranges is left on
average. Beyond the last return, the number of lost beams is geometrically distributed with mean p / (1 - p), which
shifts the corner, and variance p / (1 - p)^2, which is added to the 1 / 12 of each edge. Who knows which beams returned
can do a little better along the plate, since its length tells how many are missing at both ends together.

The bound does not apply where the ranges are not smooth functions of the pose: within a few degrees of edge-on, where
the face that a beam meets determines the heading.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import View, in_axes, viewing_angle
from trackslip.localization.scan import Plate, Scan

MIN_ANGLE = np.radians(3.0)
"""The bound means little at smaller angles from edge-on [rad]."""
_AT_ONCE = 250  # poses, so that they stay in the cache


def pose_bound(pose: Array, plate: Plate, bearings: Array, noise: float, dropout: float = 0.0) -> Array:
    """Covariances (S, 3, 3) of (x, y, phi) that no unbiased estimator from a scan beats; NaN where undetermined.

    Args:
        pose: true poses (S, 3) of the plate in the LRF's frame [m, m, rad].
        plate: the plate in the scan.
        bearings: of the beams (B,), equally spaced, ascending [rad].
        noise: standard deviation of a range [m]; 0 leaves nothing determined.
        dropout: probability that a beam that hits returns nothing [-].
    """
    covariance = np.full((len(pose), 3, 3), np.nan)
    if noise == 0.0:
        return covariance
    information = np.zeros_like(covariance)
    directions = _directed(bearings)
    for start in range(0, len(pose), _AT_ONCE):
        some = pose[start : start + _AT_ONCE]
        aimed = directions.take(_towards(some, plate, bearings), axis=1)
        ranges = np.sqrt(1 - dropout) / noise * _range_jacobian(some, plate, aimed)
        edges = _edge_jacobian(some, plate, bearings) / np.sqrt(1 + 12 * dropout / (1 - dropout) ** 2)
        information[start : start + _AT_ONCE] = ranges.swapaxes(1, 2) @ ranges + edges.swapaxes(1, 2) @ edges
    held = np.linalg.matrix_rank(information, hermitian=True) == 3
    covariance[held] = np.linalg.inv(information[held])
    return covariance


def ratio_to_bound(error: Array, bound: Array) -> Array:
    """Ratios (3,) of the root mean square errors of x, y and heading to the root of the mean bound.

    Args:
        error: pose errors (S, 3), without half turns of the heading.
        bound: covariances (S, 3, 3) in the same frame as the errors.
    """
    return np.sqrt(np.mean(error**2, axis=0) / np.mean(np.einsum("sii->si", bound), axis=0))


def scan_ratio_to_bound(pose: Array, true_pose: Array, plate: Plate, scan: Scan) -> Array:
    """Ratios (3,) to the bound of x, y and heading in the world; of which scans, and arguments, see `beside_bound`."""
    return ratio_to_bound(*beside_bound(pose, true_pose, plate, scan))


def beside_bound(pose: Array, true_pose: Array, plate: Plate, scan: Scan) -> tuple[Array, Array]:
    """Errors (R, 3) in the world and their bounds (R, 3, 3), of the R scans seen MIN_ANGLE or more from edge-on.

    Scans that don't determine the pose are left out.

    Args:
        pose: estimated poses (S, 3) in the world, for example those that are valid.
        true_pose: the true ones (S, 3).
        plate: the plate in the scan.
        scan: its bearings, noise, dropout and mount are used, not its ranges.
    """
    local = scan.from_world(true_pose)
    rows = viewing_angle(local) > MIN_ANGLE
    error = (pose - true_pose)[rows]
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    bound = scan.covariance_to_world(pose_bound(local[rows], plate, scan.bearings, scan.noise, scan.dropout))
    held = np.isfinite(bound).all(axis=(1, 2))
    return error[held], bound[held]


def _towards(pose: Array, plate: Plate, bearings: Array) -> np.ndarray:
    """Indices (S, W) of the bearings (B,) that can meet the plates at poses (S, 3), equally many for all."""
    distance, sight = np.hypot(pose[:, 0], pose[:, 1]), np.arctan2(pose[:, 1], pose[:, 0])
    radius = np.hypot(plate.length, plate.thickness) / 2
    spread = np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0))
    step = (bearings[-1] - bearings[0]) / (len(bearings) - 1)
    count = min(int(np.ceil(2 * spread.max() / step)) + 2, len(bearings))
    if np.any(np.abs(sight) + spread > np.pi):  # behind the LRF, where bearings jump
        count = len(bearings)
    first = np.floor((sight - spread - bearings[0]) / step).astype(int)
    return np.clip(first, 0, len(bearings) - count)[:, None] + np.arange(count)


def _directed(bearings: Array) -> Array:
    """Directions (2, ...) of beams with bearings (...)."""
    return np.array([np.cos(bearings), np.sin(bearings)])


def _range_jacobian(pose: Array, plate: Plate, directions: Array) -> Array:
    """Derivatives (S, W, 3) of ranges in `directions` (2, S, W) by x, y and phi; zero where a beam misses."""
    x, y = pose[:, :1], pose[:, 1:2]
    cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    u_x, u_y = directions
    enter, leave, along = [], [], []
    for m_x, m_y, size in ((cos, sin, plate.length), (-sin, cos, plate.thickness)):  # the two faces along m are a slab
        m_u, m_c = m_x * u_x + m_y * u_y, m_x * x + m_y * y
        m_u[m_u == 0] = 1e-300
        half = np.copysign(size / 2, m_u)
        enter.append((m_c - half) / m_u)
        leave.append((m_c + half) / m_u)
        along.append(m_u)
    by_second = enter[1] > enter[0]
    r = np.maximum(*enter)
    hit = (r > 0) & (r < np.minimum(*leave))
    slope = np.where(hit, 1 / np.where(by_second, along[1], along[0]), 0.0)
    ahead, aside = np.where(by_second, -sin, cos), np.where(by_second, cos, sin)  # m; m' is (-aside, ahead)
    jacobian = np.empty((*slope.shape, 3))
    np.multiply(ahead, slope, out=jacobian[..., 0])
    np.multiply(aside, slope, out=jacobian[..., 1])
    lever = -aside * (x - r * u_x) + ahead * (y - r * u_y)
    np.multiply(np.where(hit, lever, 0.0), slope, out=jacobian[..., 2])
    return jacobian


def _edge_jacobian(pose: Array, plate: Plate, bearings: Array) -> Array:
    """Derivatives (S, 2, 3) of the edges' bearings over their standard deviation; zero outside the field of view."""
    sight = np.arctan2(pose[:, 1], pose[:, 0])
    seen = View.of(plate, pose).silhouette(np.exp(1j * sight))
    field = bearings[-1] - bearings[0]
    off = np.angle(np.exp(1j * (sight[:, None] + seen[0].T - (bearings[0] + bearings[-1]) / 2)))
    weight = np.where(np.abs(off) < field / 2, np.sqrt(12) / (field / (len(bearings) - 1)), 0.0)
    return seen[1:].T @ in_axes(pose[:, 2]) * weight[..., None]
