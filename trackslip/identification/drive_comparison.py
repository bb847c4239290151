"""Comparison of laws fitted to whole drives by their predictions, and reasons to doubt the best
law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.drives.first_look import Alarm, Look
from trackslip.errors import counted
from trackslip.identification.answer import radii_differ
from trackslip.identification.comparison import (
    NEAREST_CURVATURES,
    REFERENCE,
    Choice,
    Comparison,
    Uncertainty,
    choose,
    different_curvatures,
    few_curvatures,
    ranked,
    turns_fast,
)
from trackslip.identification.far_poses import are_far_apart, other_separations
from trackslip.identification.law_fit import DriveFit, fit_drives, prior_means
from trackslip.identification.longer_windows import LongerWindows, covering_longer_windows
from trackslip.identification.path import EXTRAS, DriveModel
from trackslip.identification.prediction import FAR_AHEAD, Pairs, PredictionErrors
from trackslip.intervals import FEWEST_BLOCKS, Gain
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, GAINS, drive_laws
from trackslip.se2 import Mounting

TODAY: Final = "today"  # name of the prediction without identification: dead reckoning without slip
_WORSE: Final = 1.1  # least ratio of mean errors for an alarm
_MULTIPLIERS: Final = {
    "offset": "wheel_separation_multiplier",
    "radius_error": "wheel radius multiplier",
    "radius_error_left": "left_wheel_radius_multiplier",
    "radius_error_right": "right_wheel_radius_multiplier",
}
"""The multiplier that each parameter of the answer's law determines."""
_LEAST_SHARE: Final = 0.02  # share of the motions below which a curvature doesn't count [-]


@dataclass(frozen=True, kw_only=True, repr=False)
class DriveComparison(Comparison):
    """Laws identified from whole drives, compared by their predictions of held-out driving."""

    look: Look  # first look at the drives, before any law is fitted
    laws: Mapping[str, DriveFit]  # fits by law name, the best first
    errors: Mapping[str, Mapping[float, PredictionErrors]]
    """Held-out prediction errors for each law and horizon [s]; TODAY and GAINS come first."""
    far_errors: Mapping[str, PredictionErrors]
    """The same after FAR_AHEAD [m] of driving; empty if no drive is as long."""
    alarms: tuple[Alarm, ...]  # reasons not to trust the best law, or the law of the answer


def compare_drives(
    look: Look,
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    names: Sequence[str] | None = None,
    step: Callable[[float], None] = lambda _: None,
    lag: bool = False,
) -> DriveComparison:
    """Fit laws to the drives of a first look and compare their predictions of held-out driving.

    `names` are the laws, by default all families made for drives. `step(1.0)` is called after each
    fitted law. Raises LogError if no law can be fitted.
    """
    is_whole = names is None  # a whole identification, with an answer

    # 1. The reference law decides the length of windows; the other laws are fitted to the same.
    start = look.gains.start(geometry, look.clock)
    reference = fit_drives(REFERENCE, look.drives, geometry, sensor, start=start, lag=lag)
    is_fast = turns_fast(np.concatenate([drive.omega for drive in look.drives]), geometry)
    laws = dict[str, DriveFit]()
    for name in names or drive_laws():
        if is_fast or not (is_whole and FAMILIES[name].fast):
            laws[name] = fit_drives(
                name, look.drives, geometry, sensor, reference=reference, lag=lag
            )
        step(1.0)

    # 2. The answer is the law of a differential drive, whose intervals know of longer windows.
    answer = reference
    longer: LongerWindows | None = None
    if is_whole:
        sides = fit_drives(DIFF_DRIVE, look.drives, geometry, sensor, reference=reference, lag=lag)
        answer = sides if radii_differ(sides) else reference
        mean = prior_means(answer.fit.model, sensor)
        # differences between runs hide those between lengths of windows
        if not answer.fit.is_mean_of_runs:
            answer, longer = covering_longer_windows(answer, mean)
        laws[answer.name] = answer

    # 3. Held-out predictions by the laws, and those of today and by gains, without a fit.
    gains = _gains_fit(look, reference)
    pairs = reference.pairs
    far_pairs = Pairs.after_distance(reference.fit.drives, geometry, FAR_AHEAD)
    unfitted = _unfitted_values(gains, sensor)
    near = _Predictions.of(pairs, laws, unfitted, gains.fit.model)
    far = _Predictions.of(far_pairs, laws, unfitted, gains.fit.model)

    # 4. The best law predicts best; over few curvatures, laws with two parameters are alike.
    compared = {name: law for name, law in laws.items() if name != DIFF_DRIVE}
    uncompared = ""
    if is_whole and len(pairs.start):
        uncompared = few_curvatures(_curvatures(pairs), "the drives have")
    choice = None if uncompared else choose(compared, near.ranked)
    if choice is None:
        reason = uncompared or "no motion can be predicted: the drives are too short"
        choice = Choice(best=answer.name, reason=reason, score={})

    # 5. Reasons not to trust the best law, or the law of the answer; equal ones count once.
    of_best = _alarms(laws[choice.best], near, far)
    of_answer = list[Alarm]()
    if is_whole:
        of_answer += _alarms(answer, near, far)
        of_answer += _differing_runs(answer)
    if longer is not None and longer.outside:
        of_answer.append(Alarm("windows", longer.line(answer)))
    is_little = "little" in [alarm.kind for alarm in look.alarms]
    of_laws = [
        alarm
        for alarm in dict.fromkeys([*of_best, *of_answer])
        if not (is_little and alarm.kind == "blocks")
    ]
    alarms = (*look.alarms, *of_laws, *_whole_turns(answer, sensor))
    if GAINS in [alarm.kind for alarm in of_best] and not gains.at_limit:
        laws[GAINS] = gains
        reason = "gains by regression predict better than the best law that was fitted"
        choice = replace(choice, best=GAINS, reason=reason)

    order = sorted(laws, key=lambda name: (name != choice.best, choice.score.get(name, 0.0)))
    return DriveComparison(
        best=choice.best,
        reason=choice.reason,
        score=choice.score,
        expressible=answer.name,
        laws={name: laws[name] for name in order},
        look=look,
        errors=near.summaries(),
        far_errors=far.at_one_horizon(),
        alarms=alarms,
        warnings=(*look.notes, *_assumed_places(laws, reference)),
    )


def _assumed_places(laws: Mapping[str, DriveFit], reference: DriveFit) -> list[str]:
    """Notes on laws that take the sensor where the reference law has it."""
    if not reference.sits_aside:
        return []
    aside = 1000 * reference.extras["sensor_y"]
    return [
        f"law {name} takes the sensor {aside:.0f} mm to the left, where {REFERENCE} has it: else "
        "it looks like unequal ICRs; give --sensor"
        for name in laws
        if "offset_left" in FAMILIES[name].names
    ]


@dataclass(frozen=True)
class _Predictions:
    """Errors (n, 3) of predictions from the same pairs of poses."""

    pairs: Pairs
    unfitted: Mapping[str, Array]  # by TODAY and GAINS
    held_out: Mapping[str, Array]  # by each law, from fits without the pair's block

    @classmethod
    def of(
        cls,
        pairs: Pairs,
        laws: Mapping[str, DriveFit],
        unfitted: Mapping[str, Array],
        model: DriveModel,
    ) -> _Predictions:
        """Predict by laws, and by a `model` with `unfitted` parameters (p,)."""
        return cls(
            pairs,
            {name: pairs.errors(model, values[None]) for name, values in unfitted.items()},
            {
                name: law.missed if pairs is law.pairs else pairs.held_out_errors(law.fit)
                for name, law in laws.items()
            },
        )

    def summaries(self) -> dict[str, dict[float, PredictionErrors]]:
        """Errors by law and horizon [s]."""
        errors = {**self.unfitted, **self.held_out}
        return {name: self.pairs.summaries(error) for name, error in errors.items()}

    def at_one_horizon(self) -> dict[str, PredictionErrors]:
        """Errors by law of pairs that all have the same horizon; empty without pairs."""
        return {
            name: next(iter(by_horizon.values()))
            for name, by_horizon in self.summaries().items()
            if by_horizon
        }

    def ranked(self, laws: Mapping[str, DriveFit]) -> Choice | None:
        """The best of the laws by their held-out predictions; None without pairs."""
        return ranked(laws, self.pairs.criteria({name: self.held_out[name] for name in laws}))

    def is_worse(self, errors: Array, than: str) -> bool:
        """True if errors (n, 3) exceed those of TODAY or GAINS at any horizon, by a tenth and by
        more than chance.
        """
        for criterion in self.pairs.criteria({than: self.unfitted[than], "law": errors}):
            both = np.stack([criterion.errors[than], criterion.errors["law"]])
            theirs, ours = both.mean(axis=1)
            if ours > _WORSE * theirs and not criterion.as_good_as(both, leader=0)[1]:
                return True
        return False


def _curvatures(pairs: Pairs) -> int:
    """Number of different curvatures of the wheels' motions between poses, each of 2 % of all."""
    drives = pairs.drives
    turned = np.cumsum(drives.omega * np.diff(drives.edges)[:, None], axis=0)
    angles = np.stack(
        [np.interp(drives.time, drives.edges, np.append(0.0, side)) for side in turned.T]
    )
    near = pairs.horizon == pairs.horizon.min()
    left, right = angles[:, pairs.end[near]] - angles[:, pairs.start[near]]
    direction = np.arctan2(right - left, right + left)  # b w = (right - left) / 2
    least = math.ceil(_LEAST_SHARE * len(direction))
    return different_curvatures(direction, NEAREST_CURVATURES, least)


def _unfitted_values(gains: DriveFit, sensor: Mounting | None) -> dict[str, Array]:
    """Values (p,) of the parameters by TODAY and by GAINS, with the place of the sensor if it is
    given.
    """
    place = dict[str, float]()
    if sensor is not None:
        place = {"sensor_x": sensor.x, "sensor_y": sensor.y, "sensor_yaw": sensor.yaw}
    model = gains.fit.model
    return {
        TODAY: _of_model(model, place),
        GAINS: _of_model(model, place | gains.values),
    }


def _gains_fit(look: Look, reference: DriveFit) -> DriveFit:
    """The first look's gains in the form of a fitted law.

    With the gain s of distances and the gain t of turns, ε = s - 1 and b + D = b s / t. Their
    variances follow from those of the gains to first order, where an interval's half-width is two
    standard errors.
    """
    model = reference.fit.model
    half_gauge = model.geometry.half_gauge
    values = look.gains.law(model.geometry)
    unknown = Gain(1.0, np.nan, np.nan)
    speed = look.gains.speed or unknown
    turn = look.gains.turn or unknown

    half_width = half_gauge * speed.value / turn.value  # b + D
    by_speed = [half_width / speed.value, 1.0]  # derivatives of D and ε
    by_turn = [-half_width / turn.value, 0.0]
    slope = np.column_stack([by_speed, by_turn])
    variance = np.diag([(speed.error / 2) ** 2, (turn.error / 2) ** 2])
    errors = Uncertainty.of(
        tuple(values),
        np.array([*values.values()]),
        slope @ variance @ slope.T,
        np.full(len(values), 2.0),
        model.limits[:2, : len(values)],
    )
    return replace(
        reference,
        name=GAINS,
        law=FAMILIES[GAINS].build(values, model.geometry),
        values=values,
        stderr=errors.stderr,
        interval95=errors.interval95,
        correlation=errors.correlation,
        fit=replace(reference.fit, values=_of_model(model, reference.extras | values)),
    )


def _of_model(model: DriveModel, known: Mapping[str, float]) -> Array:
    """Values (p,) of a model's parameters: from `known` by name, otherwise 0."""
    return np.array([known.get(name, 0.0) for name in model.names])


def _whole_turns(law: DriveFit, sensor: Mounting | None) -> list[Alarm]:
    """Return an alarm if other numbers of whole turns explain poses that are far apart, too."""
    model, drives = law.fit.model, law.fit.drives
    if are_far_apart(drives) and not drives.known[1].any():
        line = (
            f"positions {drives.drives[0].interval:.0f} s apart don't show how far the robot "
            "turned in between: measure headings, too, or measure more often"
        )
        return [Alarm("circles", line)]
    if not model.far:
        return []
    others = other_separations(law.fit, prior_means(model, sensor))
    if not others:
        return []
    line = (
        "between poses so far apart, the robot may also have turned by other numbers of circles: "
        f"a wheel_separation_multiplier of {others[0]:.2f} explains them as well: measure poses "
        "more often"
    )
    return [Alarm("circles", line)]


def _differing_runs(law: DriveFit) -> list[Alarm]:
    """Return an alarm if runs differ in multipliers of the answer's law, or in the place of their
    sensor, with the runs at both ends.
    """
    runs = law.fit.runs
    if runs is None:
        return []
    ranges = list[str]()
    for name, values in runs.sensors.items():
        ranges.append(_range_of(name, values, runs.names, f" {EXTRAS[name].unit}"))
    half_gauge = law.fit.model.geometry.half_gauge
    for column in np.flatnonzero(runs.differ).tolist():
        name = law.fit.model.names[law.fit.free[column]]
        unit = half_gauge if name == "offset" else 1.0
        multiplier = 1 + runs.values[:, column] / unit
        ranges.append(_range_of(_MULTIPLIERS[name], multiplier, runs.names))

    answer = "two runs don't tell their mean: take 3 or more, or identify each alone"
    if law.fit.is_mean_of_runs and runs.sensors:
        answer = "the answer is the mean of the runs, each with a sensor of its own"
    elif law.fit.is_mean_of_runs:
        answer = "the answer is the mean of the runs; identify those of each ground alone"
    what = "the sensor was mounted anew in" if runs.sensors else "slip differs between"
    line = f"{what} the {len(runs.names)} runs, {', '.join(ranges)}: {answer}"
    return [Alarm("runs", line)]


def _range_of(name: str, values: Array, runs: Sequence[str], unit: str = "") -> str:
    """The least and largest of the values (n,) of a parameter, with their runs."""
    ends = [int(values.argmin()), int(values.argmax())]
    least, largest = (f"{values[k]:.3g}{unit} ({runs[k]})" for k in ends)
    return f"{name} from {least} to {largest}"


def _alarms(law: DriveFit, near: _Predictions, far: _Predictions) -> list[Alarm]:
    """Reasons not to trust a law, from predictions some seconds and some metres ahead."""
    alarms = [
        Alarm("bound", f"{name} = {law.values[name]:.3g} is at a limit of law {law.name}")
        for name in law.at_limit
    ]
    if law.blocks < FEWEST_BLOCKS:
        are = "is" if law.blocks == 1 else "are"
        line = (
            f"{counted(law.blocks, 'independent part')} of driving {are} too few for an interval, "
            f"which takes {FEWEST_BLOCKS}: drive for a minute or more"
        )
        alarms.append(Alarm("blocks", line))
    name = law.name
    if any(ahead.is_worse(ahead.held_out[name], TODAY) for ahead in (near, far)):
        line = f"law {name} predicts worse than the robot does today: don't use it"
        alarms.append(Alarm(TODAY, line))
    # the mean of runs that differ isn't meant to predict those at hand
    if law.fit.is_mean_of_runs:
        return alarms
    # gains are fitted to all driving, too
    fitted = law.pairs.errors(law.fit.model, law.fit.values[None])
    if near.is_worse(fitted, GAINS):
        alarms.append(Alarm(GAINS, f"law {name} predicts worse than two gains do: don't use it"))
    return alarms
