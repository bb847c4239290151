"""Laws compared on the same data, by the motion that they predict, and what a reader should doubt."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np

from trackslip.identification.first_look import Alarm, Look
from trackslip.identification.fitted import FEWEST_BLOCKS, FittedLaw, Gain, uncertainty
from trackslip.identification.law_fit import REFERENCE, DriveFit, fit_drives
from trackslip.identification.path import EXTRAS, DriveModel
from trackslip.identification.prediction import LEAST_ERROR, PredictionErrors, ranked
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.laws.families import FAMILIES, GAINS, drive_laws
from trackslip.se2 import Mounting

Fit = TypeVar("Fit", bound=FittedLaw)
TODAY = "today"
"""Name of the prediction without identification: dead reckoning without slip."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Laws identified from the same data."""

    laws: Mapping[str, FittedLaw]  # fits by name of the law
    best: str  # the law that predicts motion best; of laws that predict it equally well, the simplest
    warnings: tuple[str, ...]  # remarks on the fits, one line each
    reason: str  # why `best` is the best, in one sentence
    expressible: str | None
    """The best of the laws that a differential drive's odometry can express, chosen likewise; None if there is none."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws, the best first."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class DriveComparison(Comparison):
    """Laws identified from drives, and compared by predictions of driving that they were not fitted to."""

    drives: tuple[PreparedDrive, ...]  # the drives, as used
    look: Look  # what the drives show before any law is fitted
    laws: Mapping[str, DriveFit]  # fits by name of the law
    errors: Mapping[str, Mapping[float, PredictionErrors]]
    """Errors by horizon [s] of held-out predictions, and before them of TODAY and GAINS."""
    score: Mapping[str, float]
    """Mean over the horizons of a law's mean error relative to the smallest; empty without predictions [-]."""
    alarms: tuple[Alarm, ...]  # reasons not to trust the best law

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws, the best predictions first."""
        return tuple(sorted(self.laws, key=lambda name: (name != self.best, self.score.get(name, 0.0))))


def compare_drives(
    drives: Sequence[PreparedDrive],
    geometry: RobotGeometry,
    look: Look,
    sensor: Mounting | None = None,
    names: Sequence[str] | None = None,
    step: Callable[[float], None] = lambda _: None,
    lag: bool = False,
) -> DriveComparison:
    """Fit laws to drives and predict driving that they were not fitted to; `step(1.0)` is called after each law.

    By default, all families that are made for drives. Raises LogError if no law can be fitted.
    """
    fast = names is not None or turns_fast(np.concatenate([drive.omega for drive in drives]), geometry)
    reference = fit_drives(REFERENCE, drives, geometry, sensor, start=look.gains.start(geometry, look.clock), lag=lag)
    laws, notes = dict[str, DriveFit](), list(look.notes)
    for name in names or drive_laws():
        if names is None and "offset_left" in FAMILIES[name].names and _sits_aside(reference):
            notes.append(f"law {name} isn't fitted: a sensor off the middle looks like unequal ICRs; give --sensor")
        elif fast or not FAMILIES[name].fast:
            laws[name] = fit_drives(name, drives, geometry, sensor, reference=reference, lag=lag)
        step(1.0)
    pairs, missed = reference.pairs, {name: law.missed for name, law in laws.items()}
    place = {} if sensor is None else {"sensor_x": sensor.x, "sensor_y": sensor.y, "sensor_yaw": sensor.yaw}
    two = _gains_fit(look, reference)
    plain = {TODAY: place, GAINS: place | two.values}
    known = {name: pairs.errors(two.fit.model, _of_model(two.fit.model, only)[None]) for name, only in plain.items()}
    errors = {name: pairs.summaries(error) for name, error in {**known, **missed}.items()}
    linear = expressible(laws)
    terms = {name: len(law.values) + 0.5 * (name not in linear) for name, law in laws.items()}
    ranking, among = (ranked({name: missed[name] for name in some}, terms, pairs) for some in (laws, linear))
    best, reason = REFERENCE, "no motion can be predicted: the drives are too short"
    if ranking:
        best, reason = ranking.best, ranking.reason
    if best not in linear and among is not None:
        own = [name for name in laws[best].values if not any(name in law.values for law in linear.values())]
        ends = [laws[best].interval95.get(name, (-np.inf, np.inf)) for name in own]
        if all(low <= 0 <= high for low, high in ends):
            reason = f"{best} predicts best, but its {' and '.join(own)} may be 0; of laws for odometry, {among.reason}"
            best = among.best
    deployed = best if best in linear or among is None else among.best
    alarms = [*look.alarms, *_alarms(laws[best], errors)]
    if "gains" in [alarm.kind for alarm in alarms] and not two.at_limit:
        laws[GAINS] = two
        best = deployed = GAINS
        reason = "gains by regression predict better than every law that was fitted"
    return DriveComparison(
        drives=tuple(drives),
        look=look,
        laws=laws,
        errors=errors,
        score=ranking.score if ranking else {},
        best=best,
        reason=reason,
        expressible=deployed,
        alarms=tuple(alarms),
        warnings=tuple(notes),
    )


def _gains_fit(look: Look, reference: DriveFit) -> DriveFit:
    """The gains of a first look as a law."""
    model, values = reference.fit.model, look.gains.law(reference.fit.model.geometry)
    speed, turn = (gain or Gain(1.0, np.nan, np.nan) for gain in (look.speed, look.turn))
    wide = model.geometry.half_gauge * speed.value / turn.value
    slope = np.array([[wide / speed.value, -wide / turn.value], [1.0, 0.0]])
    covariance = slope @ np.diag([speed.error**2, turn.error**2]) @ slope.T  # of half widths of intervals
    return replace(
        reference,
        name=GAINS,
        law=FAMILIES[GAINS].build(values, model.geometry),
        values=values,
        fit=replace(reference.fit, values=_of_model(model, reference.extras | values)),
        **uncertainty(
            tuple(values), np.array([*values.values()]), covariance / 4, 2.0, model.limits[:2, : len(values)]
        ),
    )


def _of_model(model: DriveModel, known: Mapping[str, float]) -> Array:
    """Values (p,) of a model's parameters by name; 0 where not known."""
    return np.array([known.get(name, 0.0) for name in model.names])


def _sits_aside(fit: DriveFit) -> bool:
    """True if the driving says that the sensor is off the middle, or that the ICRs of both sides differ as much."""
    low, high = fit.interval95.get("sensor_y", (-np.inf, np.inf))
    matters = EXTRAS["sensor_y"].scale
    return low > matters or high < -matters


def _alarms(law: DriveFit, errors: Mapping[str, Mapping[float, PredictionErrors]]) -> list[Alarm]:
    """Reasons not to trust the best law."""
    alarms = [
        Alarm("bound", f"{name} = {law.values[name]:.3g} is at a limit of law {law.name}") for name in law.at_limit
    ]
    if law.blocks < FEWEST_BLOCKS:
        what = f"{law.blocks} independent parts of driving are too few for an interval, which takes {FEWEST_BLOCKS}"
        return [*alarms, Alarm("blocks", f"{what}: drive for a minute or more")]
    for name, kind, others in ((TODAY, "worse", "the robot does today"), (GAINS, "gains", "two gains do")):
        for (ahead, ours), what in product(errors[law.name].items(), ("position", "heading")):
            median, other = (getattr(each, f"{what}_median") for each in (ours, errors[name][ahead]))
            if median is not None and other is not None and median > 1.1 * other + LEAST_ERROR:
                line = f"{ahead:g} s ahead, law {law.name} predicts the {what} worse than {others}: don't use it"
                alarms.append(Alarm(kind, line))
                break
    return alarms


def expressible(laws: Mapping[str, Fit]) -> dict[str, Fit]:
    """The laws that a differential drive's odometry can express."""
    return {name: law for name, law in laws.items() if "ros2_control" in FAMILIES[name].targets}


def turns_fast(omega: Array, geometry: RobotGeometry) -> bool:
    """True if sprocket speeds (n, 2) [rad/s] often demand a lateral acceleration by which slip may show: 0.5 m/s²."""
    v, w = body_twist(omega, 0.0, geometry).T
    return bool(np.mean(np.abs(v * w) > 0.5) > 0.05)
