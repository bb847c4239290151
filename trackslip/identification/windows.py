"""The estimator: windows of poses, each laid onto the path that the belts drive by a law.

The belts of a drive, integrated by a law, give a path of the sensor. The poses are cut into windows of some seconds,
twice, the second time half a window later. In each window the path is moved and turned so that it fits the poses
best; what is left are residuals, which don't depend on where the robot is in the world. Slip that varies shifts later
windows, but bends none but its own: no state needs to be estimated. The parameters of the law, of the sensor's place
and of the clocks are those with the smallest residuals, in units of their spread, under Cauchy's loss (P. J. Huber
and E. M. Ronchetti, *Robust Statistics*, 2009, ch. 7).

Standard errors come from blocks of driving: a fit without one block, by one step of Newton's method, and the scatter of
these fits (CR3; A. C. Cameron and D. L. Miller, *A Practitioner's Guide to Cluster-Robust Inference*, 2015).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh
from scipy.special import stdtrit

from trackslip.identification.path import DriveModel, SensorPath
from trackslip.identification.preparation import PreparedDrive, Timeline
from trackslip.kinematics import Array, wrap_angle

LENGTHS = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Lengths of windows that are tried, one after the other [s]."""
BLOCK = 10.0
"""Duration of the blocks whose slip is taken to be independent, at least [s]."""
LOSS = 2.0
"""Scale of Cauchy's loss [standard deviations]: 95 % efficient for normal errors at 2.4 (Huber and Ronchetti)."""
FEWEST_BLOCKS = 6
"""Blocks from which an interval can be told."""
_FEWEST_EFFECTIVE = 3.0  # blocks: with fewer, Student's t says nothing of a parameter, as of the sensor's place
_PER_SECOND = 2.0  # poses; where they are rarer, a window has as many as in its length at this rate
_SPREAD = 1.4826  # standard deviation of normal numbers over the median of their absolute values
_LEAST = 1e-6  # spread of residuals: rounding [m, rad]
_TOLERANCE = 0.3  # change of all parameters at which a fit has converged [standard errors, of independent residuals]
_ITERATIONS = 10
_BENDS = 0.2  # of what its weights say: least second derivative of the loss, where a few large residuals make it less
_RELAXED = (
    1.5  # step over that of reweighted least squares, which the loss would shorten: it bends less than its weights
)


@dataclass(frozen=True)
class Data:
    """The poses of drives in a row, what encoders and gyros read, and blocks of driving."""

    drives: tuple[PreparedDrive, ...]
    line: Timeline
    place: np.ndarray  # (K,) measured, x + i y [m]; 0 where not
    heading: Array  # (K,) measured [rad]; 0 where not
    known: np.ndarray  # (2, K) bool: whether positions and headings were measured
    first: np.ndarray  # (D + 1,) first pose of each drive

    @classmethod
    def of(cls, drives: Sequence[PreparedDrive]) -> Data:
        """The drives in a row."""
        pose = np.concatenate([drive.pose for drive in drives])
        known = np.isfinite(pose[:, [0, 2]]).T
        filled = np.nan_to_num(pose)
        first = np.cumsum([0, *(len(drive.time) for drive in drives)])
        place = filled[:, 0] + 1j * filled[:, 1]
        return cls(tuple(drives), Timeline.of(drives), place, filled[:, 2], known, first)

    def span(self, drive: PreparedDrive, length: float) -> float:
        """Duration of the windows of a drive [s]: longer than `length` where poses are rare."""
        return length * max(1.0, _PER_SECOND * drive.interval)

    def blocks(self, length: float) -> np.ndarray:
        """Index (K,) of the block of driving that each pose is in: no shorter than windows of this length [s].

        Neighbouring drives under the same command are one block.
        """
        blocks, count = [], 0
        for k, drive in enumerate(self.drives):
            time = drive.time - drive.time[0]
            parts = max(1, round(time[-1] / max(BLOCK, self.span(drive, length))))
            if k and parts == 1 and drive.command is not None and drive.command == self.drives[k - 1].command:
                count -= 1
            blocks.append(count + np.minimum((time / max(time[-1], 1e-9) * parts).astype(int), parts - 1))
            count = int(blocks[-1][-1]) + 1
        return np.concatenate(blocks)


@dataclass(frozen=True)
class Windows:
    """Windows of the poses of drives in a row. A row is a pose in a window: most poses are in several."""

    pose: np.ndarray  # (R,) index of the pose
    first: np.ndarray  # (W,) first row of each window
    of: np.ndarray  # (R,) index of the window

    @classmethod
    def cut(cls, data: Data, length: float, twice: bool = True) -> Windows:
        """Windows of about this length [s]; the pose at a border belongs to both sides.

        Cut `twice`, the second time half a window later, they are as efficient as an estimate of the whole path.
        """
        rows = []
        for drive, begin in zip(data.drives, data.first, strict=False):
            time = drive.time
            span = data.span(drive, length)
            for start in (time[0], time[0] + span / 2) if twice else time[:1]:
                cuts = np.searchsorted(time, np.arange(start, time[-1], span))
                ends = np.unique([0, *cuts, len(time) - 1])
                if start > time[0] and len(ends) < 4:
                    break  # the same poses once more
                rows += [begin + np.arange(a, b + 1) for a, b in pairwise(ends)]
        counts = [len(row) for row in rows]
        first = np.cumsum([0, *counts[:-1]])
        return cls(np.concatenate(rows), first, np.repeat(np.arange(len(counts)), counts))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (..., W) over the windows of values (..., R)."""
        return np.add.reduceat(values, self.first, axis=-1)


@dataclass(frozen=True)
class Residuals:
    """What the windows leave: of places ahead and to the left [m], of headings, and of a gyro's turns [rad]."""

    value: Array  # (4, R)
    slope: Array  # (4, f, R) by the free parameters
    known: np.ndarray  # (4, R) bool

    @property
    def spread(self) -> Array:
        """Robust standard deviations (3,) of a coordinate, a heading and a gyro's turn; 1 where there are none."""
        spread = np.ones(3)
        for k, rows in enumerate(([0, 1], [2], [3])):
            size = np.abs(self.value[rows][self.known[rows]])
            if len(size):
                spread[k] = max(_SPREAD * float(np.median(size)), _LEAST)
        return spread

    def weights(self, spread: Array) -> Array:
        """Weights (4, R) under Cauchy's loss, over the variances; 0 where nothing was measured."""
        scale = spread[[0, 0, 1, 2], None]
        return np.where(self.known, 1 / (1 + (self.value / scale / LOSS) ** 2), 0.0) / scale**2

    def bend(self, spread: Array, weight: Array) -> Array:
        """Second derivatives (4, R) of the loss by the residuals, from their weights: negative where they are large."""
        square = (self.value / spread[[0, 0, 1, 2], None] / LOSS) ** 2
        return weight * (1 - square) / (1 + square)

    def alignment(self, spread: Array) -> Array:
        """Weights (2, R) of places and headings in the alignment of their windows, where wrong ones count less."""
        place = (np.hypot(*self.value[:2]) / spread[0] / LOSS) ** 2
        heading = (self.value[2] / spread[1] / LOSS) ** 2
        robust = 1 / (1 + np.stack([place, heading]))
        return np.where(self.known[[0, 2]], robust, 0.0) / spread[:2, None] ** 2


def residuals(
    model: DriveModel, data: Data, windows: Windows, values: Array, free: np.ndarray, weight: Array
) -> Residuals:
    """Residuals of the rows with parameter values (p,), and derivatives by those `free` (f,).

    `weight` (2, R) is that of places and headings in the alignment of their windows.
    """
    path = model.path(values, data.line, free)
    rows = windows.pose
    z, h = data.place[rows], data.heading[rows]
    c, dc = path.place[rows], path.place_slope[:, rows]
    phi, dphi = path.heading[rows], path.heading_slope[:, rows]
    of, (wp, wh) = windows.of, weight
    total = np.maximum(windows.sums(wp), 1e-300)
    u = z - (windows.sums(wp * z) / total)[of]
    c = c - (windows.sums(wp * c) / total)[of]
    dc = dc - (windows.sums(wp * dc) / total)[:, of]
    toward = wp * np.conj(c) * u
    off = wh * np.exp(1j * (h - phi))
    q = windows.sums(toward + off)
    dq = windows.sums(wp * np.conj(dc) * u - 1j * off * dphi)
    size = np.maximum(np.abs(q) ** 2, 1e-300)
    theta, dtheta = np.angle(q), (np.conj(q) * dq).imag / size
    back = np.exp(-1j * (path.heading[rows] + theta[of]))  # into the robot's frame
    turn = np.exp(1j * theta)[of]
    left = (u - turn * c) * back
    dleft = -turn * (dc + 1j * c * dtheta[:, of]) * back  # the frame's own turn is of second order
    value = np.stack([left.real, left.imag, wrap_angle(h - phi - theta[of]), np.zeros(len(rows))])
    slope = np.stack([dleft.real, dleft.imag, -dphi - dtheta[:, of], np.zeros_like(dphi)])
    known = np.stack([*data.known[[0, 0, 1]][:, rows], np.zeros(len(rows), bool)])
    if model.gyro:
        value[3], slope[3], known[3] = _gyro_residuals(model, data, windows, values, free, path)
    return Residuals(value, slope, known)


def _gyro_residuals(
    model: DriveModel, data: Data, windows: Windows, values: Array, free: np.ndarray, path: SensorPath
) -> tuple[Array, Array, np.ndarray]:
    """Turns by the gyro less those by the law, from the row before in the window.

    Both are read by the encoders' clock, so that they tell nothing of the poses': their slope by it is 0.
    """
    rows = windows.pose
    before = np.concatenate([rows[:1], rows[:-1]])
    before[windows.first] = rows[windows.first]
    reading, slope, known = model.gyro_turns(values, data.line, free)
    turned = reading[rows] - reading[before]
    by_law = path.heading[rows] - path.heading[before]
    scale = 1 + values[model.index("gyro_scale")]
    by_slope = slope[:, rows] - slope[:, before] - scale * (path.heading_slope[:, rows] - path.heading_slope[:, before])
    by_slope[free == model.index("gyro_scale")] -= by_law
    by_slope[free == model.index("clock_offset")] = 0.0
    measured = (known[rows] - known[before]) > 0
    return turned - scale * by_law, by_slope, measured


@dataclass(frozen=True)
class WindowFit:
    """Parameters fitted to drives."""

    model: DriveModel
    data: Data
    length: float
    """Of the windows [s]."""
    values: Array  # (p,) of all parameters
    free: np.ndarray  # (f,) indices of those that were fitted
    spread: Array  # (3,) of the residuals
    block: np.ndarray  # (K,) of each pose, as `Data.blocks` gives it
    normal: Array  # (G, f, f) normal equations of each block, by the weights
    bend: Array  # (f, f) second derivatives of the loss
    score: Array  # (G, f) of each block, by which the other ones are balanced
    prior: Array  # (f,) precisions

    def without(self, blocks: np.ndarray) -> Array:
        """Parameters (F, p) without the blocks of (F, G) bool, by one step of Newton's method.

        The normal equations of the weights, which stay regular, say what the rest of the driving tells; the step is as
        much longer as the loss bends less than they do.
        """
        out = blocks.astype(float)
        rest = self._normal - np.einsum("fg,gab->fab", out, self.normal)
        scale = np.maximum(np.sqrt(np.einsum("faa->fa", rest)), 1e-100)
        inverse = np.linalg.pinv(rest / scale[:, :, None] / scale[:, None, :], hermitian=True)
        step = np.einsum("fab,fb->fa", inverse, out @ self.score / scale) / scale
        values = np.tile(self.values, (len(out), 1))
        values[:, self.free] += step @ (self._inverse @ self._normal).T
        low, high, _ = self.model.limits
        return np.clip(values, low, high)

    @property
    def covariance(self) -> Array:
        """(f, f) of the free parameters: by leaving out blocks (CR3), and of the priors; NaN for few blocks."""
        count, free = len(self.score), self.free
        if count < FEWEST_BLOCKS:
            return np.full((len(free), len(free)), np.nan)
        apart = (self.without(np.eye(count, dtype=bool)) - self.values)[:, free]
        inverse = self._inverse
        return (count - 1) / count * apart.T @ apart + inverse @ (self.prior[:, None] * inverse)

    @property
    def quantile(self) -> Array:
        """Half widths (f,) of 95 % intervals over the standard errors."""
        return student(self.normal, self._normal)

    @property
    def _normal(self) -> Array:
        return self.normal.sum(axis=0) + np.diag(self.prior)

    @property
    def _inverse(self) -> Array:
        """Inverse (f, f) of the second derivatives of the loss, which are at least a fifth of what the weights say."""
        scale = np.sqrt(np.diag(self._normal))
        normal, bend = (matrix / np.outer(scale, scale) for matrix in (self._normal, self.bend + np.diag(self.prior)))
        values, axes = eigh(bend, normal + 1e-12 * np.eye(len(scale)))
        return (axes / np.maximum(values, _BENDS)) @ axes.T / np.outer(scale, scale)


def student(blocks: Array, normal: Array) -> Array:
    """Student's t (f,) for 95 % intervals of f parameters, by the normal equations (G, f, f) of blocks and in all.

    A parameter that few blocks determine has few degrees of freedom: one less than the effective number of blocks, by
    their shares of its information (G. W. Imbens and M. Kolesár, *Robust Standard Errors in Small Samples*, 2016).
    """
    inverse = np.linalg.inv(normal)
    share = np.einsum("ab,gbc,ca->ga", inverse, blocks, inverse)
    effective = share.sum(axis=0) ** 2 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    return np.asarray(stdtrit(np.maximum(effective, _FEWEST_EFFECTIVE) - 1, 0.975))


def fit_windows(
    model: DriveModel,
    data: Data,
    length: float,
    values: Array,
    free: np.ndarray,
    mean: Array,
    spread: Array | None = None,
) -> WindowFit:
    """Fit the parameters `free` (f,) to windows of a length [s].

    It begins at `values` (p,) and the `spread` (3,) of residuals there, which it estimates again;
    `mean` (p,) is that of the priors.
    """
    windows, values = Windows.cut(data, length), values.copy()
    low, high, _ = model.limits[:, free]
    prior = 1 / model.prior[free] ** 2
    weight = data.known[:, windows.pose].astype(float)
    if spread is None:
        spread = residuals(model, data, windows, values, free, weight).spread
    weight /= spread[:2, None] ** 2
    for _ in range(_ITERATIONS):
        found = residuals(model, data, windows, values, free, weight)
        pull = found.weights(spread)
        hessian = np.einsum("kfr,kr,kgr->fg", found.slope, pull, found.slope, optimize=True) + np.diag(prior)
        gradient = np.einsum("kfr,kr->f", found.slope, pull * found.value) + prior * (values - mean)[free]
        moved = np.clip(values[free] - _RELAXED * np.linalg.solve(hessian, gradient), low, high)
        change = np.abs(moved - values[free]) * np.sqrt(np.diag(hessian))
        values[free] = moved
        if (change < _TOLERANCE).all():
            break
    weight, spread = found.alignment(spread), found.spread
    found = residuals(model, data, windows, values, free, weight)
    block = data.blocks(2 * length)  # where windows that overlap share little
    middle = (windows.first + np.append(windows.first[1:], len(windows.pose)) - 1) // 2
    pull = found.weights(spread)
    normal, score = _by_block(found, pull, block[windows.pose[middle]][windows.of])
    curved = found.bend(spread, pull)
    bend = np.einsum("kfr,kr,kgr->fg", found.slope, curved, found.slope, optimize=True)
    return WindowFit(model, data, length, values, free, spread, block, normal, bend, score, prior)


def _by_block(found: Residuals, pull: Array, block: np.ndarray) -> tuple[Array, Array]:
    """Normal equations (G, f, f) and scores (G, f) of the rows in each block (R,), by their weights (4, R)."""
    _, block = np.unique(block, return_inverse=True)
    count, size = int(block.max()) + 1, found.slope.shape[1]
    score, normal = np.zeros((count, size)), np.zeros((count, size, size))
    weighted = found.slope * pull[:, None]
    ends = np.flatnonzero(np.diff(block, prepend=-1, append=-1))
    for begin, end in pairwise(ends.tolist()):  # rows of a block follow each other
        rows, part = weighted[:, :, begin:end], block[begin]
        normal[part] += np.tensordot(rows, found.slope[:, :, begin:end], ([0, 2], [0, 2]))
        score[part] += np.tensordot(rows, found.value[:, begin:end], ([0, 2], [0, 1]))
    return normal, score
