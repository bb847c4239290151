"""Posterior means and covariances where the likelihood is not normal: plates seen nearly edge-on or from the side.

Nearly edge-on, the position is fitted at each heading of a grid. A few beams that graze the long face determine the
heading much more precisely than the spacing of the grid, so a peak may fall between grid points or its width may be
overstated. The heading is therefore released at the lowest points of the grid, and a finer grid is placed around each
peak that is reached.

From the side, one or two beams may hit the short face. Such a beam determines the position along the plate precisely;
if the plate slides until the beam hits the long face instead, the beam says nothing about it. The posterior along the
plate is thus a narrow peak, or half of one, on the wide plateau that the silhouette's edges allow, and the curvature at
the maximum describes neither. Where the curvature claims more accuracy than the edges allow, the posterior along the
plate is summed over a grid instead.

Where beams may be lost, neither edge is normally distributed about its mean: see `ends`. The posterior along the plate
is then summed for every scan. Nearly edge-on, it is the sideways place of the plate, and with it the heading, that the
edges determine, so that the posterior is first summed sideways at each heading.
"""

from __future__ import annotations

import math

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import Beams
from trackslip.localization.bound import viewing_angle
from trackslip.localization.climb import Evaluation, covariances
from trackslip.localization.ends import Ends
from trackslip.localization.fixed_heading import FixedHeading, TurnedBeams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.line import fit_line
from trackslip.localization.plate_axis import PlateAxis
from trackslip.localization.quadrature import moments, quadrature
from trackslip.localization.scan import Cluster, Scan
from trackslip.localization.starts import chunks

_EDGE_ON = np.radians(3.0)  # from the line of sight; at smaller angles the posterior is integrated over the heading
_GRID = np.radians(np.linspace(-8.0, 8.0, 49))  # headings, relative to the line of sight
_WIDE_GRID = np.radians(np.linspace(-13.0, 13.0, 79))
_STEP = _GRID[1] - _GRID[0]
_EDGE_ON_BY_FEW = 5, np.radians(5.0), _GRID  # with at most so many returns, the second instead of _EDGE_ON applies
_EDGE_ON_BY_FEW_LEFT = 8, np.radians(8.0), _WIDE_GRID  # where beams may be lost
_FROM_SIDE = np.radians(45.0)  # from the line of sight; at larger angles few beams hit the short face
_PEAKS = 3  # resolved by a finer grid, at most
_ABOUT_PEAK = np.linspace(-4.0, 4.0, 13)  # headings about a peak [its standard deviations]
_ITERATIONS = 6
_HOPELESS = 40.0  # excess of the cost above which a heading has no probability
_UNLIKELY = 12.0  # the same for the position fitted to each heading, when lost beams have yet to be counted
_TRUSTED = 3.0  # the cost of a rough fit falls by less than so many times the promise of the next step
_CLAIMED = 0.9  # a fit is doubted below this fraction of the standard deviation that the edges allow
_ALONG_PLATEAU = np.linspace(-3.0, 3.0, 21)  # along the plate [standard deviations that an edge allows]
_ALONG_PEAK = np.linspace(-4.0, 4.0, 12)  # along the plate [standard deviations of the fit]


def correct(
    likelihood: PlateLikelihood,
    scan: Scan,
    cluster: Cluster,
    beams: Beams,
    pose: Array,
    covariance: Array,
    fits: np.ndarray,
) -> None:
    """Correct, in place, those poses (S, 3) and covariances (S, 3, 3) of clusters that `fits` (S,) selects."""
    off = viewing_angle(pose)
    few, by_few, grid = _EDGE_ON_BY_FEW_LEFT if scan.dropout > 0 else _EDGE_ON_BY_FEW
    edge_on = fits & (off < np.where(cluster.count > few, _EDGE_ON, by_few))
    for rows in chunks(cluster, len(grid), edge_on) if np.count_nonzero(edge_on) else ():
        sight = np.arctan2(pose[rows, 1], pose[rows, 0])
        pose[rows], covariance[rows] = _over_heading(likelihood, scan, cluster.take(rows), sight[:, None] + grid)
    (rows,) = (fits if scan.dropout > 0 else fits & (off > _FROM_SIDE)).nonzero()
    if rows.size and scan.dropout > 0:
        some = beams.take(rows)
        ends = Ends.of(scan, cluster.take(rows), some)
        pose[rows], covariance[rows], _ = _between(likelihood, ends, some, pose[rows], covariance[rows])
    elif rows.size:
        _along_plate(likelihood, beams, pose, covariance, rows)


def _over_heading(likelihood: PlateLikelihood, scan: Scan, cluster: Cluster, grid: Array) -> tuple[Array, Array]:
    """Posterior means (S, 3) and covariances (S, 3, 3) for plates with headings in the range of `grid` (S, K)."""
    beams, middle, scans = Beams.of(scan, cluster), fit_line(cluster).middle, len(grid)
    coarse = _given(likelihood, beams, middle, grid)
    fine = _given(likelihood, beams, middle, _peaks(likelihood, beams, coarse, scans))
    pose = np.concatenate([fit.pose.reshape(scans, -1, 3) for fit in (coarse, fine)], axis=1)
    cost = np.concatenate([fit.cost.reshape(scans, -1) for fit in (coarse, fine)], axis=1)
    within = np.concatenate(
        [covariances(fit.in_lrf_frame()).reshape(scans, -1, 3, 3) for fit in (coarse, fine)], axis=1
    )
    if scan.dropout > 0:
        likely = np.nonzero(cost < cost.min(axis=1, keepdims=True) + _UNLIKELY)
        ends, some = Ends.of(scan, cluster, beams).take(likely[0]), beams.take(likely[0])
        cost[...] = np.inf
        pose[likely], within[likely], cost[likely] = _between(
            likelihood, ends, some, pose[likely], within[likely], sideways=True
        )
    weight, width = quadrature(pose[..., 2], cost)
    mean = np.sum(weight[..., None] * pose, axis=1)
    away = pose - mean[:, None]
    within[..., 2, 2] = width**2 / 12  # a fixed heading has no hessian
    total = within + away[..., :, None] * away[..., None, :]
    return mean, np.sum(np.where(weight[..., None, None] > 1e-9, weight[..., None, None] * total, 0.0), axis=1)


def _along_plate(likelihood: PlateLikelihood, beams: Beams, pose: Array, covariance: Array, rows: np.ndarray) -> None:
    """Correct poses (S, 3) and covariances (S, 3, 3) along the plate where the fit claims more than the edges.

    This is done in place, for the scans `rows` (R,) only.
    """
    at = pose[rows]
    axis = PlateAxis.of(at, covariance[rows])
    weight = beams.edges.weight[rows].min(axis=1)
    x, y = at[:, 0], at[:, 1]
    across = np.abs(axis.e[:, 0] * y - axis.e[:, 1] * x)
    edge = (x * x + y * y) / np.maximum(weight * across, 1e-9)
    (doubted,) = ((axis.sigma < _CLAIMED / math.sqrt(2) * edge) & (weight > 0)).nonzero()
    if doubted.size == 0:
        return
    if doubted.size < len(rows):
        rows, at, edge, axis = rows[doubted], at[doubted], edge[doubted], axis.take(doubted)
    some = beams if rows.size == len(pose) else beams.take(rows)
    offset = np.concatenate([edge[:, None] * _ALONG_PLATEAU, axis.sigma[:, None] * _ALONG_PEAK], axis=1)  # (N, K)
    share, span = quadrature(offset, likelihood.cost_along(some, at, offset))
    mean, variance = moments(offset, share, span)
    pose[rows] = at + mean[:, None] * axis.e
    covariance[rows] += axis.change(variance)


def _between(
    likelihood: PlateLikelihood, ends: Ends, beams: Beams, pose: Array, covariance: Array, sideways: bool = False
) -> tuple[Array, Array, Array]:
    """Poses (M, 3) and covariances (M, 3, 3), corrected for lost beams along the plate or sideways, and costs (M,)."""
    axis = PlateAxis.of(pose, covariance, sideways)
    mean, variance, cost = ends.place(likelihood, beams, pose, axis.sigma, sideways)
    return pose + mean[:, None] * axis.e, covariance + axis.change(variance), cost


def _given(likelihood: PlateLikelihood, beams: Beams, middle: Array, heading: Array) -> Evaluation:
    """Fits (S * K,) of the position at headings (S, K); rough ones where the heading has no probability.

    `middle` (S, 2) are points on the plates.
    """
    every = np.repeat(np.arange(len(heading)), heading.shape[1])
    fixed, turned = FixedHeading(likelihood), TurnedBeams.of(beams.take(every), heading.ravel())
    fit = fixed.climb(turned, fixed.touching(turned, middle[every]), 1)
    least = (fit.cost - _TRUSTED * fit.promise()).reshape(heading.shape)
    likely = np.flatnonzero(least < fit.cost.reshape(heading.shape).min(axis=1, keepdims=True) + _HOPELESS)
    fit.put(likely, fixed.climb(turned.take(likely), fit.pose[likely], _ITERATIONS))
    centre = (fit.pose[:, 0] + 1j * fit.pose[:, 1]) * turned.axis
    fit.pose[:, 0], fit.pose[:, 1] = centre.real, centre.imag
    return fit


def _peaks(likelihood: PlateLikelihood, beams: Beams, coarse: Evaluation, scans: int) -> Array:
    """Headings (S, K) around the peaks of the posterior, within a few steps of the coarse grid."""
    cost = coarse.cost.reshape(scans, -1)
    beside = np.pad(cost, ((0, 0), (1, 1)), constant_values=np.inf)
    dip = (cost <= beside[:, :-2]) & (cost <= beside[:, 2:])
    lowest = np.argsort(np.where(dip, cost, np.inf), axis=1, kind="stable")[:, :_PEAKS]
    scan = np.repeat(np.arange(len(cost)), _PEAKS)
    start = coarse.pose.reshape(len(cost), -1, 3)[scan, lowest.ravel()]
    fit = likelihood.climb(beams.take(scan), start, _ITERATIONS)
    sigma = np.sqrt(np.minimum(covariances(fit)[:, 2, 2], _STEP**2))
    return (fit.pose[:, 2, None] + sigma[:, None] * _ABOUT_PEAK).reshape(len(cost), -1)
