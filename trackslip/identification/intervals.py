"""Intervals of parameters: from the profile likelihood, from resampled runs, and from scores of stretches of drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from trackslip.identification.drive_fit import TrajectoryFit
from trackslip.identification.drive_residuals import weights
from trackslip.identification.lack_of_fit import LackOfFit
from trackslip.identification.solver import CONVERGED
from trackslip.identification.steady_fit import Fits, minimise
from trackslip.kinematics import Array

CONFIDENCE = 0.95  # of all intervals [-]
_STEPS = 12  # maximum number of steps towards the end of an interval
_NEAR = 1e-3  # relative error of the height at convergence
_ENOUGH = 1e-5  # change of chi-square that does not matter, relative to the height
_ITERATIONS = 10  # of each fit with a value held: more are needed only where chi-square is rough
_STRETCH = (0.25, 4.0)  # limits of the ratio of successive steps
_LONG_STRETCH = 10.0  # usual duration of a long stretch [s]
_MIN_STRETCHES = 12
_LASTING = 1.05  # scatter of long stretches' scores over the model's, beyond which slip lasts


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


def model_errors(fit: TrajectoryFit) -> Array:
    """Standard errors (f,) of the free values if the noise is as the model has it."""
    return np.asarray(np.sqrt(np.diag(fit.covariance)))


def half_widths(fit: TrajectoryFit) -> Array:
    """Half widths (f,) of the 95 % intervals of the free values.

    Long stretches of a drive have independent scores even if slip lasts for seconds. Where their scores scatter no more
    than the model says, stretches half as long are taken: these are more, so that their scatter is known better.
    """
    errors, f = model_errors(fit), len(fit.free)
    duration = float(sum(drive.time[-1] - drive.time[0] for drive in fit.nodes.drives))
    long = max(_MIN_STRETCHES, 3 * f // 2, int(duration / _LONG_STRETCH))
    (scatter, half), (_, narrow) = _scattered(fit, long), _scattered(fit, 2 * long)
    wide = np.where(scatter > _LASTING * errors, half, narrow)
    return np.asarray(np.maximum(scipy.special.ndtri((1 + CONFIDENCE) / 2) * errors, wide))


def _scattered(fit: TrajectoryFit, count: int) -> tuple[Array, Array]:
    """Standard errors (f,) and half widths (f,) by the scatter of the scores of about `count` stretches."""
    scores = np.diff(innovation_scores(fit, stretch_ends(fit, count)), axis=0, prepend=0.0)
    k, f = scores.shape
    errors = np.sqrt(np.diag(fit.covariance @ (scores.T @ scores) @ fit.covariance))
    quantile = scipy.special.stdtrit(max(k - 1, 1), (1 + CONFIDENCE) / 2)
    return errors * np.sqrt(k / max(k - 1, 1)), quantile * errors * np.sqrt(k / max(k - f, 1))


def innovation_scores(fit: TrajectoryFit, cuts: np.ndarray) -> Array:
    """Gradients (n, f) of half of -2 log likelihood of all data up to the nodes `cuts` (n,), by the free values."""
    found, solution, f = fit.residuals, fit.solution, len(fit.free)
    _, steps = weights(found, fit.nodes, fit.noise)
    border, gradient = solution.reduced[..., :f], solution.reduced[..., f]
    eliminated = np.cumsum(np.einsum("kif,ki->kf", border, gradient), axis=0)
    total = np.cumsum(solution.gradient, axis=0)
    scores = np.empty((len(cuts), f))
    for n, c in enumerate(cuts):
        root = np.zeros((3, 3))
        for a in range(3):
            for b in range(a + 1):
                root[a, b] = solution.factor[a - b, 3 * c + b]
        here = root @ solution.reduced[c]  # what the states before leave of the border and the gradient at this node
        information = root @ root.T
        if c < len(steps):  # less the step that leads on from it
            on = found.by_first[c].T * steps[c]
            information = information - on @ found.by_first[c]
            here = here - on @ np.column_stack([found.by_values[c], found.step[c]])
        last = here[:, :f].T @ np.linalg.solve(information, here[:, f])
        scores[n] = total[c] - (eliminated[c - 1] if c else 0.0) - last
    return scores


def stretch_ends(fit: TrajectoryFit, count: int) -> np.ndarray:
    """Last nodes of about `count` stretches of equal duration: parts of long drives, or several short ones in a row."""
    time, first = fit.nodes.time, fit.nodes.first
    spans = time[first[1:] - 1] - time[first[:-1]]
    usual, driven, cuts = spans.sum() / count, 0.0, []
    for begin, end, span in zip(first[:-1], first[1:], spans, strict=True):
        parts = max(1, round(span / usual))
        ends = time[begin] + span * np.arange(1, parts) / parts
        cuts.extend((begin + np.searchsorted(time[begin:end], ends)).tolist())
        if (driven + span) // usual > driven // usual:
            cuts.append(end - 1)
        driven += span
    return np.unique([*cuts, len(time) - 1])
