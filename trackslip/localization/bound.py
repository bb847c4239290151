r"""How accurately one scan determines a pose: the Cramér-Rao bound of the ray model and the silhouette's edges.

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

If a beam that hits returns nothing with probability p, only the returns count. Beyond the last of them, the number of
lost beams is geometrically distributed with mean p / (1 - p), which shifts the corner, and variance p / (1 - p)^2,
which is added to the 1 / 12 of each edge. Where it is known which beams returned, this is not good enough along the
plate, for two reasons. Few returns mean many lost beams, so that the variance given the returns is another than the
variance over all scans: the length of the plate tells how many are missing at both ends together. And a geometric
variable is far from normal: an estimator with the variance above does not exist. What does exist is the posterior mean.
If all places a along the plate are equally probable beforehand, its mean square error is the least of all estimators:

    E[(a^ - a)^2]  >=  E[Var(a | returns)]  >=  E[Var(a | returns, heading, place across)],

with equality in the first place for the posterior mean; more knowledge makes the mean variance no larger. The last of
these variances is that of a density over one variable, which is summed (see `ends`), and takes the place of what the
information above gives along the plate. It depends on the returns of the scan, and bounds the mean over many scans.

This is not a true Cramer-Rao bound. A uniform error has no Fisher information in the usual sense because its support
moves with the pose. Many such edges, treated as intervals, contain more information than their squares, although for
two edges at a known distance the middle of the intersection is the mean of the middles and has the same mean square
error. Nor does the bound apply where the ranges are not smooth functions of the pose: within a few degrees of
edge-on, where the face that a beam meets determines the heading. If the returns are all from the short face, it is the
number of lost beams that determines the heading, up to a reflection about the line of sight: a posterior with two peaks
has no bound of this kind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import Beams
from trackslip.localization.ends import Ends
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.plate_axis import PlateAxis
from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.localization.view import View, in_axes

MIN_ANGLE = np.radians(3.0)
"""The bound means little at smaller angles from edge-on [rad]."""
_NORMAL = 1e9  # the loss of a normally distributed range is never linear [standard deviations]
_FLAT = 1e-6  # derivative of a range with respect to the place along the plate; of one on the short face it is over 1
_AT_ONCE = 250  # poses, so that they stay in the cache


def pose_bound(
    pose: Array, plate: Plate, bearings: Array, noise: float, dropout: float = 0.0, seen: Cluster | None = None
) -> Array:
    """Covariances (S, 3, 3) of (x, y, phi) that no unbiased estimator from one scan beats; NaN if undetermined.

    Args:
        pose: true poses (S, 3) of the plate in the LRF's frame [m, m, rad].
        plate: the plate in the scan.
        bearings: of the beams (B,), equally spaced, ascending [rad].
        noise: standard deviation of a range [m].
        dropout: probability that a beam that hits returns nothing [-].
        seen: the returns (S,), which tell more than their expected share where few beams matter; without any from the
            long face, the pose is undetermined. By default all beams return something, or 1 - dropout of each.
    """
    information = np.zeros((len(pose), 3, 3))
    directions = directed(bearings)
    told = np.ones(len(pose), bool)
    for start in range(0, len(pose), _AT_ONCE):
        some = pose[start : start + _AT_ONCE]
        if seen is None:
            aimed = directions.take(towards(some, plate, bearings), axis=1)
            jacobian = np.sqrt(1 - dropout) * range_jacobian(some, plate, aimed)
        else:
            part = slice(start, start + _AT_ONCE)
            jacobian = seen.hit[part, :, None] * range_jacobian(some, plate, directed(seen.bearing[part]))
            told[part] = _on_long_face(jacobian, some[:, 2]).any(axis=1)
        jacobian /= noise
        edges = _edge_jacobian(some, plate, bearings) / np.sqrt(1 + 12 * dropout / (1 - dropout) ** 2)
        information[start : start + _AT_ONCE] = jacobian.swapaxes(1, 2) @ jacobian + edges.swapaxes(1, 2) @ edges
    covariance = np.full_like(information, np.nan)
    held = (np.linalg.matrix_rank(information, hermitian=True) == 3) & told
    covariance[held] = np.linalg.inv(information[held])
    if seen is not None and dropout > 0:
        scan = Scan(bearings, np.empty((0, len(bearings))), noise, np.zeros(3), dropout=dropout)
        known = np.flatnonzero(held)
        for rows in np.split(known, range(_AT_ONCE, len(known), _AT_ONCE)):
            covariance[rows] += _lost_ends(pose[rows], covariance[rows], plate, scan, seen.take(rows))
    return covariance


def viewing_angle(pose: Array) -> Array:
    """Angles between plates at poses (S, 3) in the LRF's frame and the line of sight: 0 edge-on, pi/2 broadside."""
    off = pose[:, 2] - np.arctan2(pose[:, 1], pose[:, 0])
    return np.abs((off + np.pi / 2) % np.pi - np.pi / 2)


def ratio_to_bound(error: Array, bound: Array) -> Array:
    """Ratios (3,) of the root mean square errors of x, y and heading to the root of the mean bound.

    Args:
        error: pose errors (S, 3), those of the heading without half turns.
        bound: covariances (S, 3, 3) in the same frame as the errors.
    """
    return np.sqrt(np.mean(error**2, axis=0) / np.mean(np.einsum("sii->si", bound), axis=0))


def scan_ratio_to_bound(pose: Array, true_pose: Array, plate: Plate, scan: Scan, seen: Cluster | None = None) -> Array:
    """Ratios (3,) to the bound of x, y and heading in the world; of which scans, and arguments, see `beside_bound`."""
    return ratio_to_bound(*beside_bound(pose, true_pose, plate, scan, seen))


def beside_bound(
    pose: Array, true_pose: Array, plate: Plate, scan: Scan, seen: Cluster | None = None
) -> tuple[Array, Array]:
    """Errors (R, 3) in the world and their bounds (R, 3, 3), of the R scans seen MIN_ANGLE or more from edge-on.

    Scans that don't determine the pose are left out.

    Args:
        pose: estimated poses (S, 3) in the world, for example those that are valid.
        true_pose: the true ones (S, 3).
        plate: the plate in the scan.
        scan: its bearings, noise, dropout and mount are used, not its ranges.
        seen: the returns (S,); see `pose_bound`.
    """
    local = scan.from_world(true_pose)
    rows = viewing_angle(local) > MIN_ANGLE
    error = (pose - true_pose)[rows]
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    returns = None if seen is None else seen.take(np.flatnonzero(rows))
    bound = pose_bound(local[rows], plate, scan.bearings, scan.noise, scan.dropout, returns)
    bound = scan.covariance_to_world(bound)
    held = np.isfinite(bound).all(axis=(1, 2))
    return error[held], bound[held]


def _on_long_face(jacobian: Array, heading: Array) -> np.ndarray:
    """Which ranges with derivatives (S, W, 3) do not change as plates with `heading` (S,) slide along themselves."""
    along = jacobian[..., 0] * np.cos(heading)[:, None] + jacobian[..., 1] * np.sin(heading)[:, None]
    return (np.abs(along) < _FLAT) & (jacobian != 0).any(axis=2)


def _lost_ends(pose: Array, covariance: Array, plate: Plate, scan: Scan, seen: Cluster) -> Array:
    """What lost beams change (S, 3, 3) of the covariances along the plates at the true poses, given the returns."""
    beams = replace(Beams.of(scan, seen), noise=scan.noise)
    axis = PlateAxis.of(pose, covariance)
    _, variance, _ = Ends.of(scan, seen, beams).place(PlateLikelihood(plate, _NORMAL), beams, pose, axis.sigma)
    return axis.change(variance)


def towards(pose: Array, plate: Plate, bearings: Array) -> np.ndarray:
    """Which of the bearings (B,) can meet the plates at poses (S, 3), equally many for all of them: (S, W)."""
    distance, sight = np.hypot(pose[:, 0], pose[:, 1]), np.arctan2(pose[:, 1], pose[:, 0])
    radius = np.hypot(plate.length, plate.thickness) / 2
    spread = np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0))
    step = (bearings[-1] - bearings[0]) / (len(bearings) - 1)
    count = min(int(np.ceil(2 * spread.max() / step)) + 2, len(bearings))
    if np.any(np.abs(sight) + spread > np.pi):  # behind the LRF, where bearings jump
        count = len(bearings)
    first = np.floor((sight - spread - bearings[0]) / step).astype(int)
    return np.clip(first, 0, len(bearings) - count)[:, None] + np.arange(count)


def directed(bearings: Array) -> Array:
    """Directions (2, ...) of beams with bearings (...)."""
    return np.array([np.cos(bearings), np.sin(bearings)])


def range_jacobian(pose: Array, plate: Plate, directions: Array) -> Array:
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
