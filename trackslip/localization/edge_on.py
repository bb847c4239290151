"""Plates seen nearly edge-on: the likelihood of the heading is not normal, so the posterior is integrated over it.

The position is fitted at each heading of a grid; pose and covariance are those of the posterior. A few beams that graze
the long face determine the heading much more precisely than the spacing of the grid, so a peak may fall between grid
points or its width may be overstated. The heading is therefore released at the lowest points of the grid, and a finer
grid is placed around each peak that is reached.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.climb import climb
from trackslip.localization.likelihood import Beams, Evaluation, PlateLikelihood, inverses
from trackslip.localization.line import fit_line
from trackslip.localization.quadrature import spans, weights
from trackslip.localization.scan import Cluster, Scan
from trackslip.localization.solution import UNKNOWN
from trackslip.localization.starts import place

EDGE_ON = np.radians(3.0)
"""At smaller angles from the line of sight, the posterior is integrated over the heading [rad]."""
FEW = 5
"""With at most this many returns, EDGE_ON_BY_FEW applies instead."""
EDGE_ON_BY_FEW = np.radians(5.0)
"""EDGE_ON for clusters of few returns [rad]."""
GRID = np.radians(np.linspace(-8.0, 8.0, 49))
"""Headings of the grid, relative to the line of sight [rad]."""
_STEP = GRID[1] - GRID[0]
_PEAKS = 3  # resolved by a finer grid, at most
_PEAK = np.linspace(-4.0, 4.0, 13)  # headings about a peak [its standard deviations]
_ITERATIONS = 3


def integrate(likelihood: PlateLikelihood, scan: Scan, cluster: Cluster, sight: Array) -> tuple[Array, Array]:
    """Posterior means (S, 3) and covariances (S, 3, 3) for plates seen nearly edge-on at bearings `sight` (S,)."""
    beams = Beams.of(scan, cluster)
    coarse = _given(likelihood, beams, cluster, sight[:, None] + GRID)
    peaks = _peaks(likelihood, beams, coarse)
    fine = _given(likelihood, beams, cluster, peaks)
    pose = np.concatenate([coarse.pose.reshape(len(sight), -1, 3), fine.pose.reshape(len(sight), -1, 3)], axis=1)
    cost = np.concatenate([coarse.cost.reshape(len(sight), -1), fine.cost.reshape(len(sight), -1)], axis=1)
    hessian = np.concatenate([f.hessian.reshape(len(sight), -1, 3, 3) for f in (coarse, fine)], axis=1)

    width = spans(pose[..., 2])
    weight = weights(cost, width)
    mean = np.sum(weight[..., None] * pose, axis=1)
    away = pose - mean[:, None]
    inverse, regular = inverses(hessian.reshape(-1, 3, 3))
    within = np.where(regular[:, None, None], inverse, UNKNOWN).reshape(hessian.shape)
    within[..., 2, 2] = width**2 / 12  # a fixed heading has no hessian
    total = within + away[..., :, None] * away[..., None, :]
    return mean, np.sum(np.where(weight[..., None, None] > 1e-9, weight[..., None, None] * total, 0.0), axis=1)


def _given(likelihood: PlateLikelihood, beams: Beams, cluster: Cluster, heading: Array) -> Evaluation:
    """Fits (S * K,) of the position at headings (S, K)."""
    every = np.repeat(np.arange(len(heading)), heading.shape[1])
    middle = fit_line(cluster).middle[every]
    start = place(cluster.take(every), heading.ravel(), middle, likelihood.plate)
    return climb(likelihood, beams.take(every), start, _ITERATIONS, turn=False)


def _peaks(likelihood: PlateLikelihood, beams: Beams, coarse: Evaluation) -> Array:
    """Headings (S, K) around the peaks of the posterior, within a few steps of the coarse grid."""
    cost = coarse.cost.reshape(-1, len(GRID))
    beside = np.pad(cost, ((0, 0), (1, 1)), constant_values=np.inf)
    dip = (cost <= beside[:, :-2]) & (cost <= beside[:, 2:])
    lowest = np.argsort(np.where(dip, cost, np.inf), axis=1, kind="stable")[:, :_PEAKS]
    scan = np.repeat(np.arange(len(cost)), _PEAKS)
    start = coarse.pose.reshape(len(cost), -1, 3)[scan, lowest.ravel()]
    fit = climb(likelihood, beams.take(scan), start, 2 * _ITERATIONS)
    inverse, regular = inverses(fit.hessian)
    sigma = np.sqrt(np.where(regular, np.minimum(inverse[:, 2, 2], _STEP**2), _STEP**2))
    return (fit.pose[:, 2, None] + sigma[:, None] * _PEAK).reshape(len(cost), -1)
