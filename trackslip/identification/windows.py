"""The estimator: fits the path that follows from belt speeds and a law to the poses, window by
window.

Belt speeds, integrated according to a law, yield the sensor's path. The poses are cut into windows
of a few seconds. In each window, the path is moved and turned to fit the poses best. The remaining
residuals don't depend on where the robot is in the world. Varying slip affects only the windows in
which it occurs, so no state needs to be estimated. The parameters (of the law, the sensor's
mounting and the clocks) minimise Cauchy's loss of the residuals in units of their spread (P. J.
Huber and E. M. Ronchetti, *Robust Statistics*, 2009, ch. 7).

Standard errors come from the scatter of fits that each leave out one block of driving, approximated
by one Newton step (CR3; A. C. Cameron and D. L. Miller, *A Practitioner's Guide to Cluster-Robust
Inference*, 2015).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.linalg import eigh

from trackslip.drives.drive import Drives
from trackslip.identification.path import DriveModel, Path
from trackslip.intervals import cr3, newton_steps, student
from trackslip.kinematics import Array, wrap_angle

LOSS: Final = 2.0
"""Scale of Cauchy's loss [standard deviations]: 95 % efficient for normal errors at 2.4 (Huber and
Ronchetti).
"""
# least second derivative of the loss relative to the weights; large residuals would lower it
# further
_BENDS: Final = 0.2
# factor on the first steps: those of reweighted least squares are too short for this loss
_RELAXED: Final = 1.5
_NEAR: Final = 30.0  # change below which the next step is Newton's [standard errors]


@dataclass(frozen=True)
class Windows:
    """Windows of poses. A row is one pose in one window, as most poses lie in several windows."""

    pose: np.ndarray  # (R,) index of the pose
    count: np.ndarray  # (W,) number of rows in each window

    @classmethod
    def cut(cls, drives: Drives, length: float) -> Windows:
        """Cut drives into windows of about `length` [s]; a pose on a border belongs to both
        windows.

        Each drive is cut twice, the second time half a window later, which is as efficient as a fit
        of the whole path.
        """
        rows = []
        for drive, begin in zip(drives.drives, drives.first, strict=False):
            time, span = drive.time, drive.span(length)
            for start in (time[0], time[0] + span / 2):
                cuts = np.searchsorted(time, np.arange(start, time[-1], span))
                ends = np.unique([0, *cuts, len(time) - 1])
                if start > time[0] and len(ends) < 4:
                    break  # the window would contain the same poses again
                rows += [begin + np.arange(a, b + 1) for a, b in pairwise(ends)]
        return cls(np.concatenate(rows), np.array([len(row) for row in rows]))

    @cached_property
    def first(self) -> np.ndarray:
        """First rows (W,) of the windows."""
        return np.cumsum(self.count) - self.count

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (..., W) of values (..., R) over each window."""
        return np.add.reduceat(values, self.first, axis=-1)

    def each(self, values: np.ndarray) -> np.ndarray:
        """Repeat values (..., W) of windows for each of their rows (..., R)."""
        return np.repeat(values, self.count, axis=-1)


@dataclass(frozen=True)
class Residuals:
    """Residuals per row: position forwards and to the left [m], heading and, with a gyro, turn
    [rad].
    """

    value: Array  # (3 or 4, R) residuals
    slope: Array  # (3 or 4, f, R) derivatives of the residuals by the free parameters
    known: np.ndarray  # (3 or 4, R) bool: true where measured

    @property
    def spread(self) -> Array:
        """Robust standard deviations (3,) of coordinates, headings and gyro turns; 1 for a quantity
        not measured.
        """
        spread = np.ones(3)
        for k, rows in enumerate((slice(2), slice(2, 3), slice(3, 4))):
            size = np.abs(self.value[rows][self.known[rows]])
            if len(size):
                # for normal errors, but no less than rounding
                spread[k] = max(1.4826 * float(np.median(size)), 1e-6)
        return spread

    def weights(self, spread: Array) -> tuple[Array, Array]:
        """Weights (3 or 4, R) under Cauchy's loss, divided by the variances, and second derivatives
        of the loss.

        Weights and derivatives are 0 where nothing was measured. Derivatives are negative for large
        residuals.
        """
        variance = spread[[0, 0, 1, 2][: len(self.value)], None] ** 2
        square = self.value**2 / (variance * LOSS**2)
        weight = self.known / (variance * (1 + square))
        return weight, weight * (1 - square) / (1 + square)

    def alignment(self, spread: Array) -> Array:
        """Weights (2, R) of places and headings for the alignment of windows; outliers weigh
        less.
        """
        size = np.stack([np.hypot(*self.value[:2]), self.value[2]]) / spread[:2, None]
        return self.known[[0, 2]] / (1 + (size / LOSS) ** 2) / spread[:2, None] ** 2

    def normal(self, weight: Array, rows: slice = slice(None)) -> Array:
        """Normal equations (f, f) over `rows`, given the weights (3 or 4, R) of all rows."""
        weighted = self.slope[..., rows] * weight[:, None, rows]
        return np.asarray(
            sum(w @ s.T for w, s in zip(weighted, self.slope[..., rows], strict=True))
        )

    def score(self, weight: Array, rows: slice = slice(None)) -> Array:
        """Gradient (f,) of half the weighted sum of squares over `rows`, given the weights (3 or 4,
        R) of all rows.
        """
        pull = weight[:, rows] * self.value[:, rows]
        return np.asarray(sum(s @ p for s, p in zip(self.slope[..., rows], pull, strict=True)))


def residuals(
    model: DriveModel,
    drives: Drives,
    windows: Windows,
    values: Array,
    free: np.ndarray,
    weight: Array,
) -> Residuals:
    """Residuals of the rows for parameter values (p,), with derivatives by the parameters `free`
    (f,).

    `weight` (2, R) has the weights of places and headings for the alignment of windows.
    """
    path = model.path(values, drives, free)
    rows, (wp, wh) = windows.pose, weight
    z, h = drives.place[rows], drives.heading[rows]
    c, phi, dc, dphi = (
        np.take(part, rows, axis=-1)
        for part in (path.place, path.heading, path.place_slope, path.heading_slope)
    )
    total = np.maximum(windows.sums(wp), 1e-300)
    u = z - windows.each(windows.sums(wp * z) / total)
    c = c - windows.each(windows.sums(wp * c) / total)
    off = wh * np.exp(1j * (h - phi))
    q = windows.sums(wp * np.conj(c) * u + off)
    theta = np.angle(q)
    turned = phi + windows.each(theta)
    back = np.exp(-1j * phi)  # into the robot's frame
    left = u * np.exp(-1j * turned) - c * back
    value = np.stack([left.real, left.imag, wrap_angle(h - turned)])
    # derivatives of the alignment, from d angle(q) = Im(dq conj(q)) / |q|², then of the residuals,
    # to first order
    per_turn = windows.each(np.conj(q) / np.maximum(np.abs(q) ** 2, 1e-300))
    by_place, by_turn = wp * u * per_turn, (off * per_turn).real
    dtheta = windows.each(
        windows.sums(by_place.imag * dc.real - by_place.real * dc.imag - by_turn * dphi)
    )
    middle = windows.each(windows.sums(wp * dc) / total)
    dleft = (middle - dc - (1j * c) * dtheta) * back
    slope = np.stack([dleft.real, dleft.imag, -dphi - dtheta])
    known = drives.known[[0, 0, 1]][:, rows]
    if not model.gyro:
        return Residuals(value, slope, known)
    of_gyro = _gyro_residuals(model, drives, windows, values, free, path)
    return Residuals(
        *(
            np.append(a, b[None], axis=0)
            for a, b in zip((value, slope, known), of_gyro, strict=True)
        )
    )


def _gyro_residuals(
    model: DriveModel, drives: Drives, windows: Windows, values: Array, free: np.ndarray, path: Path
) -> tuple[Array, Array, np.ndarray]:
    """Turns by the gyro minus turns by the law since the previous row, their derivatives, and a
    mask of known values.

    Both turns are timed by the encoder clock, so the derivative by the clock offset is 0.
    """
    rows = windows.pose
    before = np.concatenate([rows[:1], rows[:-1]])
    before[windows.first] = rows[windows.first]
    reading, slope, known = model.gyro_turns(values, drives, free)
    turned = reading[rows] - reading[before]
    by_law = path.heading[rows] - path.heading[before]
    scale = 1 + values[model.index("gyro_scale")]
    by_slope = (
        slope[:, rows]
        - slope[:, before]
        - scale * (path.heading_slope[:, rows] - path.heading_slope[:, before])
    )
    by_slope[free == model.index("gyro_scale")] -= by_law
    by_slope[free == model.index("clock_offset")] = 0.0
    return turned - scale * by_law, by_slope, known[rows] > known[before]


@dataclass(frozen=True)
class WindowFit:
    """The parameters of a drive model fitted to drives, with their uncertainty."""

    model: DriveModel
    drives: Drives
    length: float  # length of the windows [s]
    values: Array  # (p,) values of all parameters
    free: np.ndarray  # (f,) indices of the parameters that were fitted
    spread: Array  # (3,) `Residuals.spread`
    block: np.ndarray  # (K,) block of each pose, from `Drives.blocks`
    blocks: Array  # (G, f, f) normal equations of each block, weighted
    bend: Array  # (f, f) second derivatives of the loss
    score: Array  # (G, f) gradient from each block; the sum, with the prior's gradient, is about 0
    prior: Array  # (f,) precisions of the priors

    def without(self, blocks: np.ndarray) -> Array:
        """Parameters (F, p) without the blocks in each row of `blocks` (F, G) bool, by one Newton
        step from the fit.

        The step uses the weighted normal equations of the remaining blocks, which stay regular. It
        is then lengthened by the ratio of all blocks' normal equations to the second derivatives of
        the loss.
        """
        out = blocks.astype(float)
        rest = self._normal - np.einsum("fg,gab->fab", out, self.blocks)
        step = newton_steps(rest, out @ self.score)
        values = np.tile(self.values, (len(out), 1))
        values[:, self.free] += step @ (self.inverse @ self._normal).T
        low, high, _ = self.model.limits
        return np.clip(values, low, high)

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the free parameters: CR3 over blocks, plus the priors' share; NaN
        for too few blocks.
        """
        apart = (self.without(np.eye(len(self.score), dtype=bool)) - self.values)[:, self.free]
        return cr3(apart) + self.inverse @ (self.prior[:, None] * self.inverse)

    @property
    def quantile(self) -> Array:
        """Half-widths (f,) of 95 % intervals, in standard errors."""
        return student(self.blocks, self._normal)

    @property
    def _normal(self) -> Array:
        return self.blocks.sum(axis=0) + np.diag(self.prior)

    @cached_property
    def inverse(self) -> Array:
        """Covariance (f, f) of the free parameters, if residuals were independent."""
        return _inverse(self.bend + np.diag(self.prior), self._normal)


def _inverse(bend: Array, normal: Array) -> Array:
    """Inverse (f, f) of the loss's second derivatives, which are raised to at least a fifth of the
    normal equations.
    """
    scale = np.sqrt(np.diag(normal))
    normal, bend = (matrix / np.outer(scale, scale) for matrix in (normal, bend))
    values, axes = eigh(bend, normal + 1e-12 * np.eye(len(scale)))
    return np.asarray((axes / np.maximum(values, _BENDS)) @ axes.T / np.outer(scale, scale))


def fit_windows(
    model: DriveModel,
    drives: Drives,
    length: float,
    values: Array,
    held: Collection[str],
    mean: Array,
) -> WindowFit:
    """Fit all parameters except `held` in windows of `length` [s], from start `values` (p,), with
    prior `mean` (p,).

    The first steps are by reweighted least squares, the last by Newton's method. The fit has
    converged when no parameter changes by more than a tenth of its standard error (for independent
    residuals, given all other parameters). Derivatives are recomputed after changes of more than
    three standard errors.
    """
    windows, values = Windows.cut(drives, length), values.copy()
    free = np.array([k for k, name in enumerate(model.names) if name not in held], int)
    low, high, _ = model.limits[:, free]
    prior = 1 / model.prior[free] ** 2
    known = drives.known[:, windows.pose].astype(float)
    rest = residuals(model, drives, windows, values, free, known)
    change = np.inf
    for _ in range(50):
        spread = rest.spread
        pull, curved = rest.weights(spread)
        normal = rest.normal(pull) + np.diag(prior)
        gradient = rest.score(pull) + prior * (values - mean)[free]
        if change < _NEAR:
            step = _inverse(rest.normal(curved) + np.diag(prior), normal) @ gradient
        else:
            step = _RELAXED * np.linalg.solve(normal, gradient)
        moved = np.clip(values[free] - step, low, high)
        change = np.max(np.abs(moved - values[free]) * np.sqrt(np.diag(normal)), initial=0.0)
        values[free] = moved
        if change < 0.1:
            break
        slopes = free if change > 3.0 else free[:0]
        later = residuals(model, drives, windows, values, slopes, known / spread[:2, None] ** 2)
        rest = later if len(slopes) else replace(later, slope=rest.slope)
    rest = residuals(model, drives, windows, values, free, rest.alignment(rest.spread))
    spread = rest.spread
    pull, curved = rest.weights(spread)
    block = drives.blocks(2 * length)  # long enough that few windows overlap two blocks
    middle = windows.pose[windows.first + (windows.count - 1) // 2]
    part = windows.each(np.unique(block[middle], return_inverse=True)[1])
    blocks = np.zeros((int(part.max()) + 1, len(free), len(free)))
    score = np.zeros(blocks.shape[:2])
    ends = np.flatnonzero(np.diff(part, prepend=-1, append=-1)).tolist()
    for begin, end in pairwise(ends):  # most rows of a block are consecutive
        blocks[part[begin]] += rest.normal(pull, slice(begin, end))
        score[part[begin]] += rest.score(pull, slice(begin, end))
    return WindowFit(
        model,
        drives,
        length,
        values,
        free,
        spread,
        block,
        blocks,
        rest.normal(curved),
        score,
        prior,
    )
