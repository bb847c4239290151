"""Plates seen nearly edge-on, whose heading's likelihood is no bell: the posterior is integrated over headings.

The position is fitted at each heading of a grid; pose and covariance are the posterior's mean and covariance. A few
beams that graze the long face tell the heading far more finely than the grid is, so that a peak may fall between its
points, or its width be overstated. From the lowest points of the grid the heading is therefore let free, and a finer
grid is laid about each peak that is reached.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.climb import climb
from trackslip.localization.likelihood import Fit, PlateLikelihood, View, inverses
from trackslip.localization.line import fit_line
from trackslip.localization.quadrature import spans, weights
from trackslip.localization.scan import Cluster, Scan
from trackslip.localization.solution import UNKNOWN
from trackslip.localization.starts import place

EDGE_ON = np.radians(3.0)
"""Nearer to the line of sight than this, the heading is integrated [rad]."""
FEW = 5
"""With so many returns or fewer, EDGE_ON_BY_FEW holds instead."""
EDGE_ON_BY_FEW = np.radians(5.0)
"""Nearer to the line of sight than this, the heading is integrated if there are few returns [rad]."""
GRID = np.radians(np.linspace(-8.0, 8.0, 49))
"""Headings of that integral, from the line of sight [rad]."""
_STEP = GRID[1] - GRID[0]
_PEAKS = 3  # looked at more finely, at most
_PEAK = np.linspace(-4.0, 4.0, 13)  # headings about a peak [its standard deviations]
_ITERATIONS = 3


def integrate(likelihood: PlateLikelihood, scan: Scan, cluster: Cluster, sight: Array) -> tuple[Array, Array]:
    """Posterior means (S, 3) and covariances (S, 3, 3) for plates seen nearly edge-on at bearings `sight` (S,)."""
    view = View.of(scan, cluster)
    coarse = _given(likelihood, view, cluster, sight[:, None] + GRID)
    peaks = _peaks(likelihood, view, coarse)
    fine = _given(likelihood, view, cluster, peaks)
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


def _given(likelihood: PlateLikelihood, view: View, cluster: Cluster, heading: Array) -> Fit:
    """Fits (S * K,) of the position at headings (S, K)."""
    every = np.repeat(np.arange(len(heading)), heading.shape[1])
    middle = fit_line(cluster).middle[every]
    start = place(cluster.take(every), heading.ravel(), middle, likelihood.plate)
    return climb(likelihood, view.take(every), start, _ITERATIONS, turn=False)


def _peaks(likelihood: PlateLikelihood, view: View, coarse: Fit) -> Array:
    """Headings (S, K) about the posterior's peaks, none farther from a peak than the coarse grid's steps."""
    cost = coarse.cost.reshape(-1, len(GRID))
    beside = np.pad(cost, ((0, 0), (1, 1)), constant_values=np.inf)
    dip = (cost <= beside[:, :-2]) & (cost <= beside[:, 2:])
    lowest = np.argsort(np.where(dip, cost, np.inf), axis=1, kind="stable")[:, :_PEAKS]
    scan = np.repeat(np.arange(len(cost)), _PEAKS)
    start = coarse.pose.reshape(len(cost), -1, 3)[scan, lowest.ravel()]
    fit = climb(likelihood, view.take(scan), start, 2 * _ITERATIONS)
    inverse, regular = inverses(fit.hessian)
    sigma = np.sqrt(np.where(regular, np.minimum(inverse[:, 2, 2], _STEP**2), _STEP**2))
    return (fit.pose[:, 2, None] + sigma[:, None] * _PEAK).reshape(len(cost), -1)
