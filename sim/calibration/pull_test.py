"""Pull tests on soft soil: cohesion, angle of friction and shear modulus from pulls at slips.

The pull of a robot straight ahead at the slip i is `drawbar_curve`. The soil's sinkage, which makes
up the resistance, is taken as known. At one slip, the soil's strength over the contact is

    A c + N tan(phi)                                                                             (1)

with the area A and the load N, so that one weight tells this sum, but neither of its parts: it
takes two weights to tell c from phi. The shear modulus follows from how the pull grows with the
slip.

Parameters are fitted by least squares without priors to errors in pull over weight, which are taken
to be alike and independent. Intervals are Student's, from the residuals and the slope of the errors
at the best fit; that of the shear modulus is symmetric in its logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.optimize
import scipy.stats

from sim.calibration.calibration import Calibration, Estimate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Compared, Layout
from sim.ground.ground import Ground
from trackslip.errors import InvalidValueError, require, require_one_of
from trackslip.kinematics import Array
from trackslip.metrics import rms
from trackslip.skid_theory import Soil, Tracks, drawbar_curve
from trackslip.skid_theory.soil import MAX_ANGLE, MAX_COHESION, MAX_SHEAR

STRENGTH: Final = "strength"
"""Shear strength under the mean pressure, c + p tan(phi), where its parts can't be told apart."""
_GRAVITY: Final = 9.81  # [m/s^2]
_SAME_WEIGHT: Final = 1e-3  # relative difference up to which weights are the same [-]
_LEAST_ANGLE: Final = math.radians(0.1)  # of friction; a ground has some friction [rad]
_HARDLY: Final = math.radians(1.0)  # angle of friction of soil with hardly any [rad]
_LEAST_SHEAR: Final = 1e-4  # shear modulus [m]
_CONFIDENCE: Final = 0.975  # quantile at the upper end of a 95 % interval
_ALIKE: Final = 0.95  # correlation of errors above which parameters aren't told apart [-]


@dataclass(frozen=True)
class _Parameter:
    """A number of a soil that can be fitted, as a value u that the pull is smooth in."""

    unit: str
    low: float  # least value
    high: float  # largest value
    read: Callable[[Soil], float]
    write: Callable[[Soil, float], Soil]
    # half-width of the interval of u, under a strength [Pa], from which on it says nothing
    vague: Callable[[float], float]
    is_log: bool = False  # whether u is the logarithm of the value

    def inner(self, value: float) -> float:
        """The value as u."""
        return math.log(value) if self.is_log else value

    def outer(self, u: float) -> float:
        """The value of u, within its limits."""
        if self.is_log:
            u = math.exp(min(u, 100.0))
        return min(max(u, self.low), self.high)


SOIL_PARAMETERS: Final = {
    "cohesion": _Parameter(
        "Pa",
        0.0,
        MAX_COHESION,
        lambda soil: soil.cohesion,
        lambda soil, value: replace(soil, cohesion=value),
        vague=lambda strength: strength,
    ),
    "friction_angle": _Parameter(
        "rad",
        _LEAST_ANGLE,
        MAX_ANGLE,
        lambda soil: soil.friction_angle,
        lambda soil, value: replace(soil, friction_angle=value),
        vague=lambda strength: math.radians(20.0),
    ),
    "shear": _Parameter(
        "m",
        _LEAST_SHEAR,
        MAX_SHEAR,
        lambda soil: soil.shear,
        lambda soil, value: replace(soil, shear=value),
        vague=lambda strength: math.log(3.0),
        is_log=True,
    ),
}
"""Parameters that a pull test can tell, by name."""
_SUM: Final = ("cohesion", "friction_angle")


@dataclass(frozen=True)
class PullTest:
    """Pulls (n,) of a robot straight ahead on level soft soil: a target for a calibration."""

    slip: Array  # (n,) 1 - speed over ground / speed of the belts [-]
    pull: Array  # (n,) at the hitch, backwards on the robot [N]
    weight: Array  # (n,) weight of the robot with its load [N]
    hitch_height: float  # above the ground [m]

    @cached_property
    def layout(self) -> Layout:
        """Structure of the errors: all of one kind, and independent."""
        count = len(self.slip)
        return Layout(
            kind=np.zeros(count, int),
            share=np.ones(count),
            cluster=np.arange(count),
            floor=np.full(1, 1e-9),
            robust=False,
        )

    @property
    def has_one_weight(self) -> bool:
        """Whether all rows have the same weight."""
        return float(np.ptp(self.weight)) <= _SAME_WEIGHT * float(self.weight.min())

    def predicted(self, candidate: Candidate) -> Array:
        """Pulls (n,) of a candidate at the slips, by theory; NaN where it tips over [N]."""
        soil = soil_of(candidate)
        robot = candidate.robot
        pulls = np.empty_like(self.slip)
        for weight in np.unique(self.weight).tolist():
            rows = self.weight == weight
            tracks = Tracks(
                length=robot.contact_length,
                width=robot.track_width,
                weight=weight,
                com_x=robot.com_x,
                com_height=robot.com_height,
            )
            curve = drawbar_curve(soil, tracks, self.slip[rows], hitch_height=self.hitch_height)
            pulls[rows] = curve.pull
        return pulls

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) in pull over weight [-]; a robot that tips over pulls nothing."""
        return (np.nan_to_num(self.predicted(candidate)) - self.pull) / self.weight

    def metrics(self, errors: Array) -> dict[str, float]:
        """RMS error in pull over weight [-]."""
        return {"pull": rms(errors)}

    def compared(self, errors: Array) -> list[Compared]:
        """The pulls [N]."""
        return [Compared("pull", "N", self.pull, self.pull + errors * self.weight)]


def soil_of(candidate: Candidate) -> Soil:
    """The soil under a candidate, which must be soft."""
    soil = candidate.ground.soil
    assert soil is not None
    return soil


def on_soil(candidate: Candidate, soil: Soil) -> Candidate:
    """A candidate on another soil."""
    return replace(candidate, ground=Ground(soil=soil))


def _strength(soil: Soil, pressure: float) -> float:
    return soil.cohesion + pressure * math.tan(soil.friction_angle)


def _of_strength(pressure: float, base: Soil) -> _Parameter:
    """The strength under a pressure [Pa] as a parameter, of which cohesion and friction keep the
    shares that they have in the soil `base`.
    """
    first = _strength(base, pressure)
    friction = math.tan(base.friction_angle)

    def write(soil: Soil, value: float) -> Soil:
        scale = value / first
        angle = math.atan(scale * friction)
        return replace(soil, cohesion=scale * base.cohesion, friction_angle=angle)

    return _Parameter(
        "Pa",
        first * math.tan(_LEAST_ANGLE) / friction,
        first * math.tan(MAX_ANGLE) / friction,
        lambda soil: _strength(soil, pressure),
        write,
        vague=lambda strength: strength,
    )


def fit_pulls(test: PullTest, base: Candidate, free: Sequence[str]) -> Calibration:
    """Fit the soil under a candidate to a pull test.

    Args:
        test: pulls at slips; more rows than parameters.
        base: robot and soil at which the fit starts, with the values that aren't free.
        free: names of SOIL_PARAMETERS. Where cohesion and friction_angle are both free but all rows
            have one weight, the strength is fitted in their place, and both are vague.

    Raises InvalidValueError for other names and too few rows.
    """
    for name in free:
        require_one_of("free", name, SOIL_PARAMETERS)
        require(list(free).count(name) == 1, "free", name, "named once")
    rows = len(test.slip)
    allowed = f"one to {rows - 1} parameters for {rows} pulls"
    require(0 < len(free) < rows, "free", list(free), allowed)
    if set(_SUM) <= set(free) and test.has_one_weight:
        return _fit_strength(test, base, free)
    parameters = {name: SOIL_PARAMETERS[name] for name in free}
    return _fit(test, base, parameters)


def _fit_strength(test: PullTest, base: Candidate, free: Sequence[str]) -> Calibration:
    """Fit the strength in place of its parts, which have the shares of the soil under `base`.

    On a robot that tilts, cohesion acts elsewhere than friction, so that pulls depend a little on
    the shares. Intervals therefore cover those of soil with hardly any friction and without
    cohesion.
    """
    soil = soil_of(base)
    pressure = _pressure(test, base)
    strength = _strength(soil, pressure)
    others = {name: SOIL_PARAMETERS[name] for name in free if name not in _SUM}
    sticky = replace(soil, cohesion=strength, friction_angle=_HARDLY)
    loose = replace(soil, cohesion=0.0, friction_angle=math.atan(strength / pressure))
    fits = []
    for shared in (soil, sticky, loose):
        parameters = {STRENGTH: _of_strength(pressure, shared), **others}
        fits.append(_fit(test, on_soil(base, shared), parameters))
    fit = fits[0]
    estimates = {}
    for name, estimate in fit.estimates.items():
        low = min(other.estimates[name].low for other in fits)
        high = max(other.estimates[name].high for other in fits)
        estimates[name] = replace(estimate, low=low, high=high)

    reason = (
        f"all rows have one weight, which tells only the strength, cohesion + {pressure:.4g} Pa "
        "tan(friction_angle): give rows of another weight, or fit one of both"
    )
    for name in _SUM:
        parameter = SOIL_PARAMETERS[name]
        value = parameter.read(soil_of(fit.candidate))
        estimates[name] = Estimate(value, parameter.unit, math.inf, math.nan, math.nan, reason)
    return replace(fit, estimates=estimates, before=test.metrics(test.errors(base)))


def _pressure(test: PullTest, base: Candidate) -> float:
    """Mean pressure under the robot in all rows [Pa]."""
    robot = base.robot
    return float(test.weight.mean()) / (2 * robot.contact_length * robot.track_width)


def _fit(test: PullTest, base: Candidate, parameters: Mapping[str, _Parameter]) -> Calibration:
    """Fit parameters of the soil under `base` by least squares."""
    soil = soil_of(base)

    def candidate_at(u: Array) -> Candidate:
        changed = soil
        for parameter, value in zip(parameters.values(), u.tolist(), strict=True):
            changed = parameter.write(changed, parameter.outer(value))
        return on_soil(base, changed)

    fit = _least_squares(lambda u: test.errors(candidate_at(u)), list(parameters.values()), soil)
    best = candidate_at(fit.x)
    spread, correlation = _spread(fit.jac, fit.fun)
    degrees_of_freedom = len(test.slip) - len(parameters)
    reach = float(scipy.stats.t.ppf(_CONFIDENCE, degrees_of_freedom)) * spread
    strength = _strength(soil_of(best), _pressure(test, base))
    names = list(parameters)
    estimates = {}
    for k, (name, parameter) in enumerate(parameters.items()):
        value = parameter.read(soil_of(best))
        is_alike = np.abs(correlation[k]) > _ALIKE
        alike = [names[j] for j in np.flatnonzero(is_alike) if j != k]
        vague = ""
        if not reach[k] <= parameter.vague(strength):
            what = f"distinguish it from {' and '.join(alike)}" if alike else "determine it"
            vague = f"the pulls do not {what}"
        estimates[name] = Estimate(
            value=value,
            unit=parameter.unit,
            stderr=float(spread[k] * (value if parameter.is_log else 1.0)),
            low=parameter.outer(fit.x[k] - reach[k]),
            high=parameter.outer(fit.x[k] + reach[k]),
            vague=vague,
        )
    known = [name for name, estimate in estimates.items() if not estimate.vague]
    return Calibration(
        candidate=_named(best, soil, known),
        estimates=estimates,
        correlation=_by_name(names, correlation),
        cost=float(fit.cost),
        metrics=test.metrics(fit.fun),
        before=test.metrics(test.errors(base)),
    )


def _least_squares(
    errors: Callable[[Array], Array], parameters: Sequence[_Parameter], soil: Soil
) -> scipy.optimize.OptimizeResult:
    """The least squares of errors (n,) of the parameters' values u (p,), from those of a soil."""
    low = np.array([p.inner(p.low) for p in parameters])
    high = np.array([p.inner(p.high) for p in parameters])
    first = np.array([p.inner(min(max(p.read(soil), p.low), p.high)) for p in parameters])
    # a start on a limit is moved inside
    room = 1e-6 * (high - low)
    first = np.clip(first, low + room, high - room)
    return scipy.optimize.least_squares(
        errors, first, bounds=(low, high), x_scale="jac", xtol=1e-8, ftol=1e-10, diff_step=1e-4
    )


def _spread(slope: Array, errors: Array) -> tuple[Array, Array]:
    """Standard errors (p,) of parameters, infinite if undetermined, and their correlations (p, p),
    from the slope (n, p) of the errors (n,).
    """
    rows, count = slope.shape
    size = np.linalg.norm(slope, axis=0)
    safe = np.where(size > 0, size, 1.0)
    variance = float(errors @ errors) / (rows - count)
    # of parameters that are scaled to slopes of length 1
    inverse = np.linalg.pinv((slope / safe).T @ (slope / safe), rcond=1e-12, hermitian=True)
    scaled = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    spread = np.where(size > 0, np.sqrt(variance) * scaled / safe, np.inf)
    correlation = inverse / np.outer(np.maximum(scaled, 1e-300), np.maximum(scaled, 1e-300))
    return spread, correlation


def _named(candidate: Candidate, base: Soil, known: Sequence[str]) -> Candidate:
    """A candidate whose soil says where its values are from; `known` are those that the pulls
    determine.
    """
    source = f"{base.source or 'given values'}, fitted to pulls"
    assumed = tuple(name for name in base.assumed if name not in known)
    return on_soil(candidate, replace(soil_of(candidate), source=source, assumed=assumed))


def _by_name(names: Sequence[str], matrix: Array) -> dict[str, dict[str, float]]:
    """Correlations of each parameter with the others, by name, from their matrix (p, p)."""
    correlations = {}
    for name, row in zip(names, matrix.tolist(), strict=True):
        by_name = dict(zip(names, row, strict=True))
        del by_name[name]
        correlations[name] = by_name
    return correlations


def weight_of(candidate: Candidate) -> float:
    """Weight of a candidate's robot [N]."""
    return candidate.robot.mass * _GRAVITY


def require_soft(candidate: Candidate, free: Sequence[str]) -> None:
    """Raise InvalidValueError for parameters of soil that firm ground doesn't have."""
    for name in free:
        if name in _SUM and candidate.ground.soil is None:
            allowed = "left out on firm ground: --ground dry_sand, or another soil, has it"
            raise InvalidValueError("free", name, allowed)
