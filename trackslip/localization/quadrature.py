"""Probabilities of points on a grid, by the trapezoidal rule."""

import numpy as np

from trackslip.kinematics import Array


def quadrature(points: Array, cost: Array) -> tuple[Array, Array]:
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


def moments(points: Array, share: Array, width: Array) -> tuple[Array, Array]:
    """Means (S,) and variances (S,) of points (S, K) with the probabilities and widths that `quadrature` gives."""
    mean = (share * points).sum(axis=1)
    return mean, (share * ((points - mean[:, None]) ** 2 + width**2 / 12)).sum(axis=1)
