"""Intervals that allow for slip that lasts: the wider of the model's and of the scatter of the scores of stretches."""

from __future__ import annotations

import numpy as np
import scipy

from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.residuals import weights
from trackslip.identification.intervals import CONFIDENCE
from trackslip.kinematics import Array

_STRETCH = 10.0  # usual duration of a long stretch [s]
_MIN_STRETCHES = 12
_LASTING = 1.05  # scatter of long stretches' scores over the model's, beyond which slip lasts


def model_errors(fit: Fit) -> Array:
    """Standard errors (f,) of the free values if the noise is as the model has it."""
    return np.asarray(np.sqrt(np.diag(fit.covariance)))


def half_widths(fit: Fit) -> Array:
    """Half widths (f,) of the 95 % intervals of the free values.

    Long stretches of a drive have independent scores even if slip lasts for seconds. Where their scores scatter no more
    than the model says, stretches half as long are taken: these are more, so that their scatter is known better.
    """
    errors, f = model_errors(fit), len(fit.free)
    duration = float(sum(drive.time[-1] - drive.time[0] for drive in fit.nodes.drives))
    long = max(_MIN_STRETCHES, 3 * f // 2, int(duration / _STRETCH))
    (scatter, half), (_, narrow) = _scattered(fit, long), _scattered(fit, 2 * long)
    wide = np.where(scatter > _LASTING * errors, half, narrow)
    return np.asarray(np.maximum(scipy.special.ndtri((1 + CONFIDENCE) / 2) * errors, wide))


def _scattered(fit: Fit, count: int) -> tuple[Array, Array]:
    """Standard errors (f,) and half widths (f,) by the scatter of the scores of about `count` stretches."""
    scores = np.diff(innovation_scores(fit, _cuts(fit, count)), axis=0, prepend=0.0)
    k, f = scores.shape
    errors = np.sqrt(np.diag(fit.covariance @ (scores.T @ scores) @ fit.covariance))
    quantile = scipy.special.stdtrit(max(k - 1, 1), (1 + CONFIDENCE) / 2)
    return errors * np.sqrt(k / max(k - 1, 1)), quantile * errors * np.sqrt(k / max(k - f, 1))


def innovation_scores(fit: Fit, cuts: np.ndarray) -> Array:
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


def _cuts(fit: Fit, count: int) -> np.ndarray:
    """Last nodes of about `count` stretches of equal duration."""
    time, first = fit.nodes.time, fit.nodes.first
    spans = time[first[1:] - 1] - time[first[:-1]]
    cuts = []
    for begin, end, span in zip(first[:-1], first[1:], spans, strict=True):
        parts = max(1, round(count * span / spans.sum()))
        ends = time[begin] + span * np.arange(1, parts) / parts
        cuts.append(np.append(begin + np.searchsorted(time[begin:end], ends), end - 1))
    return np.unique(np.concatenate(cuts))
