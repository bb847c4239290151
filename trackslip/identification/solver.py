"""Many small nonlinear least-squares problems at once, by the Levenberg-Marquardt method.

Bootstraps, cross-validations, profiles and coverage studies are hundreds to thousands of fits of the same few
parameters to the same few runs. Solved together, they take no longer than a few of them one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

Residual = Callable[[Array, np.ndarray], Array]
"""From values (m, p) of the problems `rows` (m,) to their residuals (m, K); values that are not finite are rejected."""
Jacobian = Callable[[Array, np.ndarray], Array]
"""From the same to the derivatives (m, K, p) of the residuals."""

_ITERATIONS = 40
_CONVERGED = 1e-9  # relative decrease of the cost at convergence
_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters
_MIN_STEP = 1e-10  # relative to the scales of the parameters
_MAX_DAMPING = 1e12


@dataclass(frozen=True)
class Minimum:
    """The minima of M problems."""

    values: Array  # (M, p)
    cost: Array  # (M,) sum of squares
    hessian: Array  # (M, p, p) J^T J; rows and columns of held parameters are those of the unit matrix


def least_squares(
    residual: Residual,
    start: Array,
    low: Array,
    high: Array,
    scale: Array,
    held: np.ndarray | None = None,
    jacobian: Jacobian | None = None,
) -> Minimum:
    """Minimise the sums of squares of M problems, from starting values (M, p) within the limits `low`, `high` (p,).

    `scale` (p,) are the sizes of significant changes; parameters where `held` (M, p) is true are kept fixed.
    Without a `jacobian`, derivatives are taken by differences.
    """
    problems, parameters = start.shape
    held = np.zeros((problems, parameters), bool) if held is None else held
    values = start.astype(float)
    rows = np.arange(problems)

    def finite(values: Array, rows: np.ndarray) -> Array:
        return np.nan_to_num(residual(values, rows), nan=1e8, posinf=1e8, neginf=-1e8)

    current = finite(values, rows)
    cost = np.sum(current**2, axis=1)
    hessian = np.tile(np.eye(parameters), (problems, 1, 1))
    damping = np.full(problems, 1e-3)
    for _ in range(_ITERATIONS):
        if jacobian is None:
            slopes = _differences(finite, values[rows], current[rows], rows, high, scale)
        else:
            slopes = jacobian(values[rows], rows)
        slopes = np.where(held[rows][:, None, :], 0.0, slopes)
        gradient = np.einsum("mki,mk->mi", slopes, current[rows])
        normal = slopes.swapaxes(1, 2) @ slopes
        diagonal = np.einsum("mii->mi", normal)  # a view
        diagonal[held[rows]] = 1.0
        hessian[rows] = normal
        # parameters that push against a limit are held there
        stuck = ((values[rows] <= low) & (gradient > 0)) | ((values[rows] >= high) & (gradient < 0)) | held[rows]
        free = ~stuck
        normal = normal * (free[:, :, None] & free[:, None, :])
        weakest = 1e-14 * diagonal.max(axis=1, keepdims=True) + 1e-300
        added = np.where(stuck, 1.0, damping[rows, None] * diagonal + weakest)
        damped = normal + added[:, :, None] * np.eye(parameters)
        step = -np.linalg.solve(damped, np.where(free, gradient, 0.0)[..., None])
        trial = np.clip(values[rows] + step[..., 0], low, high)
        tried = finite(trial, rows)
        tried_cost = np.sum(tried**2, axis=1)
        better = tried_cost <= cost[rows]
        moved = np.abs((trial - values[rows]) / scale).max(axis=1)
        settled = (better & (cost[rows] - tried_cost <= _CONVERGED * cost[rows])) | (moved < _MIN_STEP)
        done = settled | (damping[rows] > _MAX_DAMPING)
        taken = rows[better]
        values[taken], current[taken], cost[taken] = trial[better], tried[better], tried_cost[better]
        damping[rows] = np.where(better, np.maximum(damping[rows] / 10, 1e-12), damping[rows] * 10)
        rows = rows[~done]
        if not rows.size:
            break
    return Minimum(values, cost, hessian)


def _differences(
    residual: Residual, values: Array, current: Array, rows: np.ndarray, high: Array, scale: Array
) -> Array:
    """Derivatives (m, K, p) by one-sided differences within the limits."""
    problems, parameters = values.shape
    step = _DIFFERENCE * scale
    signed = np.where(values + step > high, -step, step)  # (m, p)
    beside = values[:, None, :] + signed[:, :, None] * np.eye(parameters)
    there = residual(beside.reshape(-1, parameters), np.repeat(rows, parameters))  # all in one call
    change = there.reshape(problems, parameters, -1) - current[:, None, :]
    return (change / signed[:, :, None]).swapaxes(1, 2)
