"""Does one law serve several logs? The values of several identifications side by side, and a test
of a common law against each log's own.

The laws are those of the answer, of a differential drive, so that only their values differ between
logs. A log's common law has the means of the other logs' values, and the log's own law is fitted to
the log without the driving that it predicts. So neither has seen what it predicts, and the ratio of
their mean errors is the cost of one law for all. Its interval follows from the scatter between
blocks of driving:

    r = sum_b c_b / sum_b o_b,    var r = B / (B - 1) sum_b (c_b - r o_b)² / (sum_b o_b)²

with the errors c_b by the common and o_b by the own law in each of B blocks. The intervals cover
all logs together (Bonferroni).

Whether a value differs between logs by more than its intervals, Cochran's Q says (W. G. Cochran,
*The combination of estimates from different experiments*, 1954). With much driving, differences
that nobody notices are significant; with little, a law predicts badly because it is hardly known.
So the common law serves a log if the upper end of the interval is at most NOTICED. It doesn't if r
exceeds NOTICED, the lower end exceeds 1, and a value of the log differs from that of the others.
Otherwise the log can't tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.special import chdtrc, stdtrit

from trackslip.arguments import checks_arguments
from trackslip.errors import LogError, counted, require
from trackslip.identification.answer import SIDES
from trackslip.identification.comparison import LEAST_ERROR
from trackslip.identification.law_fit import DriveFit
from trackslip.identification.prediction import sizes
from trackslip.identification.result import Identification
from trackslip.identification.steady import SteadyFit
from trackslip.intervals import FEWEST_BLOCKS, Gain
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import DIFF_DRIVE, FAMILIES
from trackslip.viewable import Viewable

NOTICED: Final = 1.1
"""Least ratio of mean errors that counts as worse, as for alarms in `drive_comparison`."""
MULTIPLIERS: Final = (
    "wheel_separation_multiplier",
    "left_wheel_radius_multiplier",
    "right_wheel_radius_multiplier",
)
"""The values that are compared."""
_NORMAL: Final = 1.96  # half-width of a 95 % interval of a normal distribution [standard errors]
_CONFIDENCE: Final = 0.95  # of the intervals of all logs together
_AHEAD: Final = 5.0  # horizon of the predictions that are compared, or the nearest one [s]

LOGS_DIFFER: Final = "the logs differ"
"""What stands in place of the interval of a common value that differs beyond chance."""

Verdict = Literal["yes", "no", "can't tell"]


@dataclass(frozen=True)
class Cost:
    """What the law of the other logs costs a log."""

    ratio: Gain
    """Mean error of predictions by the other logs' law over that by the log's own; NaN if
    unknown.
    """
    verdict: Verdict
    """Whether the other logs' law serves the log."""
    reason: str
    """What the predictions are, or why there are none."""


@dataclass(frozen=True)
class LogComparison(Viewable):
    """Identifications of several logs side by side."""

    results: Mapping[str, Identification]
    """The identifications by the logs' names."""
    values: Mapping[str, Mapping[str, Gain]]
    """MULTIPLIERS by log; NaN where the driving doesn't determine a value."""
    common: Mapping[str, Gain]
    """The mean of each multiplier, weighted by precision; NaN if no log has an interval. Both ends
    of its interval are NaN if the multiplier differs between the logs beyond chance.
    """
    chance: Mapping[str, float]
    """The probability of differences as large as those between the logs by chance alone, for each
    multiplier, by Cochran's Q; NaN if fewer than two logs have intervals.
    """
    costs: Mapping[str, Cost]
    """What one law for all costs each log."""

    @property
    def verdict(self) -> Verdict:
        """Whether one law serves all logs."""
        verdicts = [cost.verdict for cost in self.costs.values()]
        if "no" in verdicts:
            return "no"
        return "yes" if set(verdicts) == {"yes"} else "can't tell"

    @property
    def common_law(self) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
        """Parameters of the law `diff_drive` with the `common` multipliers, D [m] and ε, and their
        intervals.
        """
        geometry = next(iter(self.results.values())).geometry
        values, low, high = (
            _law_values({key: gain[end] for key, gain in self.common.items()}, geometry)
            for end in range(3)
        )
        ends = {name: (low[name], high[name]) for name in values}
        return values, {name: end for name, end in ends.items() if np.isfinite(end).all()}

    @property
    def line(self) -> str:
        """The verdict and its evidence in one sentence."""
        if self.verdict == "no":
            worst = max(
                (name for name, cost in self.costs.items() if cost.verdict == "no"),
                key=lambda name: self.costs[name].ratio.value,
            )
            return (
                f"One law doesn't serve all logs: in {worst}, the law of the other logs predicts "
                f"with {ratio_text(self.costs[worst].ratio)} times the error of its own"
            )
        if self.verdict == "yes":
            known = [cost.ratio for cost in self.costs.values()]
            most = max(known, key=lambda ratio: ratio.value)
            return (
                "One law serves all logs: the law of the other logs predicts each log with at most "
                f"{ratio_text(most)} times the error of its own"
            )
        unclear = [name for name, cost in self.costs.items() if cost.verdict == "can't tell"]
        first = self.costs[unclear[0]]
        more = f", and {len(unclear) - 1} more" if len(unclear) > 1 else ""
        return f"Can't tell whether one law serves all logs: {unclear[0]}: {first.reason}{more}"

    @property
    def differing(self) -> list[str]:
        """The multipliers that differ between the logs beyond chance (Bonferroni)."""
        return [name for name, chance in self.chance.items() if _is_beyond(chance)]

    def __repr__(self) -> str:
        return f"<LogComparison of {', '.join(self.results)}: {self.line}>"


def ratio_text(ratio: Gain) -> str:
    """A ratio of errors with its interval."""
    return f"{ratio.value:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"


@checks_arguments
def compare_logs(results: Mapping[str, Identification]) -> LogComparison:
    """Compare identifications of the same robot on several grounds, days or tyres.

    Args:
        results: identifications, as from `identify`, by the names of their logs.

    Raises:
        InvalidValueError: for fewer than two logs.
        LogError: if the logs are of robots with different geometries.
    """
    require(len(results) > 1, "results", list(results), "of two logs or more")
    _require_one_robot(results)
    values = {name: _multipliers(result) for name, result in results.items()}
    chance = {key: _chance([of_log[key] for of_log in values.values()]) for key in MULTIPLIERS}
    common = dict[str, Gain]()
    for key in MULTIPLIERS:
        mean = _mean([of_log[key] for of_log in values.values()])
        common[key] = Gain(mean.value, np.nan, np.nan) if _is_beyond(chance[key]) else mean
    costs = dict[str, Cost]()
    for name, result in results.items():
        others = {
            key: _mean([of_log[key] for other, of_log in values.items() if other != name])
            for key in MULTIPLIERS
        }
        costs[name] = _cost(result, others, len(results))
    return LogComparison(dict(results), values, common, chance, costs)


def _is_beyond(chance: float, tests: int = 1) -> bool:
    """Whether a difference isn't chance, for all multipliers and `tests` together (Bonferroni)."""
    return chance < (1 - _CONFIDENCE) / len(MULTIPLIERS) / tests


def _require_one_robot(results: Mapping[str, Identification]) -> None:
    """Raise LogError if the robots differ in size: their multipliers then have other meanings."""
    (first, one), *others = results.items()
    for name, result in others:
        if result.geometry != one.geometry:
            raise LogError(
                f"{first} and {name} are of robots with different geometries "
                f"({_size(one.geometry)}; {_size(result.geometry)}): compare logs of one robot"
            )


def _size(geometry: RobotGeometry) -> str:
    return f"half_gauge {geometry.half_gauge:g} m, sprocket_radius {geometry.sprocket_radius:g} m"


def _multipliers(result: Identification) -> dict[str, Gain]:
    unknown = Gain(np.nan, np.nan, np.nan)
    answer = result.answer
    return {key: answer.get(key, unknown) for key in MULTIPLIERS}


def _weights(gains: Sequence[Gain]) -> tuple[Array, Array]:
    """The values (n,) that have an interval, and their weights (n,), the inverse variances."""
    known = [gain for gain in gains if np.isfinite(gain.error) and gain.error > 0]
    values = np.array([gain.value for gain in known])
    errors = np.array([gain.error / _NORMAL for gain in known])
    return values, 1 / errors**2


def _mean(gains: Sequence[Gain]) -> Gain:
    """The mean of the values that have an interval, weighted by precision; NaN if none has."""
    values, weights = _weights(gains)
    if not len(values):
        return Gain(np.nan, np.nan, np.nan)
    mean = float(np.average(values, weights=weights))
    half_width = float(_NORMAL / np.sqrt(weights.sum()))
    return Gain(mean, mean - half_width, mean + half_width)


def _chance(gains: Sequence[Gain]) -> float:
    """Probability of Cochran's Q, sum_i w_i (y_i - mean)², with n - 1 degrees of freedom."""
    values, weights = _weights(gains)
    if len(values) < 2:
        return float("nan")
    excess = values - np.average(values, weights=weights)
    return float(chdtrc(len(values) - 1, np.sum(weights * excess**2)))


def _cost(result: Identification, others: Mapping[str, Gain], logs: int) -> Cost:
    """What a law with the multipliers of the `others` costs a log, one of `logs`."""
    missing = [key for key, gain in others.items() if np.isnan(gain.value)]
    if missing:
        return _unknown(f"the other logs have no interval for {missing[0]}")
    fit = None if result.expressible is None else result.main.laws[result.expressible]
    means = {key: gain.value for key, gain in others.items()}
    law = _law_values(means, result.geometry)
    if isinstance(fit, DriveFit):
        errors = _errors_of_drive(fit, law)
    elif isinstance(fit, SteadyFit):
        errors = _errors_of_samples(fit, law)
    else:
        return _unknown("it determines no law of a differential drive")
    if errors is None:
        return _unknown("its driving is too little to predict")
    if len(np.unique(errors.block)) < FEWEST_BLOCKS:
        blocks = counted(len(np.unique(errors.block)), errors.of_what)
        return _unknown(f"{blocks} are too few for an interval, which takes {FEWEST_BLOCKS}")
    own = _multipliers(result)
    chances = [_chance([own[key], others[key]]) for key in MULTIPLIERS]
    return judged(errors, logs, any(_is_beyond(chance, logs) for chance in chances))


def _unknown(reason: str) -> Cost:
    return Cost(Gain(np.nan, np.nan, np.nan), "can't tell", reason)


def _law_values(multipliers: Mapping[str, float], geometry: RobotGeometry) -> dict[str, float]:
    """Parameters of a differential drive with some multipliers."""
    separation = multipliers["wheel_separation_multiplier"]
    values = {"offset": (separation - 1) * geometry.half_gauge}
    for side in SIDES:
        values[f"radius_error_{side}"] = multipliers[f"{side}_wheel_radius_multiplier"] - 1
    return values


@dataclass(frozen=True)
class PairedErrors:
    """Errors of the same predictions by the common and by the own law."""

    common: Array  # (n,)
    own: Array  # (n,)
    block: np.ndarray  # (n,) index of the independent part of the driving
    is_unnoticed: bool  # whether the mean errors differ by too little to notice
    what: str  # what is predicted
    of_what: str  # what the blocks are, in the singular


def _errors_of_drive(fit: DriveFit, law: Mapping[str, float]) -> PairedErrors | None:
    """Errors of predictions some seconds ahead in a log of whole drives; None without any."""
    pairs = fit.pairs
    if not len(pairs.start):
        return None
    horizons = np.unique(pairs.horizon)
    ahead = horizons[np.argmin(np.abs(horizons - _AHEAD))]
    rows = pairs.horizon == ahead

    # the common law, with the place of the sensor and the clock of this log
    model = replace(fit.fit.model, family=FAMILIES[DIFF_DRIVE])
    known = {**fit.extras, **law}
    values = np.array([known.get(name, 0.0) for name in model.names])
    common = sizes(pairs.errors(model, values[None]))[rows]
    own = sizes(fit.missed)[rows]
    is_known = np.isfinite(common + own)
    measured = is_known.any(axis=0)  # positions and headings, as far as they were measured
    usable = is_known[:, measured].all(axis=1)
    if not usable.any():
        return None
    common = common[usable][:, measured]
    own = own[usable][:, measured]

    # position and heading count alike
    scale = np.maximum(own.mean(axis=0), LEAST_ERROR)
    block = pairs.drives.blocks(ahead)[pairs.start[rows]]
    return PairedErrors(
        common=(common / scale).sum(axis=1),
        own=(own / scale).sum(axis=1),
        block=block[usable],
        is_unnoticed=bool(np.all(common.mean(axis=0) - own.mean(axis=0) <= LEAST_ERROR)),
        what=f"predictions {ahead:g} s ahead",
        of_what="independent part of driving",
    )


def _errors_of_samples(fit: SteadyFit, law: Mapping[str, float]) -> PairedErrors | None:
    """Errors of track speeds in steady samples, relative to the faster sprocket's; None if too few
    samples remain when some are left out.
    """
    own_twist = fit.fit.left_out()
    if own_twist is None:
        return None
    samples = fit.fit.samples
    geometry = fit.fit.geometry
    twist = FAMILIES[DIFF_DRIVE].build(law, geometry).twist(samples.omega, geometry)
    # seen from where the sensor of this log is
    of_fit = dict(zip(fit.fit.family.names, fit.fit.values.tolist(), strict=True))
    aside = of_fit.get("sensor_y", 0.0)
    twist = np.column_stack([twist[:, 0] - aside * twist[:, 1], twist[:, 1]])

    def errors(predicted: Array) -> Array:
        """Root mean square (n,) over both tracks."""
        missed = samples.relative_errors(predicted, geometry)
        return np.asarray(np.sqrt(np.mean(missed**2, axis=1)))

    common = errors(twist)
    own = errors(own_twist)
    return PairedErrors(
        common=common,
        own=own,
        block=samples.by_command(geometry),
        is_unnoticed=bool(common.mean() - own.mean() <= LEAST_ERROR),
        what="predictions of left-out samples",
        of_what="different command",
    )


def judged(errors: PairedErrors, logs: int, differs: bool) -> Cost:
    """The cost by errors in one of `logs` logs, with an interval over blocks.

    `differs` says whether its values differ from those of the others.
    """
    labels, block = np.unique(errors.block, return_inverse=True)
    count = len(labels)
    common = np.bincount(block, errors.common)
    own = np.bincount(block, errors.own)
    total = max(float(own.sum()), LEAST_ERROR)
    ratio = float(common.sum()) / total
    scatter = np.sum((common - ratio * own) ** 2) * count / (count - 1)
    confidence = 1 - (1 - _CONFIDENCE) / 2 / logs
    half_width = float(stdtrit(count - 1, confidence) * np.sqrt(scatter) / total)
    cost = Gain(ratio, ratio - half_width, ratio + half_width)
    if errors.is_unnoticed or cost.high <= NOTICED:
        return Cost(cost, "yes", errors.what)
    if cost.value > NOTICED and cost.low > 1 and differs:
        return Cost(cost, "no", errors.what)
    doubt = "" if differs else ", but their values don't differ beyond their intervals"
    reason = (
        f"the law of the other logs predicts with {ratio_text(cost)} times the error of its own"
        f"{doubt}: drive longer"
    )
    return Cost(cost, "can't tell", reason)
