"""Posterior means and covariances where the likelihood is not normal: plates seen nearly edge-on or from the side.

Nearly edge-on, the position is fitted at each heading of a grid. A few beams that graze the long face determine the
heading much more precisely than the spacing of the grid, so a peak may fall between grid points or its width may be
overstated. The heading is therefore released at the lowest points of the grid, and a finer grid is placed around each
peak that is reached. Without this, the curvature at the maximum understates the heading's standard error three to six
times at less than 2 degrees from edge-on.

From the side, one or two beams may hit the short face. Such a beam determines the position along the plate precisely;
if the plate slides until the beam hits the long face instead, the beam says nothing about it. The posterior along the
plate is thus a narrow peak, or half of one, on the wide plateau that the silhouette's edges allow, and the curvature at
the maximum describes neither. Where the curvature claims more accuracy than the edges allow, the posterior along the
plate is summed over a grid instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import PlateBeams
from trackslip.localization.bound import viewing_angle
from trackslip.localization.gauss_newton import Evaluation, climb, covariances
from trackslip.localization.initial_poses import chunks, place
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.line import fit_line
from trackslip.localization.scan import Cluster, Scan

_EDGE_ON = np.radians(3.0)  # from the line of sight; at smaller angles the posterior is integrated over the heading
_FEW, _EDGE_ON_BY_FEW = 5, np.radians(5.0)  # with at most so many returns, at these angles, too
_GRID = np.radians(np.linspace(-8.0, 8.0, 49))  # headings, relative to the line of sight
_STEP = _GRID[1] - _GRID[0]
_FROM_SIDE = np.radians(45.0)  # from the line of sight; at larger angles few beams hit the short face
_PEAKS = 3  # resolved by a finer grid, at most
_ABOUT_PEAK = np.linspace(-4.0, 4.0, 13)  # headings about a peak [its standard deviations]
_ITERATIONS = 6
_HOPELESS = 40.0  # excess of the cost above which a heading has no probability
_TRUSTED = 3.0  # the cost of a rough fit falls by less than so many times the promise of the next step
_CLAIMED = 0.9 / math.sqrt(2)  # share of the error that an edge allows, below which a fit is doubted
_ALONG_PLATEAU = np.linspace(-3.0, 3.0, 21)  # along the plate [standard deviations that an edge allows]
_ALONG_PEAK = np.linspace(-4.0, 4.0, 12)  # along the plate [standard deviations of the fit]


def correct(
    likelihood: PlateLikelihood,
    scan: Scan,
    cluster: Cluster,
    beams: PlateBeams,
    pose: Array,
    covariance: Array,
    fits: np.ndarray,
) -> None:
    """Correct, in place, those poses (S, 3) and covariances (S, 3, 3) of clusters that `fits` (S,) selects."""
    off = viewing_angle(pose)
    edge_on = fits & (off < np.where(cluster.count > _FEW, _EDGE_ON, _EDGE_ON_BY_FEW))
    for rows in chunks(cluster, len(_GRID), edge_on) if np.count_nonzero(edge_on) else ():
        sight = np.arctan2(pose[rows, 1], pose[rows, 0])
        pose[rows], covariance[rows] = _over_heading(likelihood, scan, cluster.take(rows), sight[:, None] + _GRID)
    (rows,) = (fits & (off > _FROM_SIDE)).nonzero()
    if rows.size:
        _along_plate(likelihood, beams, pose, covariance, rows)


@dataclass(frozen=True)
class FixedHeading:
    """The likelihood as a function of the position alone."""

    likelihood: PlateLikelihood

    def evaluate(self, beams: PlateBeams, pose: Array) -> Evaluation:
        """Cost and derivatives at poses (M, 3), whose headings stay as they are."""
        here = self.likelihood.evaluate(beams, pose)
        here.gradient[:, 2] = 0.0
        here.curvature[2:5] = np.array([1.0, 0.0, 0.0])[:, None]  # a fixed heading has no curvature, zz, yz and xz
        return here

    def moved(self, here: Evaluation, step: Array) -> Array:
        """Poses (M, 3) after steps (M, 3) from `here` along and across the plates."""
        return self.likelihood.moved(here, step)


def _over_heading(likelihood: PlateLikelihood, scan: Scan, cluster: Cluster, grid: Array) -> tuple[Array, Array]:
    """Posterior means (S, 3) and covariances (S, 3, 3) for plates with headings in the range of `grid` (S, K)."""
    beams = PlateBeams.of(scan, cluster)
    coarse = _given(likelihood, cluster, beams, grid)
    fine = _given(likelihood, cluster, beams, _peaks(likelihood, beams, coarse, len(grid)))
    pose = np.concatenate([fit.pose.reshape(len(grid), -1, 3) for fit in (coarse, fine)], axis=1)
    cost = np.concatenate([fit.cost.reshape(len(grid), -1) for fit in (coarse, fine)], axis=1)
    within = [covariances(fit.in_lrf_frame()).reshape(len(grid), -1, 3, 3) for fit in (coarse, fine)]
    weight, width = _quadrature(pose[..., 2], cost)
    mean = np.sum(weight[..., None] * pose, axis=1)
    away = pose - mean[:, None]
    total = np.concatenate(within, axis=1)
    total[..., 2, 2] = width**2 / 12
    total += away[..., :, None] * away[..., None, :]
    return mean, np.sum(np.where(weight[..., None, None] > 1e-9, weight[..., None, None] * total, 0.0), axis=1)


def _given(likelihood: PlateLikelihood, cluster: Cluster, beams: PlateBeams, heading: Array) -> Evaluation:
    """Fits (S * K,) of the position at headings (S, K); rough ones where the heading has no probability."""
    every, fixed = np.repeat(np.arange(len(heading)), heading.shape[1]), FixedHeading(likelihood)
    repeated, middle = beams.take(every), fit_line(cluster).middle[every]
    start = place(cluster.take(every), heading.ravel(), middle, likelihood.plate)
    fit = climb(fixed, repeated, start, 1)
    least = (fit.cost - _TRUSTED * fit.promise()).reshape(heading.shape)
    likely = np.flatnonzero(least < fit.cost.reshape(heading.shape).min(axis=1, keepdims=True) + _HOPELESS)
    fit.put(likely, climb(fixed, repeated.take(likely), fit.pose[likely], _ITERATIONS))
    return fit


def _peaks(likelihood: PlateLikelihood, beams: PlateBeams, coarse: Evaluation, scans: int) -> Array:
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


def _along_plate(
    likelihood: PlateLikelihood, beams: PlateBeams, pose: Array, covariance: Array, rows: np.ndarray
) -> None:
    """Correct poses (S, 3) and covariances (S, 3, 3) along the plate where the fit claims more than the edges.

    This is done in place, for the scans `rows` (R,) only.
    """
    x, y, heading = pose[rows].T
    axis = np.stack([np.cos(heading), np.sin(heading), np.zeros(len(rows))], axis=-1)  # a unit along the plate
    leaning = np.einsum("mij,mj->mi", covariance[rows], axis)
    sigma = np.sqrt(np.maximum((leaning * axis).sum(axis=1), 1e-12))  # of the place along the plate
    weight = beams.edges.weight[rows].min(axis=1)
    edge = (x * x + y * y) / np.maximum(weight * np.abs(axis[:, 0] * y - axis[:, 1] * x), 1e-9)
    (doubted,) = ((sigma < _CLAIMED * edge) & (weight > 0)).nonzero()
    if doubted.size == 0:
        return
    rows, axis, leaning, sigma, edge = (one[doubted] for one in (rows, axis, leaning, sigma, edge))
    offset = np.concatenate([edge[:, None] * _ALONG_PLATEAU, sigma[:, None] * _ALONG_PEAK], axis=1)  # (R, K)
    cost = likelihood.cost_along(beams.take(rows), pose[rows], offset)
    share, width = _quadrature(offset, cost)
    mean = (share * offset).sum(axis=1)
    variance = (share * ((offset - mean[:, None]) ** 2 + width**2 / 12)).sum(axis=1)
    pose[rows] += mean[:, None] * axis
    # the place along the plate becomes independent of the rest, which keeps the covariance that it has given it
    covariance[rows] += variance[:, None, None] * axis[:, :, None] * axis[:, None, :]
    covariance[rows] -= leaning[:, :, None] * leaning[:, None, :] / (sigma**2)[:, None, None]


def _quadrature(points: Array, cost: Array) -> tuple[Array, Array]:
    """Probabilities (S, K) of points (S, K), in any order, and their widths (S, K) in the trapezoidal rule.

    `cost` (S, K) are the negative log likelihoods.
    """
    rows, order = np.arange(len(points))[:, None], np.argsort(points, axis=1, kind="stable")
    ordered = points[rows, order]
    share = np.empty_like(ordered)
    share[:, 1:-1] = (ordered[:, 2:] - ordered[:, :-2]) / 2
    share[:, 0], share[:, -1] = (ordered[:, 1] - ordered[:, 0]) / 2, (ordered[:, -1] - ordered[:, -2]) / 2
    width = np.empty_like(share)
    width[rows, order] = share
    weight = np.exp(cost.min(axis=1, keepdims=True) - cost) * width
    return weight / weight.sum(axis=1, keepdims=True), width
