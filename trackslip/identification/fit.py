"""Weighted fits of a family of laws: values, covariance, scatter; many sets of runs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.identification.families import LawFamily
from trackslip.identification.solver import Minimum, least_squares
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array
from trackslip.slip import SlipLaw

_FIRST_SCATTER = 0.003  # of slip, before anything is known
_ROUNDS = 8  # of fits and scatters in turn, at most
_SETTLED = 1e-4  # relative change of the scatter


@dataclass(frozen=True)
class Fits:
    """A family fitted to M sets of runs."""

    family: LawFamily
    runs: WeightedRuns
    values: Array  # (M, p)
    scatter: Array  # (M,) tau, of slip beyond measurement [-]
    cost: Array  # (M,) chi-square
    hessian: Array  # (M, p, p) of half of it

    @property
    def law(self) -> SlipLaw:
        """The M laws, with parameters (M, 1)."""
        return self.family.law(self.values[:, None, :], self.runs.geometry)

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return 2 * self.runs.runs - self.values.shape[1]

    @property
    def covariance(self) -> Array:
        """(M, p, p) of the values; infinite where they aren't determined."""
        return inverse(self.hessian)

    @property
    def noise_covariance(self) -> Array:
        """(M, p, p) of what measurement alone adds to the values, the scatter being part of what is measured."""
        runs, count = self.runs, len(self.values)
        scale = self.family.limits(runs.geometry.half_gauge)[2]
        jacobian = np.empty((count, 2 * runs.runs, self.values.shape[1]))
        for k in range(self.values.shape[1]):
            step = np.zeros(self.values.shape[1])
            step[k] = 1e-5 * scale[k]
            ahead, behind = (
                runs.deviation(self.family.law((self.values + sign * step)[:, None, :], runs.geometry))
                for sign in (1, -1)
            )
            jacobian[..., k] = ((ahead - behind) / (2 * step[k])).reshape(count, -1)
        variance = (runs.eigenvalues + self.scatter[:, None, None] ** 2).reshape(count, -1, 1)
        weighted = jacobian * np.repeat(runs.weight, 2, axis=-1)[..., None] / variance
        middle = np.einsum("mki,mkj->mij", weighted * runs.eigenvalues.reshape(1, -1, 1), weighted)
        outside = inverse(np.einsum("mki,mkj->mij", weighted, jacobian))
        return outside @ middle @ outside


def inverse(hessian: Array) -> Array:
    """Inverses (M, p, p) of symmetric matrices, scaled beforehand; infinite where they have none."""
    root = np.sqrt(np.maximum(np.einsum("mii->mi", hessian), 1e-300))
    scaled = hessian / root[:, :, None] / root[:, None, :]
    regular = np.linalg.cond(scaled) < 1e14 if scaled.shape[1] else np.ones(len(scaled), bool)
    result = np.full(hessian.shape, np.inf)
    result[regular] = np.linalg.inv(scaled[regular])
    return result / root[:, :, None] / root[:, None, :]


def fit(family: LawFamily, runs: WeightedRuns, start: Array | None = None, scatter: Array | None = None) -> Fits:
    """Least squares of the runs' residuals in units of their standard deviations, as `weighting` has it.

    Args:
        family: what is fitted.
        runs: M sets.
        start: values (M, p) to start from; by default from each of the family's own, of which the best is kept.
        scatter: tau (M,); by default estimated, in turn with the values.
    """
    sets = max(len(runs.speeds), len(runs.weight))
    if scatter is not None:
        first = np.broadcast_to(scatter, (sets,))
        return _at(family, runs, first, _started(family, runs, first) if start is None else start)
    guess = np.full(sets, _FIRST_SCATTER)
    found = _at(family, runs, guess, _started(family, runs, guess) if start is None else start)
    for _ in range(_ROUNDS):
        scatter = runs.scatter(runs.deviation(found.law), found.freedom)
        change = np.abs(scatter - found.scatter) / np.maximum(np.maximum(scatter, found.scatter), 1e-12)
        found = _at(family, runs, scatter, found.values)
        if change.max(initial=0.0) < _SETTLED:
            break
    return found


def minimise(
    family: LawFamily,
    runs: WeightedRuns,
    scatter: Array,
    start: Array,
    sets: np.ndarray,
    held: np.ndarray | None = None,
) -> Minimum:
    """Least squares of the problems (m,), problem k being set `sets[k]` of the runs, from `start` (m, p)."""
    low, high, scale = family.limits(runs.geometry.half_gauge)

    def residual(values: Array, rows: np.ndarray) -> Array:
        chosen = sets[rows]
        deviation = runs.deviation(family.law(values[:, None, :], runs.geometry), chosen)
        return runs.whiten(deviation, scatter[chosen], chosen)

    if not family.names:
        cost = np.sum(residual(start, np.arange(len(start))) ** 2, axis=1)
        return Minimum(start, cost, np.zeros((len(start), 0, 0)))
    return least_squares(residual, start, low, high, scale, held)


def _at(family: LawFamily, runs: WeightedRuns, scatter: Array, start: Array) -> Fits:
    best = minimise(family, runs, scatter, start, np.arange(len(scatter)))
    return Fits(family, runs, best.values, scatter, best.cost, best.hessian)


def _started(family: LawFamily, runs: WeightedRuns, scatter: Array) -> Array:
    """The best values (M, p) of those reached from each of the family's starts."""
    starts = family.starts(runs.geometry.half_gauge)  # (K, p)
    k, sets = len(starts), len(scatter)
    reached = minimise(family, runs, scatter, np.tile(starts, (sets, 1)), np.repeat(np.arange(sets), k))
    best = reached.cost.reshape(sets, k).argmin(axis=1) + k * np.arange(sets)
    return reached.values[best]
