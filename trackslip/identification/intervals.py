"""Intervals of a law's parameters: from the profile of the likelihood, and from resampled runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from trackslip.identification.fit import Fits, fit, minimise
from trackslip.identification.replicates import LackOfFit
from trackslip.kinematics import Array

CONFIDENCE = 0.95
"""Of all intervals."""
_STEPS = 12  # towards the end of an interval, at most
_NEAR = 1e-3  # error of a reached height, relative
_STRETCH = (0.25, 4.0)  # of a step, from one to the next
BOOTSTRAPS = 300
"""Resamples of the runs, by default."""


def standard_errors(fits: Fits, lacks: Sequence[LackOfFit] | None, measured: bool) -> Array:
    """(M, p) of the values.

    Of runs that came with errors of measurement, those of least squares; else the robust ones, for nothing says that
    all runs are equally good. Where a law lacks fit, larger by the inflation.

    Args:
        fits: a family fitted to M sets.
        lacks: their tests for lack of fit, if there are any.
        measured: whether the runs came with errors of measurement.
    """
    variance = np.einsum("mii->mi", fits.covariance if measured else fits.robust_covariance)
    inflation = np.array([lack.inflation for lack in lacks]) if lacks else np.ones(len(fits.values))
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.maximum(variance, 0.0)) * inflation[:, None]


def heights(fits: Fits, lacks: Sequence[LackOfFit] | None, measured: bool) -> Array:
    """How far chi-square may rise (M, p) within an interval.

    Student's quantile where the scatter was estimated, times the square of how much larger the standard errors are
    than those of least squares; where a law lacks fit, the degrees of freedom are those of its misses.
    """
    quantile = np.where(
        fits.scatter > 0, scipy.stats.f.ppf(CONFIDENCE, 1, fits.freedom), scipy.stats.chi2.ppf(CONFIDENCE, 1)
    )
    for k, lack in enumerate(lacks or ()):
        if lack.inflation > 1:
            quantile[k] = scipy.stats.f.ppf(CONFIDENCE, 1, lack.freedom[0])
    with np.errstate(invalid="ignore", divide="ignore"):
        larger = standard_errors(fits, lacks, measured) ** 2 / np.einsum("mii->mi", fits.covariance)
    return quantile[:, None] * np.where(np.isfinite(larger), larger, 1.0)


def profile_intervals(fits: Fits, height: Array) -> Array:
    """Intervals (M, p, 2) in which chi-square, minimised over all other parameters, rises less than `height` (M, p).

    An interval that reaches a limit of the family ends there.
    """
    sets, parameters = fits.values.shape
    low, high, scale = fits.family.limits(fits.runs.geometry.half_gauge)
    variance = np.einsum("mii->mi", fits.covariance)
    error = np.where(np.isfinite(variance), np.sqrt(np.maximum(variance, 0.0)), scale)
    # a problem for every set, parameter and side
    shape = (sets, parameters, 2)
    which = np.broadcast_to(np.arange(sets)[:, None, None], shape).ravel()
    index = np.broadcast_to(np.arange(parameters)[None, :, None], shape).ravel()
    sign = np.broadcast_to(np.array([-1.0, 1.0]), shape).ravel()
    held = index[:, None] == np.arange(parameters)
    goal = np.sqrt(height[which, index])
    centre = fits.values[which, index]
    span = np.where(sign > 0, high[index] - centre, centre - low[index])  # to the limit
    way = np.minimum(goal * error[which, index], span)
    values = fits.values[which]
    open_ = np.ones(len(which), bool)
    for _ in range(_STEPS):
        rows = np.flatnonzero(open_)
        start = values[rows]
        start[np.arange(len(rows)), index[rows]] = centre[rows] + sign[rows] * way[rows]
        reached = minimise(fits.family, fits.runs, fits.scatter, start, which[rows], held[rows])
        values[rows] = reached.values
        rise = np.sqrt(np.maximum(reached.cost - fits.cost[which[rows]], 1e-300))
        ratio = goal[rows] / rise
        ended = (np.abs(ratio - 1) < _NEAR) | ((way[rows] >= span[rows]) & (ratio > 1))
        way[rows] = np.where(ended, way[rows], np.minimum(way[rows] * np.clip(ratio, *_STRETCH), span[rows]))
        open_[rows[ended]] = False
        if not open_.any():
            break
    return (centre + sign * way).reshape(shape)


def bootstrap_intervals(fits: Fits, count: int, rng: np.random.Generator) -> Array:
    """Percentile intervals (p, 2) of the values from runs drawn again, with replacement, `count` times.

    A run's two tracks stay together. For a single set of runs.
    """
    runs, n = fits.runs, fits.runs.runs
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=count).astype(float)
    start = np.tile(fits.values, (count, 1))
    again = fit(fits.family, runs.weighted(drawn), start, np.repeat(fits.scatter, count))
    tail = (1 - CONFIDENCE) / 2
    return np.quantile(again.values, [tail, 1 - tail], axis=0).T
