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

ITERATIONS = 40
"""Largest number of steps."""
CONVERGED = 1e-9
"""Relative decrease of the cost at convergence."""
_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters
_MIN_STEP = 1e-10  # relative to the scales of the parameters
_MAX_DAMPING = 1e12
_REFUSED, _NOISE = 5, 1e-6  # steps refused in a row, and relative changes of the cost, that are noise of the residuals


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
    tolerance: Array | float = CONVERGED,
    iterations: int = ITERATIONS,
) -> Minimum:
    """Minimise the sums of squares of M problems, from starting values (M, p) within the limits `low`, `high` (p,).

    `scale` (p,) are the sizes of significant changes; parameters where `held` (M, p) is true are kept fixed.
    Without a `jacobian`, derivatives are taken by differences. `tolerance` (M,) is the relative decrease of the cost at
    convergence.
    """
    problems, parameters = start.shape
    held = np.zeros((problems, parameters), bool) if held is None else held
    values = start.astype(float)
    rows = np.arange(problems)

    def finite(values: Array, rows: np.ndarray) -> Array:
        return np.nan_to_num(residual(values, rows), nan=1e8, posinf=1e8, neginf=-1e8)

    current = finite(values, rows)
    cost = np.sum(current**2, axis=1)
    gradient = np.zeros((problems, parameters))
    hessian = np.tile(np.eye(parameters), (problems, 1, 1))
    tolerance = np.broadcast_to(tolerance, problems)
    refused = np.zeros(problems, int)  # steps in a row
    damping = np.full(problems, 1e-3)
    fresh = rows
    for _ in range(iterations):
        if fresh.size:
            if jacobian is None:
                slopes = _differences(finite, values[fresh], current[fresh], fresh, high, scale)
            else:
                slopes = jacobian(values[fresh], fresh)
            slopes = np.where(held[fresh][:, None, :], 0.0, slopes)
            gradient[fresh] = np.einsum("mki,mk->mi", slopes, current[fresh])
            normal = slopes.swapaxes(1, 2) @ slopes
            np.einsum("mii->mi", normal)[held[fresh]] = 1.0
            hessian[fresh] = normal
        slope, at = gradient[rows], values[rows]
        # parameters that push against a limit are held there
        free = ~(((at <= low) & (slope > 0)) | ((at >= high) & (slope < 0)) | held[rows])
        slope = np.where(free, slope, 0.0)
        normal = hessian[rows] * (free[:, :, None] & free[:, None, :])
        diagonal = np.einsum("mii->mi", hessian[rows])
        weakest = 1e-14 * diagonal.max(axis=1, keepdims=True) + 1e-300
        added = np.where(free, damping[rows, None] * diagonal + weakest, 1.0)
        step = -np.linalg.solve(normal + added[:, :, None] * np.eye(parameters), slope[..., None])
        trial = np.clip(at + step[..., 0], low, high)
        step = trial - at
        tried = finite(trial, rows)
        tried_cost = np.sum(tried**2, axis=1)
        gained = cost[rows] - tried_cost
        better = gained >= 0
        expected = -(2 * np.einsum("mi,mi->m", slope, step) + np.einsum("mi,mij,mj->m", step, normal, step))
        small = np.abs(np.where(better, gained, expected)) <= tolerance[rows] * cost[rows]
        refused[rows] = np.where(better, 0, refused[rows] + 1)
        small |= (refused[rows] >= _REFUSED) & (np.maximum(expected, -gained) <= _NOISE * cost[rows])
        done = small | (np.abs(step / scale).max(axis=1) < _MIN_STEP) | (damping[rows] > _MAX_DAMPING)
        fresh = rows[better]
        values[fresh], current[fresh], cost[fresh] = trial[better], tried[better], tried_cost[better]
        damping[rows] = np.where(better, np.maximum(damping[rows] / 10, 1e-12), np.maximum(damping[rows] * 10, 1e-4))
        rows, fresh = rows[~done], rows[better & ~done]
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
