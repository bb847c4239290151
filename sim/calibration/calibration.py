"""Calibration: parameters of the simulated robot, fitted with priors and a robust loss to data from
a robot.

MuJoCo's own `mujoco.sysid` fits numbers in an MjSpec to sensor trajectories. In this module,
candidates also differ in ground, drive and clock, errors refer to motions over a few seconds, and
some errors may be very large.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy.optimize
import scipy.stats

from sim.calibration.candidate import OF_SENSOR, PARAMETERS, Candidate
from sim.calibration.targets import Target
from sim.runs.loop import Progress
from trackslip.errors import InvalidValueError, require
from trackslip.intervals import newton_steps
from trackslip.kinematics import Array

_STEP = 0.05  # step for finite differences [standard deviations of the prior]
# largest number of iterations; gain in log-likelihood at which they stop
_ITERATIONS, _CONVERGED = 15, 0.05
# largest number of successive fits; relative change in the errors' sizes at which they stop
_ROUNDS, _SAME = 10, 0.01
_KEPT = 64  # number of candidates with cached errors
# standard error over the prior's standard deviation; value over its standard error
_VAGUE, _SIGNIFICANT = 0.7, 2.0
# cosine between error slopes of parameters above which the target can't distinguish the parameters
_ALIKE = 0.95
_MAD = 1.4826  # ratio of standard deviation to median magnitude for normal errors
# scale of the loss [standard deviations], at 95 % of least squares' efficiency for normal errors
_CAUCHY = 2.385
_LEAST_CURVED = 0.1  # smallest curvature of the loss, relative to the weights


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    value: float
    unit: str
    stderr: float  # standard error of the value
    low: float  # lower end of the 95 % confidence interval
    high: float  # upper end of that interval
    vague: str = ""  # reason why the prior, not the target, determines the parameter


@dataclass(frozen=True)
class Calibration:
    """The candidate that fits a target best, with its errors."""

    candidate: Candidate
    estimates: dict[str, Estimate]  # estimates of the free parameters, by name
    # correlations between the errors of the parameters [-]
    correlation: dict[str, dict[str, float]]
    cost: float  # half the minimised loss plus the logarithms of the errors' sizes
    metrics: dict[str, float]  # errors of the fitted candidate
    before: dict[str, float]  # errors of the base candidate
    folds: tuple[Candidate, ...] = ()  # candidates that were each fitted without one fold
    held_out: dict[str, float] | None = None  # errors of `folds`, each in the fold left out
    # errors of the base candidate in the same folds
    held_out_before: dict[str, float] | None = None


def calibrate(
    target: Target,
    base: Candidate,
    free: Sequence[str],
    folds: np.ndarray | None = None,
    progress: Progress = lambda fits: None,
) -> Calibration:
    """Fit parameters of a candidate to a target.

    This is a least-squares fit, with Cauchy's loss if the target is robust, and with normal priors
    around the values of `base`. Parameters that the target doesn't determine stay close to their
    priors and keep the priors' uncertainty. Standard errors are from fits without each cluster
    (jackknife) if the target is robust, otherwise from residuals.

    Args:
        target: data on the robot's motion.
        base: candidate at which the fit starts; it also has the values of parameters that aren't
            free.
        free: names of the parameters to fit, from `PARAMETERS`; raises InvalidValueError for names
            that are unknown, repeated or redundant, and for more parameters than the target allows.
        folds: label (n,) of each error's fold; a candidate fitted to the other folds predicts the
            errors in a fold. Errors with negative labels are never predicted.
        progress: called with 1 after the fit and after each fold.
    """
    problem = _Problem(target, base, _checked(free, target))
    best = problem.minimum()
    progress(1)
    fit = problem.described(best)
    return fit if folds is None else _with_folds(fit, problem, best, folds, progress)


def _checked(free: Sequence[str], target: Target) -> tuple[str, ...]:
    for name in free:
        require(name in PARAMETERS, "free", name, f"one of {', '.join(PARAMETERS)}")
        require(list(free).count(name) == 1, "free", name, "named once")
    same = {"radius_left", "radius_right"} & set(free)
    if "radius_error" in free and same:
        allowed = "either radius_error, of both sides, or radius_left and radius_right"
        raise InvalidValueError("free", list(free), allowed)
    most = int(target.layout.share.sum() + 0.5) - 1
    require(0 < len(free) <= most, "free", list(free), f"one to {most} parameters for this target")
    return tuple(free)


@dataclass(frozen=True)
class _End:
    """The result of a minimisation."""

    scaled: Array  # (p,) parameters
    errors: Array  # (n,) errors at these parameters
    slope: Array  # (n, p) derivatives of the errors
    sigma: Array  # (kinds,) standard deviations of the errors
    cost: float


class _Problem:
    """The loss as a function of p parameters, each scaled by the standard deviation of its
    prior.
    """

    def __init__(self, target: Target, base: Candidate, names: tuple[str, ...]) -> None:
        self.target, self._base, self.names = target, base, names
        self._layout = target.layout
        limits = [PARAMETERS[name].limits(base) for name in names]
        self.low, self.high = np.array(limits).T
        # the errors may have no slope at a prior's centre that is on a bound
        self.first = np.where(self.low == 0, min(0.5, *self.high), 0.0)
        # sensor parameters first: they reuse the motion that was simulated for the last errors
        self._order = sorted(range(len(names)), key=lambda k: names[k] not in OF_SENSOR)
        self._known = lru_cache(_KEPT)(lambda *scaled: target.errors(self.candidate(scaled)))

    def candidate(self, scaled: Iterable[float]) -> Candidate:
        """The candidate with the scaled parameters (p,)."""
        values = {
            n: PARAMETERS[n].unscaled(self._base, float(z))
            for n, z in zip(self.names, scaled, strict=True)
            if z
        }
        return self._base.with_values(values)

    def errors(self, scaled: Array) -> Array:
        """Errors (n,) of the candidate with the scaled parameters (p,)."""
        return self._known(*scaled.tolist())

    def slope(self, scaled: Array) -> Array:
        """Derivatives (n, p) of the errors with respect to the scaled parameters (p,), from finite
        differences.
        """
        errors = self.errors(scaled)
        slope = np.empty((len(errors), len(scaled)))
        for k in self._order:
            moved = scaled.copy()
            moved[k] += _STEP if scaled[k] + _STEP <= self.high[k] else -_STEP
            slope[:, k] = (self.errors(moved) - errors) / (moved[k] - scaled[k])
        return slope

    def sizes(self, errors: Array) -> Array:
        """Standard deviations (kinds,) of the errors by kind, allowing for the fitted
        parameters.
        """
        layout, sizes = self._layout, self._layout.floor.copy()
        for kind in range(len(sizes)):
            rows = layout.kind == kind
            size, share = np.abs(errors[rows]), layout.share[rows]
            if layout.robust:
                order = np.argsort(size)
                middle = np.searchsorted(np.cumsum(share[order]), share.sum() / 2)
                sigma = _MAD * size[order[middle]]
            else:
                sigma = np.sqrt(
                    share
                    @ size**2
                    / max(share.sum() * (1 - len(self.names) / layout.share.sum()), 1.0)
                )
            sizes[kind] = max(sizes[kind], sigma)
        return sizes

    def loss(self, square: Array, share: Array) -> Array:
        """Loss and its first and second derivatives, (3, n), for squared errors over their
        variances (n,).
        """
        if not self._layout.robust:
            return share * np.stack([square, np.ones_like(square), np.zeros_like(square)])
        fall = 1 / (1 + square / _CAUCHY**2)
        return share * np.stack([-(_CAUCHY**2) * np.log(fall), fall, -(fall**2) / _CAUCHY**2])

    def cost(self, scaled: Array) -> tuple[float, Array]:
        """Negative log-likelihood, up to a constant, and standard deviations (kinds,) of the
        errors.
        """
        errors, share = self.errors(scaled), self._layout.share
        sigma = self.sizes(errors)
        size = sigma[self._layout.kind]
        loss = self.loss((errors / size) ** 2, share)[0].sum() + scaled @ scaled
        return float(share @ np.log(size) + loss / 2), sigma

    def minimum(self) -> _End:
        """Find the minimum with successive models of the errors that are linear in the parameters.

        A model needs one simulation per parameter. Least squares on simulated errors would need
        four times as many.
        """
        scaled, (cost, sigma) = self.first, self.cost(self.first)
        for _ in range(_ITERATIONS):
            start, slope, before = scaled, self.slope(scaled), cost
            step = self._linear_minimum(start, slope, sigma) - start
            for part in (1.0, 0.5, 0.2):
                trial = start + part * step
                trial_cost, trial_sigma = self.cost(trial)
                if trial_cost < cost:
                    scaled, cost, sigma = trial, trial_cost, trial_sigma
                    break
            if before - cost < _CONVERGED:
                break
        return _End(scaled, self.errors(scaled), slope, sigma, cost)

    def _linear_minimum(self, start: Array, slope: Array, sigma: Array) -> Array:
        """Parameters (p,) with the least loss for errors with this slope, fitted in turns with the
        errors' sizes.
        """
        first, scaled, count = self.errors(start), start, len(start)
        prior = np.ones(count)

        def loss(square: Array) -> Array:
            of_errors = self.loss(square[:-count], self._layout.share)
            return np.hstack([of_errors, [square[-count:], prior, 0 * prior]])

        for _ in range(_ROUNDS):
            size = sigma[self._layout.kind]
            jacobian = np.vstack([slope / size[:, None], np.eye(count)])
            scaled = scipy.optimize.least_squares(
                lambda at, size=size: np.append((first + slope @ (at - start)) / size, at),
                scaled,
                lambda _, jacobian=jacobian: jacobian,
                (self.low, self.high),
                "dogbox",
                loss=loss,
            ).x
            before, sigma = sigma, self.sizes(first + slope @ (scaled - start))
            if np.allclose(sigma, before, rtol=_SAME, atol=0.0):
                break
        return np.asarray(scaled)

    def without(self, end: _End, label: np.ndarray) -> Array:
        """Changes (G, p) in the parameters if the errors with each label, 0 to G - 1, are left out.

        The changes are from one step of Newton's method. Errors with negative labels (n,) are never
        left out.
        """
        hessian, gradient, rows = *self._normal(end), label >= 0
        own = np.zeros((label.max() + 1, *hessian.shape[1:]))
        push = np.zeros(own.shape[:2])
        np.add.at(own, label[rows], hessian[rows])
        np.add.at(push, label[rows], gradient[rows])
        return newton_steps(hessian.sum(axis=0) + np.eye(len(self.names)) - own, push)

    def _normal(self, end: _End) -> tuple[Array, Array]:
        """Contributions of each error to the normal equations (n, p, p) and to the loss gradient
        (n, p).
        """
        layout = self._layout
        size = end.sigma[layout.kind]
        unit, slope = end.errors / size, end.slope / size[:, None]
        _, weight, bend = self.loss(unit**2, layout.share)
        curved = np.bincount(layout.kind, weight + 2 * bend * unit**2) / np.bincount(
            layout.kind, weight
        )
        # of the loss, averaged over each kind
        curvature = weight * np.maximum(curved, _LEAST_CURVED)[layout.kind]
        return curvature[:, None, None] * slope[:, :, None] * slope[:, None], slope * (
            weight * unit
        )[:, None]

    def covariance(self, end: _End) -> Array:
        """Covariance (p, p) of the scaled parameters."""
        inverse = np.linalg.inv(self._normal(end)[0].sum(axis=0) + np.eye(len(self.names)))
        if not self._layout.robust:
            return inverse
        apart = self.without(end, self._layout.cluster)
        return np.asarray(apart.T @ apart + inverse @ inverse)  # parts from clusters and priors

    def vague(self, end: _End, spread: Array) -> dict[str, str]:
        """Reasons why the target doesn't determine some parameters, by name; `spread` (p,): their
        standard errors.
        """
        slope = (
            end.slope * np.sqrt(self._layout.share)[:, None] / end.sigma[self._layout.kind, None]
        )
        strength = np.linalg.norm(slope, axis=0)
        alike = np.abs(slope.T @ slope) > _ALIKE * np.outer(strength, strength)
        reasons = {}
        for k in np.flatnonzero((spread > _VAGUE) & (np.abs(end.scaled) < _SIGNIFICANT * spread)):
            others = [name for j, name in enumerate(self.names) if j != k and alike[j, k]]
            mixed = strength[k] >= 1 and others
            what = f"distinguish it from {' and '.join(others)}" if mixed else "determine it"
            reasons[self.names[k]] = f"the target does not {what}"
        return reasons

    def described(self, end: _End) -> Calibration:
        """The calibration that results from a minimum."""
        target, base = self.target, self._base
        covariance = self.covariance(end)
        spread = np.sqrt(np.diag(covariance))
        vague = self.vague(end, spread)
        count = self._layout.clusters if self._layout.robust else self._layout.share.sum()
        reach = float(scipy.stats.t.ppf(0.975, max(count - len(self.names), 1)))
        estimates = {}
        for k, name in enumerate(self.names):
            parameter, sd = PARAMETERS[name], spread[k]
            value = parameter.read(self.candidate(end.scaled))
            width = parameter.spread * (value if parameter.relative else parameter.size(base)) * sd
            ends_z = np.clip(
                end.scaled[k] + np.array([-reach, reach]) * sd, self.low[k], self.high[k]
            )
            low, high = (parameter.unscaled(base, float(z)) for z in ends_z)
            estimates[name] = Estimate(
                value, parameter.unit, float(width), low, high, vague.get(name, "")
            )
        matrix = (covariance / np.outer(spread, spread)).tolist()
        correlation = {
            name: {
                other: value for other, value in zip(self.names, row, strict=True) if other != name
            }
            for name, row in zip(self.names, matrix, strict=True)
        }
        candidate = self.candidate(end.scaled)
        after, before = (target.metrics(target.errors(each)) for each in (candidate, base))
        return Calibration(candidate, estimates, correlation, end.cost, after, before)


def _with_folds(
    fit: Calibration, problem: _Problem, end: _End, folds: np.ndarray, progress: Progress
) -> Calibration:
    """The calibration with predictions for each fold, from a candidate fitted to the other
    folds.
    """
    target = problem.target
    errors, before = np.full(len(end.errors), np.nan), np.full(len(end.errors), np.nan)
    first, candidates = problem.errors(np.zeros(len(problem.names))), []
    scaled = np.clip(end.scaled + problem.without(end, folds), problem.low, problem.high)
    for fold in np.unique(folds[folds >= 0]):
        out = folds == fold
        candidates.append(problem.candidate(scaled[fold]))
        errors[out], before[out] = target.errors(candidates[-1])[out], first[out]
        progress(1)
    return replace(
        fit,
        folds=tuple(candidates),
        held_out=target.metrics(errors),
        held_out_before=target.metrics(before),
    )
