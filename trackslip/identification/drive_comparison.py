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
from trackslip.identification.answer import radii_differ
from trackslip.identification.comparison import (
    REFERENCE,
    Choice,
    Comparison,
    choose,
    different_curvatures,
    few_curvatures,
    ranked,
    turns_fast,
    uncertainty,
)
from trackslip.identification.far_poses import are_far_apart, other_separations
from trackslip.identification.law_fit import DriveFit, fit_drives, prior_means
from trackslip.identification.path import DriveModel
from trackslip.identification.prediction import Pairs, PredictionErrors
from trackslip.intervals import FEWEST_BLOCKS, Gain
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, GAINS, drive_laws
from trackslip.se2 import Mounting

NEAREST_ANGLE: Final = 0.05
"""Largest angle between motions of one curvature; encoders scatter less in a second [rad]."""
TODAY: Final = "today"  # name of the prediction without identification: dead reckoning without slip


@dataclass(frozen=True, kw_only=True)
class DriveComparison(Comparison):
    """Laws identified from whole drives, compared by their predictions of held-out driving."""

    look: Look  # first look at the drives, before any law is fitted
    laws: Mapping[str, DriveFit]  # fits by law name, the best first
    errors: Mapping[str, Mapping[float, PredictionErrors]]
    """Held-out prediction errors for each law and horizon [s]; TODAY and GAINS come first."""
    alarms: tuple[Alarm, ...]  # reasons not to trust the best law


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
    whole = names is None
    fast = not whole or turns_fast(np.concatenate([drive.omega for drive in look.drives]), geometry)
    start = look.gains.start(geometry, look.clock)
    reference = fit_drives(REFERENCE, look.drives, geometry, sensor, start=start, lag=lag)
    laws, notes = dict[str, DriveFit](), list(look.notes)
    for name in names or drive_laws():
        if "offset_left" in FAMILIES[name].names and reference.sits_aside:
            aside = (
                f"{1000 * reference.extras['sensor_y']:.0f} mm to the left, where "
                f"{REFERENCE} has it"
            )
            notes.append(
                f"law {name} takes the sensor {aside}: else it looks like unequal ICRs; give "
                "--sensor"
            )
        if fast or not FAMILIES[name].fast:
            laws[name] = fit_drives(
                name, look.drives, geometry, sensor, reference=reference, lag=lag
            )
        step(1.0)
    answer = reference
    if whole:
        sides = fit_drives(DIFF_DRIVE, look.drives, geometry, sensor, reference=reference, lag=lag)
        answer = sides if radii_differ(sides) else reference
        laws[answer.name] = answer
    pairs, missed = reference.pairs, {name: law.missed for name, law in laws.items()}
    place = (
        {}
        if sensor is None
        else {"sensor_x": sensor.x, "sensor_y": sensor.y, "sensor_yaw": sensor.yaw}
    )
    two = _gains_fit(look, reference)
    plain = {TODAY: place, GAINS: place | two.values}
    known = {
        name: pairs.errors(two.fit.model, _of_model(two.fit.model, only)[None])
        for name, only in plain.items()
    }
    errors = {name: pairs.summaries(error) for name, error in {**known, **missed}.items()}

    def rank(some: Mapping[str, DriveFit]) -> Choice | None:
        return ranked(some, pairs.criteria({name: missed[name] for name in some}))

    compared = {name: law for name, law in laws.items() if name != DIFF_DRIVE}
    uncompared = ""
    if whole and len(pairs.start):
        uncompared = few_curvatures(_curvatures(pairs), "the drives have")
    choice = None if uncompared else choose(compared, rank)
    if choice is None:
        why = uncompared or "no motion can be predicted: the drives are too short"
        choice = Choice(best=answer.name, reason=why, score={})
    of_best = _alarms(laws[choice.best], known)
    # the same alarms count once, as do those for the best law if it gives the answer
    of_laws = dict.fromkeys([*of_best, *(_alarms(answer, known) if whole else [])])
    alarms = [*look.alarms, *of_laws, *_whole_turns(answer, sensor)]
    if GAINS in [alarm.kind for alarm in of_best] and not two.at_limit:
        laws[GAINS] = two
        why = "gains by regression predict better than every law that was fitted"
        choice = replace(choice, best=GAINS, reason=why)
    order = sorted(laws, key=lambda name: (name != choice.best, choice.score.get(name, 0.0)))
    return DriveComparison(
        best=choice.best,
        reason=choice.reason,
        score=choice.score,
        expressible=answer.name,
        laws={name: laws[name] for name in order},
        look=look,
        errors=errors,
        alarms=tuple(alarms),
        warnings=tuple(notes),
    )


def _curvatures(pairs: Pairs) -> int:
    """Number of different curvatures of the wheels' motions between poses, each of 2 % of all."""
    drives = pairs.drives
    edges = drives.edges
    turned = np.cumsum(drives.omega * np.diff(edges)[:, None], axis=0)
    angles = np.stack([np.interp(drives.time, edges, np.append(0.0, side)) for side in turned.T])
    near = pairs.horizon == pairs.horizon.min()
    left, right = angles[:, pairs.end[near]] - angles[:, pairs.start[near]]
    direction = np.arctan2(right - left, right + left)  # b w = (right - left) / 2
    return different_curvatures(direction, NEAREST_ANGLE, math.ceil(0.02 * len(direction)))


def _gains_fit(look: Look, reference: DriveFit) -> DriveFit:
    """The first look's gains in the form of a fitted law."""
    model, values = reference.fit.model, look.gains.law(reference.fit.model.geometry)
    speed, turn = (
        gain or Gain(1.0, np.nan, np.nan) for gain in (look.gains.speed, look.gains.turn)
    )
    wide = model.geometry.half_gauge * speed.value / turn.value
    slope = np.array([[wide / speed.value, -wide / turn.value], [1.0, 0.0]])
    # from the intervals' half-widths
    covariance = slope @ np.diag([speed.error**2, turn.error**2]) @ slope.T
    return replace(
        reference,
        name=GAINS,
        law=FAMILIES[GAINS].build(values, model.geometry),
        values=values,
        fit=replace(reference.fit, values=_of_model(model, reference.extras | values)),
        **uncertainty(
            tuple(values),
            np.array([*values.values()]),
            covariance / 4,
            2.0,
            model.limits[:2, : len(values)],
        ),
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


def _alarms(law: DriveFit, known: Mapping[str, Array]) -> list[Alarm]:
    """Reasons not to trust the best law; `known` has the prediction errors (n, 3) of TODAY and
    GAINS.
    """
    alarms = [
        Alarm("bound", f"{name} = {law.values[name]:.3g} is at a limit of law {law.name}")
        for name in law.at_limit
    ]
    if law.blocks < FEWEST_BLOCKS:
        what = (
            f"{law.blocks} independent parts of driving are too few for an interval, which "
            f"takes {FEWEST_BLOCKS}"
        )
        return [*alarms, Alarm("blocks", f"{what}: drive for a minute or more")]
    # GAINS are fitted to all driving, too
    fitted = law.pairs.errors(law.fit.model, law.fit.values[None])
    for name, ours, others in (
        (TODAY, law.missed, "the robot does today"),
        (GAINS, fitted, "two gains do"),
    ):
        for criterion in law.pairs.criteria({name: known[name], law.name: ours}):
            both = np.stack([criterion.errors[name], criterion.errors[law.name]])
            if both[1].mean() > 1.1 * both[0].mean() and not criterion.as_good_as(both, 0)[1]:
                alarms.append(
                    Alarm(name, f"law {law.name} predicts worse than {others}: don't use it")
                )
                break
    return alarms
