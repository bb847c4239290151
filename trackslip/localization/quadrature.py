"""Quadrature of posteriors at arbitrary points."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array


def spans(points: Array) -> Array:
    """Widths (S, K) of the points (S, K), in any order, in the trapezoidal rule over their row."""
    order = np.argsort(points, axis=1, kind="stable")
    ordered = np.take_along_axis(points, order, axis=1)
    share = np.empty_like(ordered)
    share[:, 1:-1] = (ordered[:, 2:] - ordered[:, :-2]) / 2
    share[:, 0], share[:, -1] = (ordered[:, 1] - ordered[:, 0]) / 2, (ordered[:, -1] - ordered[:, -2]) / 2
    span = np.empty_like(share)
    np.put_along_axis(span, order, share, axis=1)
    return span


def weights(cost: Array, span: Array) -> Array:
    """Probabilities (S, K) of points with widths `span` (S, K) and negative log likelihoods `cost` (S, K)."""
    weight = np.exp(cost.min(axis=1, keepdims=True) - cost) * span
    return weight / weight.sum(axis=1, keepdims=True)
