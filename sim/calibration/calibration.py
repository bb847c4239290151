"""Calibration: parameters of the simulated robot fitted to what a robot did, with priors and a robust loss."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from sim.calibration.candidate import OF_SENSOR, PARAMETERS, Candidate
from sim.calibration.targets import Target
from sim.loop import Progress
from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array

_STEP = 0.05  # of finite differences [standard deviations of the prior]
_ITERATIONS = 25
_CONVERGED = 0.1  # step at which a fit ends [standard errors]
_SLOW = 0.5  # size of a step over that of the last one with which the Jacobian misleads
_VAGUE, _SIGNIFICANT = 0.7, 2.0  # standard error over that of the prior; value over its standard error
_TIED = 0.7  # correlation of parameters that compensate each other
_MAD = 1.4826  # standard deviation of normal errors over the median of their sizes
_CAUCHY = 2.385  # scale of the loss [standard deviations]: 95 % as efficient as least squares for normal errors
_LEAST_CURVED = 0.1  # curvature of the loss over the weights
_MAX_LEVERAGE = 0.8  # of a cluster
_LINEAR = 8  # reweightings of a fit to errors that are linear in the parameters


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    value: float
    unit: str
    stderr: float
    """Standard error; of a parameter that is held, that of its prior."""
    low: float
    """Lower end of the 95 % interval."""
    high: float
    """Its upper end."""
    held: str = ""
    """The reason if the target doesn't tell the parameter, and the fit keeps its first value."""


@dataclass(frozen=True)
class Calibration:
    """The best candidate for a target."""

    candidate: Candidate
    estimates: dict[str, Estimate]
    """Each parameter that was free, by name."""
    correlation: dict[str, dict[str, float]]
    """Correlation of each fitted parameter's error with the others' [-]."""
    cost: float
    """Half the loss that was minimised, and the logarithm of the errors' sizes."""
    metrics: dict[str, float]
    """Errors of the candidate."""
    before: dict[str, float]
    """Errors of the base candidate."""
    folds: tuple[Candidate, ...] = ()
    """The candidates fitted without each fold."""
    held_out: dict[str, float] | None = None
    """Their errors in the folds that they were not fitted to."""
    held_out_before: dict[str, float] | None = None
    """Errors of the base candidate in the same folds."""
    ends: tuple[tuple[Candidate, float], ...] = ()
    """Optimum found from each start, with its cost; the best first."""


def random_starts(free: Sequence[str], count: int, generator: np.random.Generator) -> Array:
    """Further starts (count, p), in standard deviations of the priors."""
    return generator.uniform(-1.5, 1.5, (count, len(free)))


def calibrate(
    target: Target,
    base: Candidate,
    free: Sequence[str],
    folds: np.ndarray | None = None,
    further: Array | None = None,
    progress: Progress = lambda fits: None,
) -> Calibration:
    """Fit parameters of a candidate to a target.

    Robust Gauss-Newton iterations with normal priors around the values of `base`. Parameters that remain as vague as
    their priors, and don't differ from them significantly, are held there. Standard errors are those of clusters (the
    sandwich of Huber and White) where the target is robust, else from the residuals.

    Args:
        target: what the robot did.
        base: the first start, and the values of the other parameters.
        free: names of the parameters to fit, of `PARAMETERS`.
        folds: label (n,) of the fold of each error of the target, which a candidate fitted to the others predicts.
            Those with negative labels are never predicted.
        further: more starts (S, p), see `random_starts`.
        progress: called with 1 after each start, and after each fold.

    Raises:
        InvalidValueError: for names that are unknown, given twice or say the same, and too many for the target.
    """
    names = _checked(free, target)
    problem = _Problem(target, base, names)
    held, ends = dict[str, str](), []
    for start in (problem.first, *(() if further is None else further)):
        ends.append(problem.minimum(np.clip(start, problem.low, problem.high), held))
        progress(1)
    best = min(ends, key=lambda end: end.cost)
    while (vague := problem.vaguest(best, held)) is not None:
        held[vague[0]] = vague[1]
        best = problem.minimum(np.where([name in held for name in names], 0.0, best.scaled), held, best.jacobian)
    ends = sorted(ends, key=lambda end: end.cost)
    found = problem.described(best, held, tuple((problem.candidate(end.scaled), end.cost) for end in ends))
    return found if folds is None else _with_folds(found, problem, best, held, folds, progress)


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
    """Where a fit ended."""

    scaled: Array  # (p,)
    errors: Array  # (n,)
    jacobian: Array  # (n, p)
    sigma: Array  # (kinds,)
    cost: float


class _Problem:
    """The loss as a function of p parameters, in standard deviations of their priors."""

    def __init__(self, target: Target, base: Candidate, names: tuple[str, ...]) -> None:
        self.target, self._base, self.names = target, base, names
        self._layout = target.layout
        limits = [PARAMETERS[name].limits(base) for name in names]
        self.low, self.high = np.array(limits).T
        # a bound that is the prior's centre may have no slope
        self.first = np.where(self.low == 0, min(0.5, *self.high), 0.0)
        self._moves = np.array([name not in OF_SENSOR for name in names])

    def candidate(self, scaled: Array) -> Candidate:
        """The candidate with scaled parameters (p,)."""
        values = {n: PARAMETERS[n].unscaled(self._base, float(z)) for n, z in zip(self.names, scaled, strict=True) if z}
        return self._base.with_values(values)

    def errors(self, scaled: Array) -> Array:
        """Errors (n,) of the target."""
        return self.target.errors(self.candidate(scaled))

    def jacobian(self, scaled: Array, errors: Array, free: np.ndarray) -> Array:
        """Derivatives (n, p) of the errors; 0 where not `free` (p,)."""
        jacobian = np.zeros((len(errors), len(scaled)))
        # those of the sensor first, whose motion is that of the last errors
        for k in sorted(np.flatnonzero(free), key=lambda k: bool(self._moves[k])):
            step = _STEP if scaled[k] + _STEP <= self.high[k] else -_STEP
            jacobian[:, k] = (self.errors(scaled + step * (np.arange(len(scaled)) == k)) - errors) / step
        return jacobian

    def sizes(self, errors: Array, count: int) -> Array:
        """Standard deviation (kinds,) of the errors of each kind, with `count` parameters fitted."""
        layout, found = self._layout, self._layout.floor.copy()
        for kind in range(len(found)):
            rows = layout.kind == kind
            size, share = np.abs(errors[rows]), layout.share[rows]
            if layout.robust:
                order = np.argsort(size)
                middle = np.searchsorted(np.cumsum(share[order]), share.sum() / 2)
                sigma = _MAD * size[order[middle]]
            else:
                sigma = np.sqrt(share @ size**2 / max(share.sum() * (1 - count / layout.share.sum()), 1.0))
            found[kind] = max(found[kind], sigma)
        return found

    def weigh(self, errors: Array, sigma: Array) -> tuple[Array, Array]:
        """Errors over their standard deviations (n,), and their weights (n,)."""
        unit = errors / sigma[self._layout.kind]
        return unit, self._layout.share / (1 + (unit / _CAUCHY) ** 2 if self._layout.robust else 1.0)

    def cost(self, scaled: Array, errors: Array, sigma: Array) -> float:
        """Minus the logarithm of the likelihood, up to a constant, with half the loss of the prior.

        The likelihood is Cauchy's where single errors may be large. Its sizes `sigma` (kinds,) of the errors count, so
        that ends with different ones can be compared: over its own size, each end's errors are about 1.
        """
        square = (errors / sigma[self._layout.kind]) ** 2
        loss = _CAUCHY**2 * np.log1p(square / _CAUCHY**2) if self._layout.robust else square
        return float(self._layout.share @ (loss / 2 + np.log(sigma)[self._layout.kind]) + scaled @ scaled / 2)

    def minimum(self, start: Array, held: Mapping[str, str], known: Array | None = None) -> _End:
        """The minimum that Gauss-Newton iterations reach from `start` (p,).

        The Jacobian (n, p), at first the one that is `known`, is updated by rank one (Broyden 1965), because a step of
        finite differences costs a simulation for each parameter; where steps end or hardly shrink, it is found anew.
        """
        free = np.array([name not in held for name in self.names])
        scaled, errors, before = start, self.errors(start), np.inf
        jacobian, fresh = (self.jacobian(start, errors, free), True) if known is None else (known, False)
        for _ in range(_ITERATIONS):
            sigma = self.sizes(errors, int(free.sum()))
            goal, spread = self._linear_minimum(scaled, errors, jacobian, sigma, free)
            step = goal - scaled
            size = np.max(np.abs(step) / spread, initial=0.0)
            done = size < _CONVERGED or (size > _SLOW * before and not fresh)
            found = None if done else self._descent(scaled, errors, sigma, step)
            if found is None:
                if fresh:
                    break
                jacobian, before = np.where(free, self.jacobian(scaled, errors, free), jacobian), np.inf
                fresh = True
                continue
            before = size
            change, changed = found[0] - scaled, found[1] - errors
            jacobian = jacobian + np.outer(changed - jacobian @ change, change) / (change @ change)
            (scaled, errors), fresh = found, False
        sigma = self.sizes(errors, int(free.sum()))
        return _End(scaled, errors, jacobian, sigma, self.cost(scaled, errors, sigma))

    def _descent(self, scaled: Array, errors: Array, sigma: Array, step: Array) -> tuple[Array, Array] | None:
        """Parameters and errors after a step, or a part of it, that lowers the cost; None if none does."""
        cost = self.cost(scaled, errors, sigma)
        for part in (1.0, 0.5, 0.2):
            trial = np.clip(scaled + part * step, self.low, self.high)
            tried = self.errors(trial)
            if self.cost(trial, tried, sigma) < cost:
                return trial, tried
        return None

    def _linear_minimum(
        self,
        scaled: Array,
        errors: Array,
        jacobian: Array,
        sigma: Array,
        free: np.ndarray,
        rows: np.ndarray | None = None,
    ) -> tuple[Array, Array]:
        """Parameters (p,) of least loss, if errors change linearly from `scaled` (p,), and their standard errors (p,).

        Of the errors, `rows` (n,) bool count alone.
        """
        found, spread = scaled, np.ones_like(scaled)
        for _ in range(_LINEAR):
            unit, weight = self.weigh(errors + jacobian @ (found - scaled), sigma)
            weight = weight if rows is None else weight * rows
            moving = free
            while True:  # parameters at their limits stay there
                slope = jacobian * moving / sigma[self._layout.kind, None]
                matrix = (slope.T * weight) @ slope + np.eye(len(scaled))
                step = -np.linalg.solve(matrix, slope.T @ (weight * unit) + found) * moving
                outwards = ((found <= self.low) & (step < 0)) | ((found >= self.high) & (step > 0))
                if not outwards.any():
                    break
                moving = moving & ~outwards
            found, spread = np.clip(found + step, self.low, self.high), np.sqrt(np.diag(np.linalg.inv(matrix)))
        return found, spread

    def covariance(self, end: _End, held: Mapping[str, str]) -> tuple[Array, Array]:
        """Covariance (p, p) of the scaled parameters, and that of the fitted ones if the held ones were known.

        The held ones may differ from their values as their priors say, and shift the others; the second is as wide as
        the priors where the target tells nothing.
        """
        layout, fitted = self._layout, np.array([name not in held for name in self.names])
        unit, weight = self.weigh(end.errors, end.sigma)
        slope = end.jacobian / end.sigma[layout.kind, None]
        if layout.robust:  # the curvature of the loss, on average over a kind
            square = (unit / _CAUCHY) ** 2
            bent = layout.share * (1 - square) / (1 + square) ** 2
            curved = np.bincount(layout.kind, bent) / np.bincount(layout.kind, weight)
            curvature = weight * np.maximum(curved, _LEAST_CURVED)[layout.kind]
        else:
            curvature = weight
        matrix = (slope.T * curvature) @ slope + np.eye(len(fitted))
        inverse = np.linalg.inv(matrix[np.ix_(fitted, fitted)])
        known = inverse
        if layout.robust:
            part = slope[:, fitted]
            score = np.zeros((layout.clusters, len(inverse)))
            np.add.at(score, layout.cluster, part * (weight * unit)[:, None])
            leverage = np.bincount(layout.cluster, curvature * np.einsum("ni,ij,nj->n", part, inverse, part))
            score /= (1 - np.minimum(leverage, _MAX_LEVERAGE))[:, None]  # as if each cluster had been left out
            known = inverse @ (score.T @ score + np.eye(len(inverse))) @ inverse
        shift = -inverse @ matrix[np.ix_(fitted, ~fitted)]
        covariance, alone = np.eye(len(fitted)), np.eye(len(fitted))
        covariance[np.ix_(fitted, fitted)] = known + shift @ shift.T
        covariance[np.ix_(fitted, ~fitted)], covariance[np.ix_(~fitted, fitted)] = shift, shift.T
        # what little the errors tell may look certain by chance
        wide = np.sqrt(np.maximum(np.diag(inverse) / np.diag(known), 1.0))
        alone[np.ix_(fitted, fitted)] = known * np.outer(wide, wide)
        return covariance, alone

    def vaguest(self, end: _End, held: Mapping[str, str]) -> tuple[str, str] | None:
        """The parameter that the target tells least of those it doesn't tell, and why; None if it tells all."""
        _, covariance = self.covariance(end, held)
        spread = np.sqrt(np.diag(covariance))
        vague = (spread > _VAGUE) & (np.abs(end.scaled) < _SIGNIFICANT * spread)
        vague &= [name not in held for name in self.names]
        if not vague.any():
            return None
        k = int(np.argmax(np.where(vague, spread, 0.0)))
        slope = end.jacobian / end.sigma[self._layout.kind, None]
        strength = np.linalg.norm(slope * np.sqrt(self._layout.share)[:, None], axis=0)
        correlation = covariance[k] / (spread[k] * spread)
        others = [
            name
            for j, name in enumerate(self.names)
            if j != k and name not in held and (abs(correlation[j]) > _TIED or self._alike(slope, k, j))
        ]
        if strength[k] < 1 or not others:
            return self.names[k], "the target does not tell it"
        return self.names[k], f"the target does not tell it from {' and '.join(others)}"

    def _alike(self, slope: Array, k: int, j: int) -> bool:
        """True if two parameters change the errors nearly alike."""
        a, b = (slope[:, i] * np.sqrt(self._layout.share) for i in (k, j))
        return bool(abs(a @ b) > 0.95 * np.linalg.norm(a) * np.linalg.norm(b) > 0)

    def described(self, end: _End, held: Mapping[str, str], ends: tuple[tuple[Candidate, float], ...]) -> Calibration:
        """The result of a fit."""
        target, base = self.target, self._base
        covariance, _ = self.covariance(end, held)
        spread = np.sqrt(np.diag(covariance))
        free = len(self.names) - len(held)
        count = self._layout.clusters if self._layout.robust else self._layout.share.sum()
        reach = float(scipy.stats.t.ppf(0.975, max(count - free, 1)))
        estimates = {}
        for k, name in enumerate(self.names):
            one, sd = PARAMETERS[name], spread[k]
            value = one.read(self.candidate(end.scaled))
            width = one.spread * (value if one.relative else one.size(base)) * sd
            ends_z = np.clip(end.scaled[k] + np.array([-reach, reach]) * sd, self.low[k], self.high[k])
            low, high = (one.unscaled(base, float(z)) for z in ends_z)
            estimates[name] = Estimate(value, one.unit, float(width), low, high, held.get(name, ""))
        known = [k for k, name in enumerate(self.names) if name not in held]
        correlation = {
            self.names[a]: {self.names[b]: float(covariance[a, b] / (spread[a] * spread[b])) for b in known if b != a}
            for a in known
        }
        candidate = self.candidate(end.scaled)
        return Calibration(
            candidate,
            estimates,
            correlation,
            end.cost,
            target.metrics(target.errors(candidate)),
            target.metrics(target.errors(base)),
            ends=ends,
        )

    def without(self, end: _End, rows: np.ndarray, held: Mapping[str, str]) -> Array:
        """Scaled parameters (p,) fitted to the errors `rows` (n,) bool, which are linear in them near `end`."""
        free = np.array([name not in held for name in self.names])
        return self._linear_minimum(end.scaled, end.errors, end.jacobian, end.sigma, free, rows)[0]


def _with_folds(
    found: Calibration, problem: _Problem, end: _End, held: Mapping[str, str], folds: np.ndarray, progress: Progress
) -> Calibration:
    """The result with predictions of each fold by the candidates fitted to the others."""
    target = problem.target
    errors, before = np.full(len(end.errors), np.nan), np.full(len(end.errors), np.nan)
    first, candidates = problem.errors(np.zeros(len(problem.names))), []
    for fold in np.unique(folds[folds >= 0]):
        out = folds == fold
        candidates.append(problem.candidate(problem.without(end, ~out, held)))
        errors[out], before[out] = target.errors(candidates[-1])[out], first[out]
        progress(1)
    return replace(
        found, folds=tuple(candidates), held_out=target.metrics(errors), held_out_before=target.metrics(before)
    )
