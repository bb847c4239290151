"""Intervals of the parameters of a law: from the profile likelihood and from resampled runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from trackslip.identification.fit import Fits, minimise
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.solver import CONVERGED
from trackslip.kinematics import Array

CONFIDENCE = 0.95  # of all intervals [-]
_STEPS = 12  # maximum number of steps towards the end of an interval
_NEAR = 1e-3  # relative error of the height at convergence
_ENOUGH = 1e-5  # change of chi-square that does not matter, relative to the height
_ITERATIONS = 10  # of each fit with a value held: more are needed only where chi-square is rough
_STRETCH = (0.25, 4.0)  # limits of the ratio of successive steps


def standard_errors(fits: Fits, lacks: Sequence[LackOfFit] | None, measured: bool) -> Array:
    """Standard errors (M, p) of the values of M fits, with their tests for lack of fit, if any.

    If the measurement errors of the runs are known (`measured`), these are the least-squares errors; otherwise the
    robust ones, because runs may differ in quality. If a law lacks fit, they are multiplied by the factors.
    """
    variance = np.einsum("mii->mi", fits.covariance if measured else fits.robust_covariance)
    factors = np.array([lack.factors for lack in lacks]) if lacks else np.ones(fits.values.shape)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.maximum(variance, 0.0)) * factors


def heights(fits: Fits, lacks: Sequence[LackOfFit] | None, measured: bool) -> Array:
    """Rise of chi-square (M, p) that bounds an interval.

    The quantile (Student's, squared, if the scatter was estimated), times the squared ratio of the standard errors to
    those of least squares. If a law lacks fit, the degrees of freedom are those of the lack of fit.
    """
    quantile = np.where(
        fits.scatter > 0, scipy.special.fdtri(1, fits.freedom, CONFIDENCE), scipy.special.chdtri(1, 1 - CONFIDENCE)
    )
    for k, lack in enumerate(lacks or ()):
        if lack.inflation > 1:
            quantile[k] = scipy.special.fdtri(1, lack.freedom[0], CONFIDENCE)
    with np.errstate(invalid="ignore", divide="ignore"):
        larger = standard_errors(fits, lacks, measured) ** 2 / np.einsum("mii->mi", fits.covariance)
    return quantile[:, None] * np.where(np.isfinite(larger), larger, 1.0)


def profile_intervals(fits: Fits, height: Array) -> Array:
    """Intervals (M, p, 2) in which chi-square, minimised over all other parameters, rises by less than `height` (M, p).

    Intervals end at the limits of the family.
    """
    sets, parameters = fits.values.shape
    low, high, scale = fits.family.limits(fits.runs.geometry.half_gauge)
    variance = np.einsum("mii->mi", fits.covariance)
    error = np.where(np.isfinite(variance), np.sqrt(np.maximum(variance, 0.0)), scale)
    # a problem for every set, parameter and side
    which, index, side = np.indices((sets, parameters, 2)).reshape(3, -1)
    sign = 2.0 * side - 1.0
    held = index[:, None] == np.arange(parameters)
    goal = np.sqrt(height[which, index])
    centre = fits.values[which, index]
    span = np.where(sign > 0, high[index] - centre, centre - low[index])  # to the limit
    way = np.minimum(goal * error[which, index], span)
    values = fits.values[which]
    with np.errstate(invalid="ignore"):
        beside = (fits.covariance[which, :, index]) / variance[which, index][:, None]  # change of the others
    ahead = np.where(np.isfinite(beside), beside, 0.0)
    tolerance = np.clip(_ENOUGH * goal**2 / np.maximum(fits.cost[which], 1e-300), CONVERGED, _ENOUGH)
    open_ = np.ones(len(which), bool)
    for _ in range(_STEPS):
        rows = np.flatnonzero(open_)
        gone = sign[rows] * way[rows]
        start = np.clip(values[rows] + ahead[rows] * gone[:, None], low, high)
        start[np.arange(len(rows)), index[rows]] = centre[rows] + gone
        reached = minimise(
            fits.family,
            fits.runs,
            fits.scatter,
            start,
            which[rows],
            held[rows],
            tolerance[rows],
            _ITERATIONS,
        )
        moved = gone != 0
        ahead[rows[moved]] = ((reached.values - values[rows])[moved]) / gone[moved, None]
        rise = np.sqrt(np.maximum(reached.cost - fits.cost[which[rows]], 1e-300))
        ratio = goal[rows] / rise
        ended = (np.abs(ratio - 1) < _NEAR) | ((way[rows] >= span[rows]) & (ratio > 1))
        way[rows] = np.where(ended, way[rows], np.minimum(way[rows] * np.clip(ratio, *_STRETCH), span[rows]))
        open_[rows[ended]] = False
        if not open_.any():
            break
    return (centre + sign * way).reshape(sets, parameters, 2)


def bootstrap_intervals(fits: Fits, count: int, rng: np.random.Generator) -> Array:
    """Percentile intervals (p, 2) of the values from `count` resamples of the runs, with replacement.

    The two tracks of a run stay together. Each resample is fitted by one step of Gauss and Newton from the values.
    Only for a single set of runs.
    """
    n, parameters = fits.runs.runs, fits.values.shape[1]
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=count).astype(float)
    factor = 1 / np.sqrt(fits.runs.eigenvalues + fits.scatter[0] ** 2)  # (n, 2)
    jacobian = fits.jacobian[0].reshape(n, 2, parameters) * factor[..., None]
    residual = fits.deviation[0] * factor
    normal = np.einsum("kn,nij->kij", drawn, np.einsum("nai,naj->nij", jacobian, jacobian))
    gradient = np.einsum("kn,ni->ki", drawn, np.einsum("nai,na->ni", jacobian, residual))
    low, high, scale = fits.family.limits(fits.runs.geometry.half_gauge)
    weakest = 1e-12 * np.einsum("kii->ki", normal).max(axis=1, initial=1e-300)
    normal += weakest[:, None, None] * np.diag(scale.min(initial=np.inf) ** 2 / scale**2)
    again = np.clip(fits.values - np.linalg.solve(normal, gradient[..., None])[..., 0], low, high)
    tail = (1 - CONFIDENCE) / 2
    return np.quantile(again, [tail, 1 - tail], axis=0).T
