"""Laws fitted to steady runs and compared: values, errors, scatter between runs, errors at left-out
radii.

The measured twist of a run is random; its sprocket speeds are known. A law predicts the twist from
these speeds. So slip and radius, both functions of the measured twist with correlated errors, need
not be treated separately. A run's residual is the measured minus the predicted speed V of each
track, (2,) [m/s]. The residual's covariance is

    C = B P B^T + tau^2 s^2 I,    s = r max |omega|

P is the covariance of the measured twist, B maps twists to track speeds, s is the belt speed of the
faster sprocket, and tau is the relative scatter of track speeds besides measurement errors, from
effects outside the law (uneven ground, speed, a wrong form of the law). These act on the whole
robot, so that tau is the same for slow and fast sprockets.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, least_squares
from scipy.special import stdtrit

from trackslip.errors import LogError, counted
from trackslip.identification.answer import radii_differ
from trackslip.identification.comparison import (
    LEAST_ERROR,
    MACHINED,
    REFERENCE,
    Choice,
    Comparison,
    Criterion,
    FittedLaw,
    Uncertainty,
    choose,
    different_curvatures,
    few_curvatures,
    nearest_curvatures,
    ranked,
    turns_fast,
)
from trackslip.identification.samples import REPEATED, SlipSamples
from trackslip.intervals import FEWEST_BLOCKS, cr3, newton_steps
from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, LawFamily, Parameter, family
from trackslip.laws.icr import DiffDrive
from trackslip.metrics import rms
from trackslip.viewable import ShortRepr

# least error of a run relative to the faster sprocket: for samples computed from a law, with
# rounding
_EXACT: Final = 1e-9
# condition number of normal equations above which parameters are interchangeable (test_steady)
_SINGULAR: Final = 1e7
_FOLDS: Final = 10  # largest number of folds in a cross-validation (Kohavi, 1995)
# least standard error of an undetermined parameter, in units of `LawFamily.limits` scales
# (test_steady)
_VAGUE: Final = 5.0
# sine of the angle from straight driving, or from turning in place, up to which runs count as such
_STRAIGHT: Final = 0.05


@dataclass(frozen=True, kw_only=True, repr=False)
class SteadyFit(FittedLaw):
    """A law fitted to steady samples, with Student's t intervals."""

    rms: float
    """Root mean square error of predicted track speeds, relative to the belt speed of the faster
    sprocket [-].
    """
    scatter: float
    """Scatter tau of track speeds besides measurement errors, relative to the belt speed of the
    faster sprocket [-].
    """
    fit: Fit  # the complete fit


def fit_law(name: str, samples: SlipSamples, geometry: RobotGeometry) -> SteadyFit:
    """Fit a law to measured motions by weighted least squares, with intervals.

    `geometry` is the robot's nominal geometry. Of `icr_radius` and `diff_drive`, the parameters
    that the motions leave open are held at 0, so that the others can be fitted: D if all runs are
    straight, ε if all are turns in place.

    Raises LogError if the samples do not determine every other parameter, InvalidValueError for an
    unknown law.
    """
    model = family(name)
    if name == DIFF_DRIVE:
        # a sensor beside the middle may look like unequal radii
        with suppress(LogError):
            return _fitted(model, _with_sensor(model), samples, geometry)
    try:
        return _fitted(model, model, samples, geometry)
    except LogError:
        held = _left_open(name, samples, geometry)
        if not held:
            raise
    free = model.holding(dict.fromkeys(held, 0.0))
    return replace(_fitted(model, free, samples, geometry), held=held)


def _fitted(
    model: LawFamily, free: LawFamily, samples: SlipSamples, geometry: RobotGeometry
) -> SteadyFit:
    """Fit a law of the family `model` in the form `free`, which has other parameters, too, or holds
    some at 0.
    """
    name = next(name for name, each in FAMILIES.items() if each is model)
    names = free.names
    if 2 * len(samples) <= len(names):
        raise LogError(
            f"law {name}: {counted(len(samples), 'sample')} of two tracks can't determine its "
            f"{len(names)} parameters"
        )
    fit = Fit.of(free.under(samples.load), samples, geometry)
    covariance = fit.covariance
    if doubt := fit.undetermined(np.sqrt(np.diag(covariance))):
        raise LogError(f"law {name}: {doubt}")
    if "radius_error" in model.names and "radius_error" not in names:
        covariance = covariance + _error_of_nominal_radius(fit)
    fitted = dict(zip(names, fit.values.tolist(), strict=True))
    values = {key: fitted.get(key, 0.0) for key in model.names}
    limits = free.limits(geometry.half_gauge)[:2]
    quantile = np.full(len(names), stdtrit(fit.freedom, 0.975))
    errors = Uncertainty.of(names, fit.values, covariance, quantile, limits)
    return SteadyFit(
        name=name,
        law=model.build(values, geometry),
        values=values,
        rms=rms(samples.relative_errors(fit.predicted(fit.values), geometry)),
        scatter=fit.scatter,
        fit=fit,
        stderr=errors.stderr,
        interval95=errors.interval95,
        correlation=errors.correlation,
    )


def _error_of_nominal_radius(fit: Fit) -> Array:
    """Covariance (p, p) that a radius error held at 0 adds to the other parameters.

    Turns in place determine (b + D) / (1 + ε) alone. So an ε of standard deviation MACHINED adds
    MACHINED (b + D) to the standard error of D.
    """
    at_offset = fit.family.names.index("offset")
    half_width = fit.geometry.half_gauge + fit.values[at_offset]
    covariance = np.zeros((len(fit.values), len(fit.values)))
    covariance[at_offset, at_offset] = (MACHINED * half_width) ** 2
    return covariance


def _left_open(name: str, samples: SlipSamples, geometry: RobotGeometry) -> dict[str, str]:
    """Parameters of `icr_radius` or `diff_drive` that the motions leave open, with the reasons;
    empty if these are no reasons.
    """
    angle = samples.direction(geometry)
    if not np.any(np.abs(np.sin(angle)) > _STRAIGHT) and name in (REFERENCE, DIFF_DRIVE):
        return {"offset": "no run turns"}
    if not np.any(np.abs(np.cos(angle)) > _STRAIGHT) and name == REFERENCE:
        return {"radius_error": "all runs turn in place"}
    return {}


@dataclass(frozen=True)
class _SeenFromTheSide(DiffDrive):
    """A differential drive whose speed is measured by a sensor beside the middle of the tracks."""

    sensor_y: float = 0.0
    """Distance of the sensor to the left [m]."""

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) of the sensor at sprocket speeds omega (..., 2) [rad/s]."""
        v, w = np.moveaxis(super().twist(omega, geometry), -1, 0)
        return np.stack([v - np.asarray(self.sensor_y) * w, w], axis=-1)


def _with_sensor(model: LawFamily) -> LawFamily:
    """The family of differential drives with the parameter sensor_y."""
    aside = Parameter((0.0,), -10.0, 10.0, 0.1, "m", "Y", "distance of the sensor to the left")

    def build(values: Mapping[str, Any], geometry: RobotGeometry) -> SlipLaw:
        return _SeenFromTheSide(**values, half_gauge=geometry.half_gauge)

    return replace(model, parameters={**model.parameters, "sensor_y": aside}, build=build)


@dataclass(frozen=True, repr=False)
class Fit(ShortRepr):
    """A law family fitted to steady runs, along two axes on which a run's errors in track speed are
    independent.
    """

    family: LawFamily
    samples: SlipSamples
    geometry: RobotGeometry
    # (n, 2, 2) maps from twists to the axes, relative to the belt speed of the faster sprocket
    axes: Array
    measurement: Array  # (n, 2) variances of the measurement errors along the axes
    values: Array  # (p,) values of the law's parameters
    scatter: float  # tau [-]

    @classmethod
    def of(cls, family: LawFamily, samples: SlipSamples, geometry: RobotGeometry) -> Fit:
        """Fit values and scatter alternately; the first fits try all start values and treat all
        errors as scatter.
        """
        speed = geometry.sprocket_radius * np.abs(samples.omega).max(axis=1)
        to_tracks = (
            np.column_stack([np.ones(2), TRACK_SIGNS * geometry.half_gauge]) / speed[:, None, None]
        )
        known = np.zeros((len(samples), 2, 2)) if samples.covariance is None else samples.covariance
        measurement, vectors = np.linalg.eigh(to_tracks @ known @ to_tracks.swapaxes(1, 2))
        axes, measurement = vectors.swapaxes(1, 2) @ to_tracks, np.maximum(measurement, _EXACT**2)
        starts = (
            cls(family, samples, geometry, axes, measurement, x, 1.0)
            for x in family.starts(geometry.half_gauge)
        )
        fit = min(
            (start.minimum() for start in starts),
            key=lambda fit: np.sum(fit.missed**2 / fit.variance),
        )
        for _ in range(10):  # 2 or 3 suffice if the samples determine the law
            scatter = fit.expected_scatter()
            if abs(scatter - fit.scatter) <= 1e-4 * scatter:
                break
            fit = replace(fit, scatter=scatter).minimum()
        return fit

    @property
    def variance(self) -> Array:
        """Variances (n, 2) of the residuals along the axes."""
        return self.measurement + self.scatter**2

    @cached_property
    def missed(self) -> Array:
        """Residuals (n, 2) along the axes."""
        return self._missed(self.values)

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom."""
        return self.missed.size - len(self.values)

    def predicted(self, values: Array) -> Array:
        """Twists (n, 2) that the law predicts for the runs with values (p,), or with values (n, p)
        for each run.
        """
        twist = self.family.law(values, self.geometry).twist(self.samples.omega, self.geometry)
        return np.broadcast_to(twist, self.samples.twist.shape)  # for laws without parameters, too

    def _missed(self, values: Array) -> Array:
        return np.einsum("nij,nj->ni", self.axes, self.samples.twist - self.predicted(values))

    def _slopes(self, values: Array) -> Array:
        """Derivatives (n, 2, p) of the law's predictions along the axes by its parameters."""
        return (
            self.axes @ self.family.twist_slopes(values[None], self.samples.omega, self.geometry)[0]
        )

    def minimum(self) -> Fit:
        """The fit with the least chi-square at the current scatter, starting from the current
        values.
        """
        if not self.family.names:
            return self
        low, high, scale = self.family.limits(self.geometry.half_gauge)
        error = np.sqrt(self.variance)

        def residual(values: Array) -> Array:
            return np.nan_to_num(
                self._missed(values) / error, nan=1e8, posinf=1e8, neginf=-1e8
            ).ravel()

        def jacobian(values: Array) -> Array:
            return -(self._slopes(values) / error[..., None]).reshape(-1, len(values))

        result = least_squares(
            residual, self.values, jacobian, (low, high), "dogbox", x_scale=scale, max_nfev=50
        )
        return replace(self, values=result.x)

    def expected_scatter(self) -> float:
        """Scatter tau at which chi-square equals its expectation, after Paule and Mandel (1982).

        It is 0 if measurement errors alone explain chi-square.
        """

        def excess(log_tau: float) -> float:
            return (
                float(np.sum(self.missed**2 / (self.measurement + np.exp(2 * log_tau))))
                - self.freedom
            )

        low, high = np.log(_EXACT), np.log(1 + np.sqrt(np.sum(self.missed**2)))
        return float(np.exp(brentq(excess, low, high))) if excess(low) > 0 else 0.0

    @cached_property
    def _normal(self) -> tuple[Array, Array]:
        """Normal equations (n, p, p) and right-hand sides (n, p) of the runs."""
        slope = self._slopes(self.values)
        weighted = (slope / self.variance[..., None]).swapaxes(1, 2)
        return weighted @ slope, (weighted @ self.missed[..., None])[..., 0]

    def without(self, labels: np.ndarray) -> Array:
        """Values (G, p) without the runs of each of G labels (n,), by one Newton step from the
        fit.
        """
        out = (labels == np.arange(labels.max() + 1)[:, None]).astype(float)  # (G, n)
        normal, pull = self._normal
        rest = np.einsum("gn,npq->gpq", 1 - out, normal)
        low, high, _ = self.family.limits(self.geometry.half_gauge)
        return np.clip(self.values - newton_steps(rest, out @ pull), low, high)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (p, p) of the values; infinite if parameters are interchangeable.

        Runs with the same command may share effects outside the law. So standard errors are at
        least those from leaving out one command at a time (CR3, as in `windows`), or one run at a
        time if there are few commands.
        """
        normal = self._normal[0].sum(axis=0)
        unit = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled = normal * np.outer(unit, unit)
        if len(unit) and not np.linalg.cond(scaled) < _SINGULAR:
            return np.full(normal.shape, np.inf)
        covariance = np.linalg.inv(scaled) * np.outer(unit, unit)
        labels = self.samples.by_command(self.geometry)
        if labels.max() + 1 < FEWEST_BLOCKS:
            labels = np.arange(len(labels))
        variance = np.diag(cr3(self.without(labels) - self.values))
        # 1 if there are too few labels
        wider = np.sqrt(np.fmax(1.0, variance / np.diag(covariance)))
        return covariance * np.outer(wider, wider)

    def left_out(self) -> Array | None:
        """Twists (n, 2) of runs, predicted by fits without runs at the same radius; None if too few
        runs remain.

        With fewer than three radii, single runs or tenths of all runs are left out instead.
        """
        radii = self.samples.by_command(self.geometry)
        labels = folds(radii if radii.max() >= 2 else np.arange(len(radii)))
        if 2 * (len(labels) - np.bincount(labels).max()) <= len(self.values):
            return None
        return self.predicted(self.without(labels)[labels])

    def undetermined(self, error: Array) -> str:
        """A message on a parameter that the samples don't determine, judged by standard errors
        (p,); empty if none.
        """
        limits = self.family.limits(self.geometry.half_gauge)
        for key, value, spread, low, high, scale in zip(
            self.family.names, self.values, error, *limits, strict=True
        ):
            if value not in (low, high) and spread < max(_VAGUE * scale, abs(value) / 2):
                continue
            is_one_radius = self.samples.by_command(self.geometry).max() == 0
            if is_one_radius:
                why = "it takes runs of different radii"
            elif value in (low, high):
                why = f"its best value, {value:.3g}, is at a limit"
            elif np.isinf(spread):
                why = "other parameters can stand in for it"
            else:
                why = f"it is {value:.3g} with a standard error of {spread:.2g}"
            many = len(self.samples) > 1
            samples = f"the {len(self.samples)} samples don't" if many else "one sample doesn't"
            return f"{samples} determine {key}: {why}"
        return ""


def folds(labels: np.ndarray) -> np.ndarray:
    """Fold indices (n,) for a cross-validation from group `labels` (n,); if there are many,
    neighbours are joined.
    """
    size = np.bincount(labels)
    if len(size) <= _FOLDS:
        return labels
    fold = (np.cumsum(size) - size) * _FOLDS // len(labels)
    return np.unique(fold[labels], return_inverse=True)[1]


@dataclass(frozen=True)
class CrossValidation:
    """Rms errors of a law's predictions for runs at left-out radii."""

    slip: float  # rms error of track speeds, relative to the belt speed of the faster sprocket [-]
    linear_speed: float  # rms error [m/s]
    yaw_rate: float  # rms error [rad/s]

    @classmethod
    def of(
        cls, twist: Array | None, samples: SlipSamples, geometry: RobotGeometry
    ) -> CrossValidation | None:
        """Errors of twists (n, 2) that were predicted by fits without each run's radius; None if
        `twist` is None.
        """
        if twist is None:
            return None
        v, w = (rms(column) for column in (twist - samples.twist).T)
        return cls(rms(samples.relative_errors(twist, geometry)), v, w)


@dataclass(frozen=True, kw_only=True, repr=False)
class SteadyComparison(Comparison):
    """Laws identified from steady samples and compared at left-out radii."""

    samples: SlipSamples  # the samples that the laws were fitted to
    laws: Mapping[str, SteadyFit]  # fits by law name
    validation: Mapping[str, CrossValidation | None]  # cross-validation by law name


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> SteadyComparison:
    """Fit and compare laws of all families that the samples determine.

    Raises LogError if the samples determine no law but `none`.
    """
    if len(samples) < 2 and samples.covariance is None:
        raise LogError(
            "one sample doesn't show its own error: take 4 or more, straight ahead and in turns to "
            "both sides"
        )
    # laws of all families that the samples may determine
    laws = dict[str, SteadyFit]()
    unfitted = dict[str, str]()  # why not, by law
    sides = np.sign(np.diff(samples.omega, axis=1)[:, 0] * samples.omega.sum(axis=1))
    is_one_sided = min((sides > 0).sum(), (sides < 0).sum()) < 2
    is_unloaded = samples.load is None or np.ptp(samples.load) < 1e-3
    is_slow = not turns_fast(samples.omega, geometry)
    for name, model in FAMILIES.items():
        is_impossible = (
            (model.two_sided and is_one_sided)
            or (model.loaded and is_unloaded)
            or (model.fast and is_slow)
        )
        if is_impossible or not model.of_runs:
            continue
        try:
            laws[name] = fit_law(name, samples, geometry)
        except LogError as error:
            unfitted[name] = str(error)

    answer = _answer(laws, samples, geometry)
    if answer is None:
        raise LogError(unfitted["icr"])

    # the best law, unless the curvatures are too few to tell laws apart
    predicted = {name: law.fit.left_out() for name, law in laws.items()}
    directions = samples.direction(geometry)
    curvatures = different_curvatures(directions, nearest_curvatures(directions, REPEATED))
    # over different loads, laws with and without slip under load can be compared all the same
    uncompared = few_curvatures(curvatures, "the samples have") if is_unloaded else ""
    choice = None if uncompared else choose(laws, lambda some: _ranked(some, predicted))
    if choice is None:
        why = uncompared or "the runs are too few to compare laws"
        choice = Choice(best=answer.name, reason=why, score={})
    laws[answer.name] = answer
    predicted[answer.name] = answer.fit.left_out()
    order = sorted(
        laws, key=lambda name: (name != choice.best, choice.score.get(name, np.inf), laws[name].rms)
    )
    return SteadyComparison(
        best=choice.best,
        reason=choice.reason,
        score=choice.score,
        expressible=answer.name,
        samples=samples,
        laws={name: laws[name] for name in order},
        validation={
            name: CrossValidation.of(twist, samples, geometry) for name, twist in predicted.items()
        },
        # where laws aren't compared, only the law of the answer is missed
        warnings=tuple(
            why for name, why in unfitted.items() if not uncompared or name == REFERENCE
        ),
    )


def _answer(
    laws: Mapping[str, SteadyFit], samples: SlipSamples, geometry: RobotGeometry
) -> SteadyFit | None:
    """The law of a differential drive that gives the answer: `diff_drive`, or REFERENCE if the
    radii don't differ.

    From turns to one side alone, a D that varies with the radius looks like unequal radii. If the
    samples determine neither law, the answer is `icr`; None if they don't determine that, either.
    """
    turn = np.sin(samples.direction(geometry))
    if np.any(np.abs(turn) <= _STRAIGHT) or turn.min() < 0 < turn.max():
        with suppress(LogError):
            sides = fit_law(DIFF_DRIVE, samples, geometry)
            if radii_differ(sides):
                return sides
    return laws.get(REFERENCE, laws.get("icr"))


def _ranked(laws: Mapping[str, SteadyFit], predicted: Mapping[str, Array | None]) -> Choice | None:
    """Choose the simplest law that predicts left-out radii as well as any other law; None for too
    few runs.

    A run's error is the mean square of its relative errors in track speed, weighted by the run's
    inverse variance.
    """
    fit = next(iter(laws.values())).fit
    samples, scatter = fit.samples, max(LEAST_ERROR, min(law.scatter for law in laws.values()))
    weight = 1 / (fit.measurement.mean(axis=1) + scatter**2)
    errors = {
        name: weight
        / weight.mean()
        * np.mean(samples.relative_errors(twist, fit.geometry) ** 2, axis=1)
        for name in laws
        if (twist := predicted[name]) is not None
    }
    if len(samples) < FEWEST_BLOCKS:
        return None
    # repeats of a command share effects outside the laws
    command = samples.by_command(fit.geometry)
    criteria = [Criterion(errors, command, LEAST_ERROR**2)] if errors else []
    choice = ranked({name: laws[name] for name in errors}, criteria)
    why = (
        "the simplest of the laws that predict left-out radii as well as any, within one "
        "standard error"
    )
    return choice and replace(choice, reason=why)
