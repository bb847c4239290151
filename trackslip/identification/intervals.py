"""Intervals of a law's parameters: from the profile of the likelihood, and from resampled runs."""

from __future__ import annotations

import numpy as np

from trackslip.identification.fit import Fits, fit, minimise
from trackslip.kinematics import Array

_STEPS = 12  # towards the end of an interval, at most
_NEAR = 1e-3  # error of a reached height, relative
_STRETCH = (0.25, 4.0)  # of a step, from one to the next
BOOTSTRAPS = 500
"""Resamples of the runs, by default."""


def profile_intervals(fits: Fits, height: Array | float) -> Array:
    """Intervals (M, p, 2) within which chi-square, minimised over all other parameters, rises less than `height` (M,).

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
    goal = np.sqrt(np.broadcast_to(height, (sets,)))[which]
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


def bootstrap_intervals(fits: Fits, share: float, count: int, rng: np.random.Generator) -> Array:
    """Percentile intervals (p, 2) that hold a `share` of `count` values from runs drawn again, with replacement.

    A run's two tracks stay together. For a single set of runs.
    """
    runs, n = fits.runs, fits.runs.runs
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=count).astype(float)
    start = np.tile(fits.values, (count, 1))
    again = fit(fits.family, runs.weighted(drawn), start, np.repeat(fits.scatter, count))
    tail = (1 - share) / 2
    return np.quantile(again.values, [tail, 1 - tail], axis=0).T
