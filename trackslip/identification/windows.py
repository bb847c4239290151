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

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.linalg import eigh
from scipy.special import fdtri, stdtrit

from trackslip.drives.drive import Drives
from trackslip.identification.path import DriveModel, Path
from trackslip.intervals import (
    DEVIATION_PER_MEDIAN,
    FEWEST_BLOCKS,
    cr3,
    mean_of_groups,
    newton_steps,
    student,
)
from trackslip.kinematics import Array, wrap_angle
from trackslip.viewable import ShortRepr

LOSS: Final = 2.0
"""Scale of Cauchy's loss [standard deviations]: 95 % efficient for normal errors at 2.4 (Huber and
Ronchetti).
"""
# least second derivative of the loss relative to the weights; large residuals would lower it
# further
_LEAST_CURVATURE: Final = 0.2
# factor on the first steps: those of reweighted least squares are too short for this loss
_RELAXATION: Final = 1.5
_NEAR: Final = 30.0  # change below which the next step is Newton's [standard errors]
_FAR: Final = 3.0  # change above which derivatives are computed anew [standard errors]
_CONVERGED: Final = 0.1  # change at convergence [standard errors]
_ITERATIONS: Final = 50
# spread of positions and headings that the first alignment assumes [m, rad]
_FIRST_SPREAD: Final = 0.02
# least information on the turn of a window, for a standard deviation of a third of a rad: the poses
# of a window that hardly moves don't tell how it is turned, so that its residuals say nothing of
# the law (test_windows) [1/rad²]
_LEAST_INFORMATION: Final = 9.0
BEYOND_CHANCE: Final = 0.99
"""Probability by which runs count as different in an F-test."""
_FEWEST_RUNS: Final = 3  # least number of runs whose scatter gives an interval for their mean
_TINY: Final = 1e-300  # instead of 0 in denominators
_LEAST_SPREAD: Final = 1e-6  # rounding errors of a path [m, rad]


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
        poses = list[np.ndarray]()
        for drive, first_pose in zip(drives.drives, drives.first[:-1], strict=True):
            time = drive.time
            span = drive.span(length)
            for start in (time[0], time[0] + span / 2):
                cuts = np.searchsorted(time, np.arange(start, time[-1], span))
                borders = np.unique([0, *cuts, len(time) - 1])
                if start > time[0] and len(borders) < 4:
                    break  # the window would contain the same poses again
                for begin, end in pairwise(borders):
                    poses.append(first_pose + np.arange(begin, end + 1))
        count = np.array([len(of_window) for of_window in poses])
        return cls(np.concatenate(poses), count)

    @cached_property
    def first(self) -> np.ndarray:
        """First rows (W,) of the windows."""
        return np.cumsum(self.count) - self.count

    @property
    def middle(self) -> np.ndarray:
        """Index (W,) of the pose in the middle of each window."""
        return self.pose[self.first + (self.count - 1) // 2]

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (..., W) of values (..., R) over each window."""
        return np.add.reduceat(values, self.first, axis=-1)

    def at_rows(self, values: np.ndarray) -> np.ndarray:
        """Repeat values (..., W) of windows for each of their rows (..., R)."""
        return np.repeat(values, self.count, axis=-1)


@dataclass(frozen=True)
class Residuals:
    """Residuals per row, measured minus predicted: position in the sensor's frame, forwards and to
    the left [m], heading and, with a gyro, turn since the row before [rad].
    """

    value: Array  # (3 or 4, R) residuals
    slope: Array  # (3 or 4, f, R) derivatives of the residuals by the free parameters
    known: np.ndarray  # (3 or 4, R) bool: true where measured, in a window whose turn is known

    @property
    def spread(self) -> Array:
        """Robust standard deviations (3,) of coordinates, headings and gyro turns; 1 for a quantity
        not measured.
        """
        spread = np.ones(3)
        coordinates, headings, turns = slice(0, 2), slice(2, 3), slice(3, 4)
        for quantity, columns in enumerate((coordinates, headings, turns)):
            size = np.abs(self.value[columns][self.known[columns]])
            if len(size):
                of_normal_errors = DEVIATION_PER_MEDIAN * float(np.median(size))
                spread[quantity] = max(of_normal_errors, _LEAST_SPREAD)
        return spread

    def weights(self, spread: Array) -> tuple[Array, Array]:
        """Weights (3 or 4, R) under Cauchy's loss, divided by the variances, and second derivatives
        of the loss.

        Weights and derivatives are 0 where nothing was measured. Derivatives are negative for large
        residuals.
        """
        of_columns = spread[[0, 0, 1, 2][: len(self.value)], None]
        variance = of_columns**2
        square = self.value**2 / (variance * LOSS**2)
        weight = self.known / (variance * (1 + square))
        return weight, weight * (1 - square) / (1 + square)

    def loss(self, spread: Array) -> float:
        """Mean of Cauchy's loss of the residuals and of the logarithm of their spread, so that
        losses with different spreads (3,) can be compared.
        """
        of_columns = spread[[0, 0, 1, 2][: len(self.value)], None]
        square = (self.value / (of_columns * LOSS)) ** 2
        of_rows = 0.5 * LOSS**2 * np.log1p(square) + np.log(of_columns)
        return float(np.sum(of_rows[self.known])) / max(1, int(self.known.sum()))

    def alignment(self, spread: Array) -> Array:
        """Weights (2, R) of places and headings for the alignment of windows; outliers weigh
        less.
        """
        variance = spread[:2, None] ** 2
        distance = np.hypot(*self.value[:2])
        turn = self.value[2]
        square = np.stack([distance, turn]) ** 2 / (variance * LOSS**2)
        return self.known[[0, 2]] / (variance * (1 + square))

    def normal(self, weight: Array, rows: slice = slice(None)) -> Array:
        """Normal equations (f, f) over `rows`, given the weights (3 or 4, R) of all rows."""
        slope = self.slope[..., rows]
        weighted = slope * weight[:, None, rows]
        return np.asarray(sum(w @ s.T for w, s in zip(weighted, slope, strict=True)))

    def score(self, weight: Array, rows: slice = slice(None)) -> Array:
        """Gradient (f,) of half the weighted sum of squares over `rows`, given the weights (3 or 4,
        R) of all rows.
        """
        slope = self.slope[..., rows]
        weighted = weight[:, rows] * self.value[:, rows]
        return np.asarray(sum(s @ w for s, w in zip(slope, weighted, strict=True)))


def residuals(
    model: DriveModel,
    drives: Drives,
    windows: Windows,
    values: Array,
    free: np.ndarray,
    weight: Array,
) -> Residuals:
    """Residuals of the rows for parameter values (p,), with derivatives by the parameters `free`
    (f,), given by their indices.

    `weight` (2, R) has the weights of places and headings for the alignment of windows, about their
    inverse variances.

    **Alignment.** In one window, let z_k be the measured places and c_k those on the path, as
    complex numbers x + i y about their weighted means; h_k and phi_k the measured headings and
    those on the path; a_k and b_k the weights of places and headings. The path is moved so that the
    means coincide, and turned by the angle theta that minimises

        sum_k a_k |z_k - e^(i theta) c_k|² + b_k |e^(i h_k) - e^(i (phi_k + theta))|²

    Expanded, only the products of measured and predicted depend on theta, as -2 Re(e^(-i theta) q)
    with the complex sum

        q = sum_k a_k conj(c_k) z_k + b_k e^(i (h_k - phi_k))

    The minimum is where e^(-i theta) q is real and positive: theta = angle(q). There, half the
    second derivative of the sum by theta is |q|.

    **Residuals**, in the frame of the sensor, whose heading on the turned path is phi_k + theta:

        p_k = (z_k - e^(i theta) c_k) e^(-i (phi_k + theta))        place, forwards + i leftwards
        r_k = h_k - phi_k - theta                                   heading

    **Derivatives.** A parameter that changes c_k by dc_k and phi_k by dphi_k changes the sum by

        dq = sum_k a_k conj(dc_k) z_k - i b_k e^(i (h_k - phi_k)) dphi_k

    and the angle of q by dtheta = Im(dq conj(q)) / |q|². The residuals then change by

        dp_k = -(dc_k + i c_k dtheta) e^(-i phi_k)
        dr_k = -dphi_k - dtheta

    The turn of the sensor's frame would change p_k by a product of p_k with dphi_k + dtheta. It is
    left out, as it vanishes with the residuals and doesn't change their size.

    **Windows that hardly move.** Without headings, the turn of a window in which the robot stands
    is unknown: c_k is about 0, and q is noise. Its residuals would have derivatives of any size.
    The variance of theta is 1 / I with I = sum_k a_k |c_k|². Windows without headings and with less
    information I than _LEAST_INFORMATION count as not measured.
    """
    path = model.path(values, drives, free)
    rows = windows.pose
    place_weight, heading_weight = weight

    # measured and predicted places about their weighted means, and headings
    total = np.maximum(windows.sums(place_weight), _TINY)

    def weighted_means(of_rows: np.ndarray) -> np.ndarray:
        """Means (..., R) over the window of each row."""
        return windows.at_rows(windows.sums(place_weight * of_rows) / total)

    measured = drives.place[rows]
    measured = measured - weighted_means(measured)  # z
    predicted = path.place[rows]
    predicted = predicted - weighted_means(predicted)  # c
    measured_heading = drives.heading[rows]  # h
    heading = path.heading[rows]  # phi

    # alignment of each window
    of_headings = heading_weight * np.exp(1j * (measured_heading - heading))
    q = windows.sums(place_weight * np.conj(predicted) * measured + of_headings)
    turned_heading = heading + windows.at_rows(np.angle(q))  # phi + theta
    information = windows.sums(place_weight * np.abs(predicted) ** 2)
    has_headings = windows.sums(heading_weight) > 0
    is_turn_known = windows.at_rows(has_headings | (information >= _LEAST_INFORMATION))

    # residuals
    into_sensor = np.exp(-1j * heading)
    place_residual = measured * np.exp(-1j * turned_heading) - predicted * into_sensor
    heading_residual = wrap_angle(measured_heading - turned_heading)
    value = np.stack([place_residual.real, place_residual.imag, heading_residual])
    is_placed, is_headed = drives.known[:, rows] & is_turn_known
    known = np.stack([is_placed, is_placed, is_headed])

    # derivative of the alignment, dtheta (f, R), where Im(conj(dc) x) = Re dc Im x - Im dc Re x
    place_slope = np.take(path.place_slope, rows, axis=-1)  # dc
    heading_slope = np.take(path.heading_slope, rows, axis=-1)  # dphi
    per_turn = windows.at_rows(np.conj(q) / np.maximum(np.abs(q) ** 2, _TINY))
    by_place = place_weight * measured * per_turn
    by_heading = (of_headings * per_turn).real
    turn_slope = by_place.imag * place_slope.real - by_place.real * place_slope.imag
    turn_slope -= by_heading * heading_slope
    turn_slope = windows.at_rows(windows.sums(turn_slope))

    # derivatives of the residuals
    about_mean = place_slope - weighted_means(place_slope)
    place_residual_slope = -(about_mean + (1j * predicted) * turn_slope) * into_sensor
    heading_residual_slope = -heading_slope - turn_slope
    slope = np.stack([place_residual_slope.real, place_residual_slope.imag, heading_residual_slope])
    found = Residuals(value, slope, known)
    return _with_gyro(found, model, drives, windows, values, free, path) if model.gyro else found


def _with_gyro(
    found: Residuals,
    model: DriveModel,
    drives: Drives,
    windows: Windows,
    values: Array,
    free: np.ndarray,
    path: Path,
) -> Residuals:
    """The residuals `found`, followed by turns by the gyro minus turns by the law since the row
    before.

    A gyro reads (1 + scale) times the yaw rate. Both turns are taken between the same times of the
    encoder clock, which move with the clock offset: the derivative of their difference is about 0.
    """
    # the first row of a window has no row before, but itself, with a turn of 0 that counts as not
    # measured
    rows = windows.pose
    before = np.concatenate([rows[:1], rows[:-1]])
    before[windows.first] = rows[windows.first]
    scale = 1 + values[model.index("gyro_scale")]

    reading, reading_slope, time_read = model.gyro_turns(values, drives, free)
    by_gyro = reading[rows] - reading[before]
    by_law = path.heading[rows] - path.heading[before]
    value = by_gyro - scale * by_law

    by_gyro_slope = reading_slope[:, rows] - reading_slope[:, before]
    by_law_slope = path.heading_slope[:, rows] - path.heading_slope[:, before]
    slope = by_gyro_slope - scale * by_law_slope
    slope[free == model.index("gyro_scale")] -= by_law
    slope[free == model.index("clock_offset")] = 0.0

    is_measured = time_read[rows] > time_read[before]
    return Residuals(
        np.append(found.value, value[None], axis=0),
        np.append(found.slope, slope[None], axis=0),
        np.append(found.known, is_measured[None], axis=0),
    )


@dataclass(frozen=True, repr=False)
class RunValues(ShortRepr):
    """Parameters of each run, from fits to that run alone."""

    names: tuple[str, ...]  # (n,) names of the runs
    values: Array  # (n, l) values of the l free parameters of the law
    variance: Array  # (n, l) variances of their errors, if residuals were independent
    differ: np.ndarray  # (l,) bool: true for parameters that differ between runs beyond chance
    # (n,) values by name of the sensor's parameters, if it sits elsewhere in each run
    sensors: Mapping[str, Array]


@dataclass(frozen=True, repr=False)
class WindowFit(ShortRepr):
    """The parameters of a drive model fitted to drives, with their uncertainty."""

    model: DriveModel
    drives: Drives
    length: float  # length of the windows [s]
    values: Array  # (p,) values of all parameters
    free: np.ndarray  # (f,) indices of the parameters that were fitted
    spread: Array  # (3,) `Residuals.spread`
    block: np.ndarray  # (K,) block of each pose, from 0 to G - 1
    block_normals: Array  # (G, f, f) weighted normal equations of each block
    curvature: Array  # (f, f) second derivatives of the loss
    # (G, f) gradient from each block, of residuals whose windows are aligned with less weight on
    # outliers than in the fit. With the prior's gradient, their sum is 0 without outliers; on
    # examples/logs/warthog_grass.parquet, it is worth up to 0.8 standard errors.
    score: Array
    prior: Array  # (f,) precisions of the priors
    loss: float  # `Residuals.loss`
    # where parameters of the law, or of the sensor, differ between runs
    runs: RunValues | None = None

    def without(self, blocks: np.ndarray) -> Array:
        """Parameters (F, p) without the blocks in each row of `blocks` (F, G) bool, by one Newton
        step from the fit.

        The step uses the weighted normal equations of the remaining blocks, which stay regular. It
        is then lengthened by the ratio of all blocks' normal equations to the second derivatives of
        the loss.
        """
        out = blocks.astype(float)
        rest = self._normal - np.einsum("fg,gab->fab", out, self.block_normals)
        step = newton_steps(rest, out @ self.score)
        values = np.tile(self.values, (len(out), 1))
        values[:, self.free] += step @ (self.inverse @ self._normal).T
        low, high, _ = self.model.limits
        return np.clip(values, low, high)

    @cached_property
    def changes_without_block(self) -> Array:
        """Changes (G, f) of the free parameters without each block."""
        return self._changes_without(np.arange(len(self.score)))

    def _changes_without(self, part: np.ndarray) -> Array:
        """Changes (P, f) of the free parameters without each of P parts, given the `part` (G,) of
        each block.
        """
        is_in_part = part == np.arange(part.max() + 1)[:, None]
        return (self.without(is_in_part) - self.values)[:, self.free]

    @cached_property
    def run_of_block(self) -> np.ndarray:
        """Index (G,) of the run to which each block belongs; a run may consist of several drives.

        A block that drives share belongs to the run of the last of them.
        """
        names = [drive.name for drive in self.drives.drives]
        run_of_drive = np.unique(names, return_inverse=True)[1]
        found = np.zeros(len(self.score), int)
        found[self.block] = run_of_drive[self.drives.drive]
        return np.unique(found, return_inverse=True)[1]

    @property
    def _cluster_of_block(self) -> np.ndarray:
        """Index (G,) of the independent part of the driving to which each block belongs.

        Each run may have a slip of its own. So runs are the independent parts if there are enough
        of them, otherwise the blocks are.
        """
        runs = self.run_of_block
        has_enough_runs = runs.max() + 1 >= FEWEST_BLOCKS
        return runs if has_enough_runs else np.arange(len(self.score))

    @property
    def is_mean_of_runs(self) -> bool:
        """True if the law's values are means of those of the runs: these differ, and their scatter
        is known.

        A robust fit to all runs settles for some of them, and may turn to others if one is left
        out. Neither its values nor their changes then say anything of the mean.
        """
        return self.runs is not None and len(self.runs.names) >= _FEWEST_RUNS

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the free parameters: CR3 over runs or blocks, or from the scatter
        between the values of runs, plus the priors' share; NaN for too few blocks.
        """
        by_prior = self.inverse @ (self.prior[:, None] * self.inverse)
        by_scatter = cr3(self._changes_without(self._cluster_of_block))
        if self.runs is not None and self.is_mean_of_runs:
            _, of_law = mean_of_groups(self.runs.values, self.runs.variance)
            size = len(of_law)
            by_scatter[:size] = 0.0
            by_scatter[:, :size] = 0.0
            by_scatter[:size, :size] = of_law
        return by_scatter + by_prior

    @property
    def quantile(self) -> Array:
        """Half-widths (f,) of 95 % intervals, in standard errors."""
        cluster = self._cluster_of_block
        normal = np.zeros((cluster.max() + 1, *self.curvature.shape))
        np.add.at(normal, cluster, self.block_normals)
        quantile = student(normal, self._normal)
        if self.runs is not None and self.is_mean_of_runs:
            run_count, size = self.runs.values.shape
            quantile[:size] = stdtrit(run_count - 1, 0.975)
        return quantile

    @property
    def differs_between_runs(self) -> np.ndarray:
        """(f,) bool: true for parameters that differ between runs beyond chance (1 %, by an F-test
        of the influences of blocks on them); false for a single run, and where no run has two
        blocks.

        Without a block, a parameter changes by minus the block's influence. If all runs have the
        same value, the influences in a run of k blocks, with a mean m, scatter about 0 as they
        scatter about m, and k m² has the variance of a single one.
        """
        runs = self.run_of_block
        run_count = int(runs.max()) + 1
        block_count = len(self.score)
        if run_count < 2 or block_count < max(FEWEST_BLOCKS, run_count + 1):
            return np.zeros(len(self.free), bool)
        influence = -self.changes_without_block
        blocks = np.bincount(runs)[:, None]
        mean = np.zeros((run_count, len(self.free)))
        np.add.at(mean, runs, influence)
        mean /= blocks
        between = np.sum(blocks * mean**2, axis=0) / (run_count - 1)
        within = np.sum((influence - mean[runs]) ** 2, axis=0) / (block_count - run_count)
        by_chance = fdtri(run_count - 1, block_count - run_count, BEYOND_CHANCE)
        return np.asarray(between > by_chance * within)

    @property
    def _normal(self) -> Array:
        return self.block_normals.sum(axis=0) + np.diag(self.prior)

    @cached_property
    def inverse(self) -> Array:
        """Covariance (f, f) of the free parameters, if residuals were independent."""
        return _inverse(self.curvature + np.diag(self.prior), self._normal)


def _inverse(curvature: Array, normal: Array) -> Array:
    """Inverse (f, f) of the loss's second derivatives, which are raised to at least a fifth of the
    normal equations.
    """
    scale = np.sqrt(np.diag(normal))
    scaling = np.outer(scale, scale)
    regular = normal / scaling + 1e-12 * np.eye(len(scale))
    values, axes = eigh(curvature / scaling, regular)
    inverse = (axes / np.maximum(values, _LEAST_CURVATURE)) @ axes.T
    return np.asarray(inverse / scaling)


def fit_windows(
    model: DriveModel,
    drives: Drives,
    length: float,
    values: Array,
    held: Collection[str],
    mean: Array,
    block_length: float | None = None,
) -> WindowFit:
    """Fit all parameters except `held` in windows of `length` [s], from start `values` (p,), with
    prior `mean` (p,).

    Blocks of driving, whose scatter yields the standard errors, last at least `block_length` [s],
    by default two windows.
    """
    # the parameters that are fitted, and the precisions of their priors
    free = np.array([k for k, name in enumerate(model.names) if name not in held], int)
    prior = 1 / model.prior[free] ** 2

    # the values of least loss, and the residuals there with their weights
    windows = Windows.cut(drives, length)
    values, found = _least_loss(model, drives, windows, values, free, mean)
    spread = found.spread
    weight, curvature_weight = found.weights(spread)

    # the share of each block of driving, long enough that few windows overlap two blocks
    block = drives.blocks(2 * length if block_length is None else block_length)
    block_normals, score = _block_sums(found, weight, windows, block)
    return WindowFit(
        model=model,
        drives=drives,
        length=length,
        values=values,
        free=free,
        spread=spread,
        block=block,
        block_normals=block_normals,
        curvature=found.normal(curvature_weight),
        score=score,
        prior=prior,
        loss=found.loss(spread),
    )


def _least_loss(
    model: DriveModel,
    drives: Drives,
    windows: Windows,
    start: Array,
    free: np.ndarray,
    mean: Array,
) -> tuple[Array, Residuals]:
    """Values (p,) of least loss near `start` (p,), of which those in `free` (f,) change, and the
    residuals there.

    The first steps are by reweighted least squares, the last by Newton's method. The fit has
    converged when no parameter changes by more than a tenth of its standard error (for independent
    residuals, given all other parameters). Derivatives are recomputed after changes of more than
    three standard errors.
    """
    values = start.copy()
    low, high, _ = model.limits[:, free]
    prior = 1 / model.prior[free] ** 2
    known = drives.known[:, windows.pose].astype(float)
    current = residuals(model, drives, windows, values, free, known / _FIRST_SPREAD**2)
    change = np.inf
    for _ in range(_ITERATIONS):
        # a step downhill, within the limits
        spread = current.spread
        weight, curvature_weight = current.weights(spread)
        normal = current.normal(weight) + np.diag(prior)
        gradient = current.score(weight) + prior * (values - mean)[free]
        if change < _NEAR:
            curvature = current.normal(curvature_weight) + np.diag(prior)
            step = _inverse(curvature, normal) @ gradient
        else:
            step = _RELAXATION * np.linalg.solve(normal, gradient)
        moved = np.clip(values[free] - step, low, high)
        change = np.max(np.abs(moved - values[free]) * np.sqrt(np.diag(normal)), initial=0.0)
        values[free] = moved
        if change < _CONVERGED:
            break

        # residuals there; near the minimum, their derivatives hardly change
        slopes = free if change > _FAR else free[:0]
        later = residuals(model, drives, windows, values, slopes, known / spread[:2, None] ** 2)
        current = later if len(slopes) else replace(later, slope=current.slope)
    return values, residuals(
        model, drives, windows, values, free, current.alignment(current.spread)
    )


def _block_sums(
    found: Residuals, weight: Array, windows: Windows, block: np.ndarray
) -> tuple[Array, Array]:
    """Normal equations (G, f, f) and gradients (G, f) of blocks, from the `block` (K,) of each
    pose.

    A window belongs to the block of its middle. A block without windows, as at the edge of a gap in
    the driving, has zeros.
    """
    block_of_row = windows.at_rows(block[windows.middle])
    count = int(block.max()) + 1
    size = found.slope.shape[1]
    normal = np.zeros((count, size, size))
    score = np.zeros((count, size))
    borders = np.flatnonzero(np.diff(block_of_row, prepend=-1, append=-1)).tolist()
    for begin, end in pairwise(borders):  # most rows of a block are consecutive
        rows = slice(begin, end)
        normal[block_of_row[begin]] += found.normal(weight, rows)
        score[block_of_row[begin]] += found.score(weight, rows)
    return normal, score
