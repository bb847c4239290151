"""Weighted fits of a family of laws, with covariance and scatter, to many sets of runs at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackslip.identification.solver import CONVERGED, ITERATIONS, Minimum, least_squares
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array
from trackslip.laws.base import SlipLaw
from trackslip.laws.derivatives import twist_derivatives
from trackslip.laws.families import LawFamily

_FIRST_SCATTER = 0.003  # initial guess of the scatter of slip [-]
_ROUNDS = 8  # maximum number of alternating fits and scatter estimates
_SETTLED = 1e-4  # relative change of the scatter at convergence
_ROUGHLY = 1e-6  # tolerance of fits with the initial guess


@dataclass(frozen=True)
class Fits:
    """A family fitted to M sets of runs."""

    family: LawFamily
    runs: WeightedRuns
    values: Array  # (M, p)
    scatter: Array  # (M,) tau, scatter of slip beyond the measurement errors [-]
    cost: Array  # (M,) chi-square
    hessian: Array  # (M, p, p) of half of it, from the slopes of the twists

    @cached_property
    def law(self) -> SlipLaw:
        """The M laws, with parameters (M, 1)."""
        return self.family.law(self.values[:, None, :], self.runs.geometry)

    @cached_property
    def twist(self) -> Array:
        """Twists (M, n, 2), or (n, 2) if they have no parameters, that the laws predict."""
        return self.law.twist(self.runs.omega, self.runs.geometry)

    @cached_property
    def deviation(self) -> Array:
        """Residuals (M, n, 2) along the eigenvectors, relative to the speed of the faster sprocket."""
        return self.runs.missed(self.twist)

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return 2 * self.runs.runs - self.values.shape[1]

    @cached_property
    def covariance(self) -> Array:
        """Covariances (M, p, p) of the values: the inverse of the Hessian, scaled beforehand; infinite if singular."""
        root = np.sqrt(np.maximum(np.einsum("mii->mi", self.hessian), 1e-300))
        scaled = self.hessian / root[:, :, None] / root[:, None, :]
        regular = np.linalg.cond(scaled) < 1e14 if scaled.shape[1] else np.ones(len(scaled), bool)
        result = np.full(scaled.shape, np.inf)
        result[regular] = np.linalg.inv(scaled[regular])
        return result / root[:, :, None] / root[:, None, :]


def fit(
    family: LawFamily,
    runs: WeightedRuns,
    start: Array | None = None,
    scatter: Array | None = None,
    tolerance: float = CONVERGED,
) -> Fits:
    """Minimise the squared residuals of the runs, in units of their standard deviations (see `weighting`).

    By default, the best of the fits from the family's own starting values is kept, and tau (M,) is estimated,
    alternating with the values. For `tolerance` see `least_squares`.
    """
    family = family.under(runs.load)
    sets = max(len(runs.speeds), len(runs.weight))
    if scatter is not None:
        return _at(family, runs, np.broadcast_to(scatter, (sets,)), start, tolerance)
    found = _at(family, runs, np.full(sets, _FIRST_SCATTER), start, _ROUGHLY)
    for _ in range(_ROUNDS):
        scatter = runs.scatter(found.deviation, found.freedom)
        change = np.abs(scatter - found.scatter) / np.maximum(np.maximum(scatter, found.scatter), 1e-12)
        found = _at(family, runs, scatter, found.values, tolerance)
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
    tolerance: Array | float = CONVERGED,
    iterations: int = ITERATIONS,
) -> Minimum:
    """Solve m problems from `start` (m, p), problem k being a fit to set `sets[k]` of the runs; see `least_squares`."""
    low, high, scale = family.limits(runs.geometry.half_gauge)
    last = np.empty((len(start), *runs.omega.shape))  # twists

    def residual(values: Array, rows: np.ndarray) -> Array:
        chosen = sets[rows]
        last[rows] = family.law(values[:, None, :], runs.geometry).twist(runs.omega, runs.geometry)
        return runs.whiten(runs.missed(last[rows], chosen), scatter[chosen], chosen)

    def jacobian(values: Array, rows: np.ndarray) -> Array:
        chosen = sets[rows]
        slopes = -runs.of_twists @ twist_derivatives(family, values, runs.omega, runs.geometry, last[rows])
        return (slopes * runs.roots(scatter[chosen], chosen)[..., None]).reshape(len(rows), -1, values.shape[1])

    if not family.names:
        cost = np.sum(residual(start, np.arange(len(start))) ** 2, axis=1)
        return Minimum(start, cost, np.zeros((len(start), 0, 0)))
    return least_squares(residual, start, low, high, scale, held, jacobian, tolerance, iterations)


def _at(family: LawFamily, runs: WeightedRuns, scatter: Array, start: Array | None, tolerance: float) -> Fits:
    """The fits at scatters (M,), from `start` or from the best that the starting values of the family reach."""
    sets = np.arange(len(scatter))
    if start is None:
        starts = family.starts(runs.geometry.half_gauge)  # (K, p)
        k = len(starts)
        each = np.tile(starts, (len(sets), 1))
        reached = minimise(family, runs, scatter, each, np.repeat(sets, k), tolerance=tolerance)
        best = reached.cost.reshape(-1, k).argmin(axis=1) + k * sets
        found = Minimum(reached.values[best], reached.cost[best], reached.hessian[best])
    else:
        found = minimise(family, runs, scatter, start, sets, tolerance=tolerance)
    return Fits(family, runs, found.values, scatter, found.cost, found.hessian)
