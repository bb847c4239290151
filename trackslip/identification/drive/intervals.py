"""Intervals that allow for slip that lasts: the wider of the model's and of the scatter of the scores of stretches."""

from __future__ import annotations

import numpy as np
import scipy

from trackslip.identification.drive.equations import weights
from trackslip.identification.drive.fit import Fit
from trackslip.identification.intervals import CONFIDENCE
from trackslip.kinematics import Array

_STRETCH = 10.0  # usual duration of a stretch [s]
_MIN_STRETCHES = 16


def model_errors(fit: Fit) -> Array:
    """Standard errors (f,) of the free values if the noise is as the model has it."""
    return np.asarray(np.sqrt(np.diag(fit.covariance)))


def half_widths(fit: Fit) -> Array:
    """Half widths (f,) of the 95 % intervals of the free values.

    Stretches of a drive are so long that their scores are independent even if slip lasts for seconds. There are at
    least 16 of them, and twice as many as free values.
    """
    covariance, f = fit.covariance, len(fit.free)
    scores = np.diff(innovation_scores(fit, _cuts(fit)), axis=0, prepend=0.0)
    k = len(scores)
    robust = covariance @ (scores.T @ scores) @ covariance
    quantile = (1 + CONFIDENCE) / 2
    wide = scipy.stats.t.ppf(quantile, k - 1) * np.sqrt(np.diag(robust) * k / max(k - f, 1))
    return np.asarray(np.maximum(scipy.stats.norm.ppf(quantile) * np.sqrt(np.diag(covariance)), wide))


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
            here = here - on @ np.column_stack([found.by_values[c][:, fit.free], found.step[c]])
        last = here[:, :f].T @ np.linalg.solve(information, here[:, f])
        scores[n] = total[c] - (eliminated[c - 1] if c else 0.0) - last
    return scores


def _cuts(fit: Fit) -> np.ndarray:
    """Last nodes of the stretches."""
    time, first = fit.nodes.time, fit.nodes.first
    spans = time[first[1:] - 1] - time[first[:-1]]
    count = max(_MIN_STRETCHES, 2 * len(fit.free), int(spans.sum() / _STRETCH))
    cuts = []
    for begin, end, span in zip(first[:-1], first[1:], spans, strict=True):
        parts = max(1, round(count * span / spans.sum()))
        ends = time[begin] + span * np.arange(1, parts) / parts
        cuts.append(np.append(begin + np.searchsorted(time[begin:end], ends), end - 1))
    return np.unique(np.concatenate(cuts))
