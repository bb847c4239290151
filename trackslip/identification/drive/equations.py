"""Residuals of poses and steps, and their normal equations: block-tridiagonal in the trajectory, bordered by
parameters.

Unknown are the state of every node, the sensor's position and the robot's heading (x, y, phi), and the parameters. The
lower Cholesky factor of the trajectory's part has five bands, so that a solution takes a time linear in the nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.errors import LogError
from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.model import DriveModel
from trackslip.identification.drive.reckoning import quarter, rotated
from trackslip.kinematics import Array, wrap_angle

_MIN_DISTANCE = 1e-3  # of a step, so that a robot at rest isn't known to stay exactly [m]

_HOPELESS = "the poses can't be reconciled with the sprocket speeds: check units, clocks and wild readings"
_MIN_INFORMATION = 1e-3  # of a state, for nodes that no pose and no step ties [1/m^2, 1/rad^2]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the five kinds of residuals."""

    values: Array
    """(5,): position [m] and heading [rad] of poses; slip forwards, sideways [m/sqrt(m)] and in turn [rad/sqrt(m)]."""

    NAMES = ("position", "heading", "slip_forward", "slip_sideways", "slip_turn")


@dataclass(frozen=True)
class Nodes:
    """Nodes of all drives in a row, and which of their measurements and steps count."""

    drives: tuple[Drive, ...]
    pose: Array  # (K, 3) measured, NaN where not
    weight: Array  # (K, 2) of positions and headings: 1, or 0 for what isn't measured or is left out
    link: Array  # (K - 1,) of steps: 1, or 0 between drives and where poses jump lastingly

    @classmethod
    def of(cls, drives: Sequence[Drive]) -> Nodes:
        """All measurements of the drives."""
        pose = np.concatenate([drive.pose for drive in drives])
        weight = np.isfinite(pose[:, [0, 2]]).astype(float)
        link = np.ones(len(pose) - 1)
        link[np.cumsum([len(drive.time) for drive in drives])[:-1] - 1] = 0.0
        return cls(tuple(drives), pose, weight, link)

    @property
    def time(self) -> Array:
        """Times (K,) of the nodes [s]."""
        return np.concatenate([drive.time for drive in self.drives])

    @property
    def first(self) -> np.ndarray:
        """Index of the first node of each drive, and the number of nodes."""
        return np.cumsum([0, *(len(drive.time) for drive in self.drives)])


@dataclass(frozen=True)
class Residuals:
    """Residuals at a trajectory and parameters, and the derivatives of those of steps."""

    pose: Array  # (K, 3) of positions and headings, 0 where not measured
    step: Array  # (K - 1, 3) in the frame of the first node [m, m, rad]
    by_first: Array  # (K - 1, 3, 3) derivatives of step by the state of the first node
    by_second: Array  # (K - 1, 3, 3) by that of the second
    by_values: Array  # (K - 1, 3, p) by the parameters
    distance: Array  # (K - 1,) [m]

    def squares(self, nodes: Nodes) -> list[Array]:
        """Squares of the residuals of each kind of Noise, per unit variance, with their weights applied."""
        position, heading = nodes.weight.T
        scaled = self.step**2 * (nodes.link / self.distance)[:, None]
        return [
            np.concatenate([position * self.pose[:, 0] ** 2, position * self.pose[:, 1] ** 2]),
            heading * self.pose[:, 2] ** 2,
            *scaled.T,
        ]


def residuals(model: DriveModel, nodes: Nodes, states: Array, values: Array) -> Residuals:
    """Residuals at states (K, 3) and parameter values (p,)."""
    motion, slope, distance = _reckoned(model, nodes, values)
    x, y, yaw = (model.index(name) for name in ("sensor_x", "sensor_y", "sensor_yaw"))
    lever = values[[x, y]]
    measured = np.where(np.isfinite(nodes.pose), nodes.pose, 0.0)
    pose = states - measured
    pose[:, 2] = wrap_angle(pose[:, 2] + values[yaw])
    pose *= nodes.weight[:, [0, 0, 1]] > 0
    heading = states[:-1, 2]
    turn = np.diff(states[:, 2])
    moved = rotated(-heading, np.diff(states[:, :2], axis=0))
    swung = rotated(turn, np.broadcast_to(lever, moved.shape))
    step = np.column_stack([moved - (swung - lever) - motion[:, :2], wrap_angle(turn - motion[:, 2])])
    count = len(step)
    cos, sin = np.cos(heading), np.sin(heading)
    by_second = np.zeros((count, 3, 3))
    by_second[:, 0, 0], by_second[:, 0, 1] = cos, sin
    by_second[:, 1, 0], by_second[:, 1, 1] = -sin, cos
    by_first = -by_second
    by_second[:, :2, 2] = -quarter(swung, 1)
    by_first[:, :2, 2] = quarter(swung, 1) - quarter(moved, 1)
    by_second[:, 2, 2], by_first[:, 2, 2] = 1.0, -1.0
    by_values = -slope
    by_values[:, 0, x], by_values[:, 1, x] = 1 - np.cos(turn), -np.sin(turn)
    by_values[:, 0, y], by_values[:, 1, y] = np.sin(turn), 1 - np.cos(turn)
    return Residuals(pose, step, by_first, by_second, by_values, distance)


@dataclass(frozen=True)
class Solution:
    """A solved step of Gauss and Newton."""

    states: Array  # (K, 3) change of the states
    values: Array  # (f,) change of the free parameters
    information: Array  # (f, f) of the free parameters, the trajectory eliminated
    gradient: Array  # (K, f) of half the cost by the free parameters, of each node's pose and the step that leads to it
    factor: Array  # (6, 3 K) lower bands of the Cholesky factor L of the trajectory's Hessian
    reduced: Array  # (K, 3, f + 1) L^-1 times the border and the trajectory's gradient


def weights(found: Residuals, nodes: Nodes, noise: Noise) -> tuple[Array, Array]:
    """Reciprocal variances (K, 3) of poses and (K - 1, 3) of steps."""
    position, heading, *slips = noise.values
    poses = nodes.weight[:, [0, 0, 1]] / np.array([position, position, heading]) ** 2
    steps = (nodes.link / found.distance)[:, None] / np.array(slips) ** 2
    return poses, steps


def cost(found: Residuals, nodes: Nodes, noise: Noise) -> float:
    """Weighted sum of squares."""
    poses, steps = weights(found, nodes, noise)
    return float(np.sum(poses * found.pose**2) + np.sum(steps * found.step**2))


def solve(
    found: Residuals, nodes: Nodes, noise: Noise, free: np.ndarray, yaw: int, prior: Array, pull: Array
) -> Solution:
    """The step of Gauss and Newton for the states and the parameters `free` (f,).

    `prior` (p,) are standard deviations, `pull` (p,) how far the values lie from the priors' means; `yaw` is the index
    of the sensor's yaw, the only parameter that poses depend on.
    """
    poses, steps = weights(found, nodes, noise)
    bands, border = _hessian(found, poses, steps, free, yaw)
    gradient = poses * found.pose
    first, second = found.by_first, found.by_second
    weighted = steps * found.step
    gradient[:-1] += np.einsum("kai,ka->ki", first, weighted)
    gradient[1:] += np.einsum("kai,ka->ki", second, weighted)
    slope = found.by_values[..., free]
    corner = np.einsum("kai,ka,kaj->ij", slope, steps, slope, optimize=True) + np.diag(1 / prior[free] ** 2)
    score = np.zeros((len(poses), len(free)))
    score[1:] = np.einsum("kai,ka->ki", slope, weighted)
    at = np.flatnonzero(free == yaw)
    corner[at, at] += poses[:, 2].sum()
    score[:, at] += (poses[:, 2] * found.pose[:, 2])[:, None]
    factor, reduced = _eliminated(bands, np.column_stack([border, gradient.reshape(-1)]))
    f = len(free)
    information = corner - reduced[:, :f].T @ reduced[:, :f]
    right = score.sum(axis=0) - reduced[:, :f].T @ reduced[:, f]
    right = right + pull[free] / prior[free] ** 2
    try:
        values = -_solved(information, right) if f else np.zeros(0)
    except np.linalg.LinAlgError as error:
        raise LogError(_HOPELESS) from error
    if not np.isfinite(values).all():
        raise LogError(_HOPELESS)
    rest = -(reduced[:, f] + reduced[:, :f] @ values)
    states, _ = scipy.linalg.lapack.dtbtrs(factor, rest[:, None], uplo="L", trans="T")
    return Solution(states.reshape(-1, 3), values, information, score, factor, reduced.reshape(-1, 3, f + 1))


def _solved(information: Array, right: Array) -> Array:
    """The solution of positive definite equations; raises LinAlgError where they aren't, by rounding."""
    factor = scipy.linalg.cho_factor(information, check_finite=False)
    return np.asarray(scipy.linalg.cho_solve(factor, right, check_finite=False))


def log_determinant(found: Residuals, nodes: Nodes, noise: Noise, free: np.ndarray, yaw: int, prior: Array) -> float:
    """Logarithm of the determinant of the whole Hessian."""
    poses, steps = weights(found, nodes, noise)
    bands, border = _hessian(found, poses, steps, free, yaw)
    slope = found.by_values[..., free]
    corner = np.einsum("kai,ka,kaj->ij", slope, steps, slope, optimize=True) + np.diag(1 / prior[free] ** 2)
    at = np.flatnonzero(free == yaw)
    corner[at, at] += poses[:, 2].sum()
    factor, reduced = _eliminated(bands, border)
    return float(2 * np.log(factor[0]).sum() + np.linalg.slogdet(corner - reduced.T @ reduced)[1])


def _reckoned(model: DriveModel, nodes: Nodes, values: Array) -> tuple[Array, Array, Array]:
    """Motion, slope and distance of all steps, zero between drives."""
    count = len(nodes.pose) - 1
    motion, slope, distance = np.zeros((count, 3)), np.zeros((count, 3, len(values))), np.ones(count)
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        rows = slice(begin, begin + len(drive.time) - 1)
        steps = model.steps(values, drive)
        motion[rows], slope[rows], distance[rows] = steps.motion, steps.slope, steps.distance
    return motion, slope, np.maximum(distance, _MIN_DISTANCE)


def _hessian(found: Residuals, poses: Array, steps: Array, free: np.ndarray, yaw: int) -> tuple[Array, Array]:
    """Lower bands (6, 3 K) of the trajectory's part, and the border (3 K, f)."""
    count, f = len(poses), len(free)
    first, second, slope = found.by_first, found.by_second, found.by_values[..., free]
    first_t, second_t = ((block * steps[..., None]).swapaxes(1, 2) for block in (first, second))
    diagonal = np.zeros((count, 3, 3))
    diagonal[:, [0, 1, 2], [0, 1, 2]] = poses + _MIN_INFORMATION
    diagonal[:-1] += first_t @ first
    diagonal[1:] += second_t @ second
    below = second_t @ first  # (K - 1, 3, 3)
    bands = np.zeros((6, count, 3))
    for a in range(3):
        for b in range(3):
            if a >= b:
                bands[a - b, :, b] = diagonal[:, a, b]
            bands[3 + a - b, :-1, b] = below[:, a, b]
    border = np.zeros((count, 3, f))
    border[:-1] += first_t @ slope
    border[1:] += second_t @ slope
    border[:, 2, free == yaw] += poses[:, 2:]
    return bands.reshape(6, -1), border.reshape(3 * count, f)


def _eliminated(bands: Array, right: Array) -> tuple[Array, Array]:
    """The lower Cholesky factor L (6, n) of a banded matrix, and L^-1 `right` (n, m)."""
    factor, info = scipy.linalg.lapack.dpbtrf(bands, lower=1)
    if info:
        raise LogError(_HOPELESS)
    if right.size:  # LAPACK may crash without
        right, _ = scipy.linalg.lapack.dtbtrs(factor, right, uplo="L")
    return factor, right
