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
_NEAR = 1e-2  # relative decrease of the cost below which the residuals' curvature counts: a minimum is near
_LEAST_CURVED = 1e-6  # smallest eigenvalue of a Hessian with the residuals' curvature, relative to one without


@dataclass(frozen=True)
class Minimum:
    """The minima of M problems."""

    values: Array  # (M, p)
    cost: Array  # (M,) sum of squares
    hessian: Array  # (M, p, p) J^T J; rows and columns of held parameters are those of the unit matrix
    bend: Array  # (M, p, p) what the curvature of the residuals adds to it, as far as the way to the minimum tells


def least_squares(
    residual: Residual,
    start: Array,
    low: Array,
    high: Array,
    scale: Array,
    held: np.ndarray | None = None,
    jacobian: Jacobian | None = None,
    bend: Array | None = None,
    tolerance: Array | float = CONVERGED,
    iterations: int = ITERATIONS,
    first: Array | None = None,
) -> Minimum:
    """Minimise the sums of squares of M problems, from starting values (M, p) within the limits `low`, `high` (p,).

    `scale` (p,) are the sizes of significant changes; parameters where `held` (M, p) is true are kept fixed.
    Without a `jacobian`, derivatives are taken by differences. A `bend` (M, p, p) known from a similar problem, as of
    Minimum, saves steps, and residuals `first` (M, K) known at the start a call. `tolerance` (M,) is the relative
    decrease of the cost at convergence.
    """
    problems, parameters = start.shape
    held = np.zeros((problems, parameters), bool) if held is None else held
    values = start.astype(float)
    rows = np.arange(problems)

    def finite(values: Array, rows: np.ndarray) -> Array:
        return _finite(residual(values, rows))

    current = finite(values, rows) if first is None else _finite(first)
    cost = np.sum(current**2, axis=1)
    slopes = np.zeros((*current.shape, parameters))
    hessian = np.tile(np.eye(parameters), (problems, 1, 1))
    tolerance = np.broadcast_to(tolerance, problems)
    bent = np.full(problems, bend is not None)  # whether the bend foretells costs better than the slopes alone
    bend = np.zeros(hessian.shape) if bend is None else bend.copy()
    refused = np.zeros(problems, int)  # steps in a row
    gradient, before, moved = np.zeros((3, problems, parameters))
    damping = np.full(problems, 1e-3)
    fresh = rows
    for _ in range(iterations):
        if fresh.size:
            if jacobian is None:
                there = _differences(finite, values[fresh], current[fresh], fresh, high, scale)
            else:
                there = jacobian(values[fresh], fresh)
            slopes[fresh] = there = np.where(held[fresh][:, None, :], 0.0, there)
            downhill = np.einsum("mki,mk->mi", there, current[fresh])
            bend[fresh] = _bend(bend[fresh], moved[fresh], downhill - before[fresh], downhill - gradient[fresh])
            gradient[fresh] = downhill
            normal = there.swapaxes(1, 2) @ there
            np.einsum("mii->mi", normal)[held[fresh]] = 1.0
            hessian[fresh] = normal
        slope, at = gradient[rows], values[rows]
        # parameters that push against a limit are held there
        stuck = ((at <= low) & (slope > 0)) | ((at >= high) & (slope < 0)) | held[rows]
        free = ~stuck
        slope = np.where(free, slope, 0.0)
        curved = _curved(hessian[rows], bend[rows] * bent[rows, None, None], free)
        diagonal = np.einsum("mii->mi", hessian[rows])
        weakest = 1e-14 * diagonal.max(axis=1, keepdims=True) + 1e-300
        added = np.where(stuck, 1.0, damping[rows, None] * diagonal + weakest)
        step = -np.linalg.solve(curved + added[:, :, None] * np.eye(parameters), slope[..., None])
        trial = np.clip(at + step[..., 0], low, high)
        step = trial - at
        tried = finite(trial, rows)
        tried_cost = np.sum(tried**2, axis=1)
        gained = cost[rows] - tried_cost
        better = gained >= 0
        expected = -(2 * np.einsum("mi,mi->m", slope, step) + _square(curved, step))
        small = np.abs(np.where(better, gained, expected)) <= tolerance[rows] * cost[rows]
        refused[rows] = np.where(better, 0, refused[rows] + 1)
        small |= (refused[rows] >= _REFUSED) & (np.maximum(expected, -gained) <= _NOISE * cost[rows])
        done = small | (np.abs(step / scale).max(axis=1) < _MIN_STEP) | (damping[rows] > _MAX_DAMPING)
        fresh = rows[better]
        plain = gained + 2 * np.einsum("mi,mi->m", gradient[rows], step) + _square(hessian[rows], step)
        near = (gained < _NEAR * cost[rows]) & (np.abs(plain + _square(bend[rows], step)) < np.abs(plain))
        bent[fresh] = near[better]
        moved[fresh] = step[better]
        before[fresh] = np.einsum("mki,mk->mi", slopes[fresh], tried[better])
        values[fresh], current[fresh], cost[fresh] = trial[better], tried[better], tried_cost[better]
        damping[rows] = np.where(better, np.maximum(damping[rows] / 10, 1e-12), np.maximum(damping[rows] * 10, 1e-4))
        rows, fresh = rows[~done], rows[better & ~done]
        if not rows.size:
            break
    return Minimum(values, cost, hessian, bend)


def _finite(residual: Array) -> Array:
    """Residuals (m, K), large where there are none."""
    return np.nan_to_num(residual, nan=1e8, posinf=1e8, neginf=-1e8)


def _square(matrix: Array, step: Array) -> Array:
    """Quadratic forms (m,) of matrices (m, p, p)."""
    return np.einsum("mi,mij,mj->m", step, matrix, step)


def _curved(normal: Array, bend: Array, free: np.ndarray) -> Array:
    """The Hessians (m, p, p) of half the costs for the free parameters (m, p), convex in any case."""
    both = free[:, :, None] & free[:, None, :]
    if not bend.any():
        return normal * both
    normal, whole = normal * both, (normal + bend) * both
    root = np.sqrt(np.where(free, np.maximum(np.einsum("mii->mi", normal), 1e-300), 1.0))
    scaled = whole / root[:, :, None] / root[:, None, :] + ~free[:, :, None] * np.eye(free.shape[1])
    convex = np.linalg.eigvalsh(scaled)[:, 0] > _LEAST_CURVED
    return np.where(convex[:, None, None], whole, normal)


def _bend(bend: Array, step: Array, of_slopes: Array, of_gradient: Array) -> Array:
    """What the residuals' own curvature adds to the Hessians (m, p, p), after steps (m, p): a secant update.

    `of_slopes` (m, p) is the change of the gradient that the change of the slopes causes, `of_gradient` the whole
    (Dennis, Gay and Welsch, 1981, NL2SOL).
    """
    if not step.any():
        return bend
    along = np.einsum("mi,mi->m", step, of_gradient)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(np.einsum("mi,mi->m", step, of_slopes)) / np.abs(_square(bend, step))
        sized = bend * np.where(size < 1, size, 1.0)[:, None, None]
        rest = of_slopes - np.einsum("mij,mj->mi", sized, step)
        outer = rest[:, :, None] * of_gradient[:, None, :]
        again = of_gradient[:, :, None] * of_gradient[:, None, :]
        twice = np.einsum("mi,mi->m", step, rest) / along**2
        updated = sized + (outer + outer.swapaxes(1, 2)) / along[:, None, None] - again * twice[:, None, None]
    usable = (along > 0) & np.isfinite(updated).all(axis=(1, 2))
    return np.where(usable[:, None, None], updated, bend)


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
