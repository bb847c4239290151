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
from typing import Final

import numpy as np
import scipy.optimize
import scipy.stats

from sim.calibration.candidate import OF_SENSOR, PARAMETERS, Candidate
from sim.calibration.targets import Target
from sim.runs.loop import Progress
from trackslip.errors import InvalidValueError, require, require_one_of
from trackslip.intervals import newton_steps
from trackslip.kinematics import Array

_STEP: Final = 0.05  # step for finite differences [standard deviations of the prior]
_ITERATIONS: Final = 15  # largest number of linear models
_CONVERGED: Final = 0.05  # gain in log-likelihood at which their iteration stops
_ROUNDS: Final = 10  # largest number of fits of a linear model
_SAME: Final = 0.01  # relative change in the errors' sizes at which these fits stop
_PARTS: Final = (1.0, 0.5, 0.2)  # parts of a step that are tried in turn
_CACHED_ERRORS: Final = 64  # number of candidates with cached errors
# standard error, relative to the prior's standard deviation, above which a parameter is vague
_VAGUE: Final = 0.7
_SIGNIFICANT: Final = 2.0  # value, relative to its standard error, above which it isn't vague
# cosine between error slopes of parameters above which the target can't distinguish the parameters
_INDISTINCT: Final = 0.95
_MAD: Final = 1.4826  # ratio of standard deviation to median magnitude for normal errors
# scale of the loss [standard deviations], at 95 % of least squares' efficiency for normal errors
_CAUCHY: Final = 2.385
_LEAST_CURVED: Final = 0.1  # smallest curvature of the loss, relative to the weights
_CONFIDENCE: Final = 0.975  # quantile at the upper end of a 95 % interval


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
        require_one_of("free", name, PARAMETERS)
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
        self.target = target
        self.names = names
        self._base = base
        self._layout = target.layout
        limits = [PARAMETERS[name].limits(base) for name in names]
        self.low, self.high = np.array(limits).T
        # the errors may have no slope at a prior's centre that is on a bound
        inside = min(0.5, *self.high)
        self.first = np.where(self.low == 0, inside, 0.0)
        # sensor parameters first: they reuse the motion that was simulated for the last errors
        self._order = sorted(range(len(names)), key=lambda k: names[k] not in OF_SENSOR)

        @lru_cache(_CACHED_ERRORS)
        def known(*scaled: float) -> Array:
            return target.errors(self.candidate(scaled))

        self._known = known

    def candidate(self, scaled: Iterable[float]) -> Candidate:
        """The candidate with the scaled parameters (p,)."""
        values = {}
        for name, distance in zip(self.names, scaled, strict=True):
            if distance:
                values[name] = PARAMETERS[name].unscaled(self._base, float(distance))
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
            has_room = scaled[k] + _STEP <= self.high[k]
            moved = scaled.copy()
            moved[k] += _STEP if has_room else -_STEP
            slope[:, k] = (self.errors(moved) - errors) / (moved[k] - scaled[k])
        return slope

    def sizes(self, errors: Array) -> Array:
        """Standard deviations (kinds,) of the errors by kind, allowing for the fitted
        parameters.
        """
        layout = self._layout
        sizes = layout.floor.copy()
        for kind in range(len(sizes)):
            rows = layout.kind == kind
            size = np.abs(errors[rows])
            share = layout.share[rows]
            sigma = _median(size, share) * _MAD if layout.robust else self._rms(size, share)
            sizes[kind] = max(sizes[kind], sigma)
        return sizes

    def _rms(self, size: Array, share: Array) -> float:
        """Root mean square of errors (m,) with weights `share` (m,), which a part of the fitted
        parameters has made smaller.
        """
        fitted_part = len(self.names) / self._layout.share.sum()
        degrees_of_freedom = max(share.sum() * (1 - fitted_part), 1.0)
        return float(np.sqrt(share @ size**2 / degrees_of_freedom))

    def loss(self, square: Array, share: Array) -> Array:
        """Loss and its first and second derivatives, (3, n), for squared errors over their
        variances (n,).

        With the squared error s, Cauchy's loss is c^2 log(1 + s / c^2).
        """
        if not self._layout.robust:
            return share * np.stack([square, np.ones_like(square), np.zeros_like(square)])
        fall = 1 / (1 + square / _CAUCHY**2)
        loss = -(_CAUCHY**2) * np.log(fall)
        bend = -(fall**2) / _CAUCHY**2
        return share * np.stack([loss, fall, bend])

    def cost(self, scaled: Array) -> tuple[float, Array]:
        """Negative log-likelihood, up to a constant, and standard deviations (kinds,) of the
        errors.
        """
        errors = self.errors(scaled)
        share = self._layout.share
        sigma = self.sizes(errors)
        size = sigma[self._layout.kind]
        loss = self.loss((errors / size) ** 2, share)[0].sum()
        prior = scaled @ scaled
        return float(share @ np.log(size) + (loss + prior) / 2), sigma

    def minimum(self) -> _End:
        """Find the minimum with successive models of the errors that are linear in the parameters.

        A model needs one simulation per parameter. Least squares on simulated errors would need
        four times as many.
        """
        scaled = self.first
        cost, sigma = self.cost(scaled)
        for _ in range(_ITERATIONS):
            start = scaled
            before = cost
            slope = self.slope(start)
            step = self._linear_minimum(start, slope, sigma) - start
            for part in _PARTS:
                trial = start + part * step
                trial_cost, trial_sigma = self.cost(trial)
                if trial_cost < cost:
                    scaled = trial
                    cost = trial_cost
                    sigma = trial_sigma
                    break
            if before - cost < _CONVERGED:
                break
        return _End(scaled, self.errors(scaled), slope, sigma, cost)

    def _linear_minimum(self, start: Array, slope: Array, sigma: Array) -> Array:
        """Parameters (p,) with the least loss for errors with this slope, fitted in turns with the
        errors' sizes.

        The residuals are the errors over their sizes, and the parameters themselves, for the
        priors, whose loss is plain least squares.
        """
        first = self.errors(start)
        count = len(start)
        scaled = start

        def linear_errors(at: Array) -> Array:
            return np.asarray(first + slope @ (at - start))

        def loss(square: Array) -> Array:
            of_errors = self.loss(square[:-count], self._layout.share)
            of_priors = [square[-count:], np.ones(count), np.zeros(count)]
            return np.hstack([of_errors, of_priors])

        for _ in range(_ROUNDS):
            size = sigma[self._layout.kind]
            jacobian = np.vstack([slope / size[:, None], np.eye(count)])

            def residuals(at: Array, size: Array = size) -> Array:
                return np.append(linear_errors(at) / size, at)

            fit = scipy.optimize.least_squares(
                residuals,
                scaled,
                jac=lambda at, jacobian=jacobian: jacobian,
                bounds=(self.low, self.high),
                method="dogbox",
                loss=loss,
            )
            scaled = fit.x
            before = sigma
            sigma = self.sizes(linear_errors(scaled))
            if np.allclose(sigma, before, rtol=_SAME, atol=0.0):
                break
        return np.asarray(scaled)

    def without(self, end: _End, label: np.ndarray) -> Array:
        """Changes (G, p) in the parameters if the errors with each label, 0 to G - 1, are left out.

        The changes are from one step of Newton's method. Errors with negative labels (n,) are never
        left out.
        """
        hessian, gradient = self._normal(end)
        labelled = label >= 0
        labels = label.max() + 1
        own_hessian = np.zeros((labels, *hessian.shape[1:]))
        own_gradient = np.zeros((labels, *gradient.shape[1:]))
        np.add.at(own_hessian, label[labelled], hessian[labelled])
        np.add.at(own_gradient, label[labelled], gradient[labelled])
        full_hessian = hessian.sum(axis=0) + np.eye(len(self.names))  # with the priors
        return newton_steps(full_hessian - own_hessian, own_gradient)

    def _normal(self, end: _End) -> tuple[Array, Array]:
        """Contributions of each error to the normal equations (n, p, p) and to the loss gradient
        (n, p).

        The curvature of the loss is averaged over each kind of errors: that of a single large error
        is negative.
        """
        layout = self._layout
        size = end.sigma[layout.kind]
        unit = end.errors / size
        slope = end.slope / size[:, None]
        _, weight, bend = self.loss(unit**2, layout.share)
        curved = np.bincount(layout.kind, weight + 2 * bend * unit**2)
        relative = np.maximum(curved / np.bincount(layout.kind, weight), _LEAST_CURVED)

        curvature = weight * relative[layout.kind]
        hessian = curvature[:, None, None] * slope[:, :, None] * slope[:, None]
        gradient = slope * (weight * unit)[:, None]
        return hessian, gradient

    def covariance(self, end: _End) -> Array:
        """Covariance (p, p) of the scaled parameters."""
        hessian, _ = self._normal(end)
        inverse = np.linalg.inv(hessian.sum(axis=0) + np.eye(len(self.names)))
        if not self._layout.robust:
            return inverse
        apart = self.without(end, self._layout.cluster)
        of_clusters = apart.T @ apart
        of_priors = inverse @ inverse
        return np.asarray(of_clusters + of_priors)

    def vague(self, end: _End, spread: Array) -> dict[str, str]:
        """Reasons why the target doesn't determine some parameters, by name; `spread` (p,): their
        standard errors.
        """
        weight = np.sqrt(self._layout.share)[:, None]
        slope = end.slope * weight / end.sigma[self._layout.kind, None]
        strength = np.linalg.norm(slope, axis=0)
        is_similar = np.abs(slope.T @ slope) > _INDISTINCT * np.outer(strength, strength)
        is_significant = np.abs(end.scaled) >= _SIGNIFICANT * spread
        reasons = {}
        for k in np.flatnonzero((spread > _VAGUE) & ~is_significant):
            others = [name for j, name in enumerate(self.names) if j != k and is_similar[j, k]]
            is_mixed = strength[k] >= 1 and others
            what = f"distinguish it from {' and '.join(others)}" if is_mixed else "determine it"
            reasons[self.names[k]] = f"the target does not {what}"
        return reasons

    def described(self, end: _End) -> Calibration:
        """The calibration that results from a minimum."""
        covariance = self.covariance(end)
        spread = np.sqrt(np.diag(covariance))
        candidate = self.candidate(end.scaled)
        matrix = covariance / np.outer(spread, spread)
        return Calibration(
            candidate=candidate,
            estimates=self._estimates(end, candidate, spread),
            correlation=self._correlations(matrix),
            cost=end.cost,
            metrics=self.target.metrics(self.target.errors(candidate)),
            before=self.target.metrics(self.target.errors(self._base)),
        )

    def _estimates(self, end: _End, candidate: Candidate, spread: Array) -> dict[str, Estimate]:
        """The fitted parameters, by name, with standard errors `spread` (p,) of the scaled ones."""
        layout = self._layout
        vague = self.vague(end, spread)
        count = layout.clusters if layout.robust else layout.share.sum()
        degrees_of_freedom = max(count - len(self.names), 1)
        reach = float(scipy.stats.t.ppf(_CONFIDENCE, degrees_of_freedom))
        estimates = {}
        for k, name in enumerate(self.names):
            parameter = PARAMETERS[name]
            value = parameter.read(candidate)
            unit = value if parameter.relative else parameter.size(self._base)
            ends = end.scaled[k] + np.array([-reach, reach]) * spread[k]
            low, high = np.clip(ends, self.low[k], self.high[k])
            estimates[name] = Estimate(
                value=value,
                unit=parameter.unit,
                stderr=float(parameter.spread * unit * spread[k]),
                low=parameter.unscaled(self._base, float(low)),
                high=parameter.unscaled(self._base, float(high)),
                vague=vague.get(name, ""),
            )
        return estimates

    def _correlations(self, matrix: Array) -> dict[str, dict[str, float]]:
        """Correlations of each parameter with the others, by name, from their matrix (p, p)."""
        correlations = {}
        for name, row in zip(self.names, matrix.tolist(), strict=True):
            by_name = dict(zip(self.names, row, strict=True))
            del by_name[name]
            correlations[name] = by_name
        return correlations


def _median(size: Array, share: Array) -> float:
    """Median of errors (m,) with weights `share` (m,)."""
    order = np.argsort(size)
    middle = np.searchsorted(np.cumsum(share[order]), share.sum() / 2)
    return float(size[order[middle]])


def _with_folds(
    fit: Calibration, problem: _Problem, end: _End, folds: np.ndarray, progress: Progress
) -> Calibration:
    """The calibration with predictions for each fold, from a candidate fitted to the other
    folds.
    """
    target = problem.target
    unfitted = problem.errors(np.zeros(len(problem.names)))
    errors = np.full(len(end.errors), np.nan)
    before = np.full(len(end.errors), np.nan)
    scaled = np.clip(end.scaled + problem.without(end, folds), problem.low, problem.high)
    candidates = []
    for fold in np.unique(folds[folds >= 0]):
        out = folds == fold
        candidate = problem.candidate(scaled[fold])
        candidates.append(candidate)
        errors[out] = target.errors(candidate)[out]
        before[out] = unfitted[out]
        progress(1)
    return replace(
        fit,
        folds=tuple(candidates),
        held_out=target.metrics(errors),
        held_out_before=target.metrics(before),
    )
