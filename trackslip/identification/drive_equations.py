"""Normal equations of the residuals: block-tridiagonal in the trajectory, bordered by parameters.

The lower Cholesky factor of the trajectory's part has five bands, so that a solution takes a time linear in the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.errors import LogError
from trackslip.identification.drive_residuals import Nodes, Noise, Residuals, weights
from trackslip.kinematics import Array

_MIN_INFORMATION = 1e-3  # of a state, for nodes that no pose and no step ties [1/m^2, 1/rad^2]
_DIFFERENCE = 1e-3  # relative change of a weight for differences
_HOPELESS = "the poses can't be reconciled with the sprocket speeds: check units, clocks and wild readings"


@dataclass(frozen=True)
class GaussNewtonStep:
    """A solved step of Gauss and Newton."""

    states: Array  # (K, 3) change of the states
    values: Array  # (f,) change of the free parameters
    information: Array  # (f, f) of the free parameters, the trajectory eliminated
    right: Array  # (f,) of half the cost by the free parameters, the trajectory eliminated
    gradient: Array  # (K, f) of half the cost by the free parameters, of each node's pose and the step that leads to it
    factor: Array  # (6, 3 K) lower bands of the Cholesky factor L of the trajectory's Hessian
    reduced: Array  # (K, 3, f + 1) L^-1 times the border and the trajectory's gradient

    def limited(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Changes (K, 3) of the states and (f,) of the values where these stay between `low` and `high` (f,)."""
        values, held = self.values.copy(), np.zeros(len(self.values), bool)
        while (beyond := ~held & ((values < low) | (values > high))).any():
            held |= beyond
            values[held] = np.clip(values, low, high)[held]
            rest = ~held
            right = self.right[rest] + self.information[np.ix_(rest, held)] @ values[held]
            values[rest] = -_solved(self.information[np.ix_(rest, rest)], right)
        return (_states(self.factor, self.reduced, values) if held.any() else self.states), values


def solve(found: Residuals, nodes: Nodes, noise: Noise, yaw: int, prior: Array, pull: Array) -> GaussNewtonStep:
    """The step of Gauss and Newton for the states and the free parameters (f,) of `found`.

    `prior` (p,) are standard deviations, `pull` (p,) how far the values lie from the priors' means; `yaw` is the index
    of the sensor's yaw, the only parameter that poses depend on.
    """
    free = found.free
    poses, steps = weights(found, nodes, noise)
    first, second, slope = _by_nodes(found)
    known, gradient = _of_poses(nodes, poses, found.pose)
    turning = gradient[:, 2].copy()  # by the sensor's yaw, too: both turn the pose
    weighted = (steps * found.step).T
    gradient[:-1] += (first * weighted[:, None]).sum(axis=0).T
    gradient[1:] += (second * weighted[:, None]).sum(axis=0).T
    score = np.zeros((len(free), len(poses)))
    score[:, 1:] = (slope * weighted[:, None]).sum(axis=0)
    scaled = (slope * np.sqrt(steps.T)[:, None]).swapaxes(0, 1).reshape(len(free), steps.size)
    corner = scaled @ scaled.T + np.diag(1 / prior[free] ** 2)
    at = np.flatnonzero(free == yaw)
    corner[at, at] += known[:, 2, 2].sum()
    score[at] += turning
    right = np.empty((len(free) + 1, *poses.shape))
    right[:-1] = _border(first, second, slope, known, steps, free == yaw)
    right[-1] = gradient
    bands = _bands(first, second, steps)
    _add(bands, known + _MIN_INFORMATION * np.eye(3))
    factor = _factor(bands)
    flat, _ = scipy.linalg.lapack.dtbtrs(factor, right.reshape(len(right), -1).T, uplo="L", overwrite_b=True)
    border, last = flat[:, :-1], flat[:, -1]
    information = corner - border.T @ border
    rest = score.sum(axis=1) - border.T @ last + pull[free] / prior[free] ** 2
    values = -_solved(information, rest)
    reduced = np.moveaxis(flat.T.reshape(right.shape), 0, -1)
    return GaussNewtonStep(_states(factor, reduced, values), values, information, rest, score.T, factor, reduced)


def used_up(found: Residuals, nodes: Nodes, noise: Noise, solution: GaussNewtonStep, yaw: int) -> Array:
    """Number (7,) or (8,) of residuals of each kind of Noise that the unknowns use up; together, their own number.

    Each is the derivative of the Hessian's log determinant by the logarithm of the weights: of the trajectory's part by
    differences, of the parameters' from their residuals with the trajectory eliminated.
    """
    poses, steps = weights(found, nodes, noise)
    first, second, slope = _by_nodes(found)
    follows = _following(solution)
    whole = _bands(first, second, steps)
    _add(whole, _of_poses(nodes, poses, found.pose)[0] + _MIN_INFORMATION * np.eye(3))
    log, covariance = 2 * np.log(solution.factor[0]).sum(), np.linalg.inv(solution.information)

    def used(change: Array, rows: Array, weight: Array) -> float:
        """By residuals whose part of the Hessian is `change`, with derivatives `rows` (n, f, k), `weight` (n, k)."""
        by_states = (2 * np.log(_factor(whole + _DIFFERENCE * change)[0]).sum() - log) / np.log1p(_DIFFERENCE)
        return float(by_states + np.einsum("ij,nik,nk,njk->", covariance, rows, weight, rows, optimize=True))

    of_poses = -follows
    of_poses[2, found.free == yaw] += 1.0
    if nodes.whitening is not None:
        of_poses = np.einsum("kai,ifk->afk", nodes.whitening, of_poses)
    rest, grown = noise.of_poses(found.rate)
    moving = (grown / (rest + grown))[:, [0, 0, 1]]
    parts = poses * (1 - moving) * [0, 0, 1], poses * moving * [1, 1, 0], poses * moving * [0, 0, 1]
    by_poses = []
    for part in parts:
        change = np.zeros_like(whole)
        _add(change, _of_poses(nodes, part, found.pose)[0])
        by_poses.append(used(change, of_poses, part.T))
    by_steps = []
    for kind in range(steps.shape[1]):
        one = slice(kind, kind + 1)
        by_states = np.einsum("ik,ijk->jk", first[kind], follows[..., :-1])
        by_states += np.einsum("ik,ijk->jk", second[kind], follows[..., 1:])
        rows = (slope[kind] - by_states)[None]
        by_steps.append(used(_bands(first[one], second[one], steps[:, one]), rows, steps.T[one]))
    every = np.array([by_poses[0], *by_steps[:3], *by_poses[1:], *by_steps[3:]])
    return np.concatenate([[poses.size + len(found.free) - every.sum()], every])


def _following(solution: GaussNewtonStep) -> Array:
    """Derivatives (3, f, K) of the states by the parameters, along the solution, their sign reversed."""
    border = solution.reduced[..., :-1]
    count, _, f = border.shape
    if not f:  # LAPACK may crash without
        return np.zeros((3, 0, count))
    flat = np.moveaxis(border, -1, 0).reshape(f, -1).T
    flat, _ = scipy.linalg.lapack.dtbtrs(solution.factor, flat, uplo="L", trans="T")
    return np.ascontiguousarray(np.moveaxis(flat.T.reshape(f, count, 3), -1, 0))


def _states(factor: Array, reduced: Array, values: Array) -> Array:
    """Change (K, 3) of the states with a change of the free values (f,)."""
    rest = -(reduced[..., -1] + reduced[..., :-1] @ values)
    states, _ = scipy.linalg.lapack.dtbtrs(factor, rest.reshape(-1, 1), uplo="L", trans="T")
    return states.reshape(-1, 3)


def _solved(information: Array, right: Array) -> Array:
    """The solution of positive definite equations; raises LogError where they aren't, by rounding."""
    if not len(right):
        return right
    try:
        factor = scipy.linalg.cho_factor(information, check_finite=False)
    except np.linalg.LinAlgError as error:
        raise LogError(_HOPELESS) from error
    found = scipy.linalg.cho_solve(factor, right, check_finite=False)
    if not np.isfinite(found).all():
        raise LogError(_HOPELESS)
    return np.asarray(found)


def _by_nodes(found: Residuals) -> list[Array]:
    """Derivatives of the steps (3, ..., K - 1), by the states of the first and of the second node and by parameters."""
    return [np.moveaxis(one, 0, -1) for one in (found.by_first, found.by_second, found.by_values)]


def _bands(first: Array, second: Array, steps: Array) -> Array:
    """Lower bands (K, 3, 6) of the trajectory's part of the Hessian, by n components of the steps.

    `first` and `second` are derivatives (n, 3, K - 1) by the states, `steps` (K - 1, n) the weights.
    """
    weighted = first * steps.T[:, None], second * steps.T[:, None]
    before, below = (np.einsum("cik,cjk->ijk", one, first) for one in weighted)
    after = np.einsum("cik,cjk->ijk", weighted[1], second)
    bands = np.zeros((len(steps) + 1, 3, 6))
    for a in range(3):
        for b in range(3):
            if a >= b:
                bands[:-1, b, a - b] = before[a, b]
                bands[1:, b, a - b] += after[a, b]
            bands[:-1, b, 3 + a - b] = below[a, b]
    return bands


def _of_poses(nodes: Nodes, poses: Array, residual: Array) -> tuple[Array, Array]:
    """Information (K, 3, 3) on the states, half the gradient (K, 3), from poses with weights and residuals (K, 3)."""
    weighted = poses * residual
    if nodes.whitening is None:
        return poses[:, :, None] * np.eye(3), weighted
    white = nodes.whitening
    return np.einsum("kai,ka,kaj->kij", white, poses, white), np.einsum("kai,ka->ki", white, weighted)


def _add(bands: Array, known: Array) -> None:
    """Add information (K, 3, 3) on the states to the bands (K, 3, 6), in place."""
    for a in range(3):
        for b in range(a + 1):
            bands[:, b, a - b] += known[:, a, b]


def _border(first: Array, second: Array, slope: Array, known: Array, steps: Array, yaw: np.ndarray) -> Array:
    """The part (f, K, 3) of the Hessian between parameters and states."""
    border = np.zeros((slope.shape[1], *known.shape[:2]))
    weighted = slope * steps.T[:, None]
    border[:, :-1] = np.moveaxis(np.einsum("cik,cjk->jik", first, weighted), 1, -1)
    border[:, 1:] += np.moveaxis(np.einsum("cik,cjk->jik", second, weighted), 1, -1)
    border[yaw] += known[:, :, 2]
    return border


def _factor(bands: Array) -> Array:
    """Lower bands (6, 3 K) of the Cholesky factor of a matrix with lower bands (K, 3, 6)."""
    factor, info = scipy.linalg.lapack.dpbtrf(bands.reshape(-1, 6).T, lower=1)
    if info:
        raise LogError(_HOPELESS)
    return np.asarray(factor)
