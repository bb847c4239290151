"""Laws compared by how well they predict driving that they were not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.drive.clock import ClockProfile, clock_profile
from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.estimate import DRIVE_LAWS, REFERENCE, DriveFit, fit_drives
from trackslip.identification.drive.noise import unlike_sprockets
from trackslip.identification.drive.prediction import Errors, Predictions, held_out, score
from trackslip.kinematics import RobotGeometry
from trackslip.se2 import Mounting

_TOLD = (  # extra, its unit as printed, SI to unit, size worth a line, words for positive and negative values
    (
        "sensor_y",
        "mm",
        1e3,
        5.0,
        (
            "the sensor sits {} to the left, if the ICRs are equal",
            "the sensor sits {} to the right, if the ICRs are equal",
        ),
    ),
    (
        "sensor_yaw",
        "°",
        180 / np.pi,
        0.5,
        ("the sensor is mounted {} counter-clockwise", "the sensor is mounted {} clockwise"),
    ),
    (
        "clock_offset",
        "ms",
        1e3,
        20.0,
        ("the encoders' stamps are {} later than the poses'", "the poses' stamps are {} later than the encoders'"),
    ),
)
_SAME = 0.02  # difference of scores within which the likelihood decides [-]
_INDISTINCT = 4.0  # difference of Akaike's criterion within which the simpler law is preferred


@dataclass(frozen=True)
class DriveComparison:
    """Laws identified from drives."""

    drives: tuple[Drive, ...]
    """The drives, as used."""
    laws: Mapping[str, DriveFit]
    """Fits by name of the law."""
    predictions: Mapping[str, Predictions]
    """Held-out predictions by name of the law."""
    errors: Mapping[str, Mapping[float, Errors]]
    """Errors of those by law and horizon [s]."""
    score: Mapping[str, float]
    """Mean ratio of a law's errors to the smallest; NaN if nothing could be predicted [-]."""
    best: str
    """Of the laws whose score is within 2 % of the smallest, the simplest of the likeliest."""
    clock: ClockProfile | None
    """Likelihood of clock offsets under the best law."""
    warnings: tuple[str, ...]
    """What a reader should know, one line each."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws, the best predictions first."""
        return tuple(
            sorted(
                self.laws, key=lambda name: (np.nan_to_num(self.score[name], nan=np.inf), len(self.laws[name].values))
            )
        )


def compare_drives(
    drives: Sequence[Drive],
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    names: Sequence[str] = DRIVE_LAWS,
    step: Callable[[float], None] = lambda _: None,
) -> DriveComparison:
    """Fit laws to drives and predict held-out driving; `step(1.0)` is called after each law.

    Raises LogError if the drives determine no law with parameters.
    """
    reference = fit_drives(REFERENCE, drives, geometry, sensor)
    laws: dict[str, DriveFit] = {}
    predictions: dict[str, Predictions] = {}
    warnings: list[str] = []
    for name in names:
        try:
            laws[name] = fit_drives(name, drives, geometry, sensor, reference=reference)
            predictions[name] = held_out(laws[name].fit)
        except LogError as error:
            laws.pop(name, None)
            warnings.append(f"law {name}: {error}")
        step(1.0)
    if not any(law.values for law in laws.values()):
        raise LogError(warnings[-1] if warnings else "no law can be identified")
    errors = {name: one.errors() for name, one in predictions.items()}
    scores = score(errors, tuple(laws))
    best = _best(laws, scores)
    found = laws[best]
    clock = clock_profile(found.fit) if "clock_offset" in found.free else None
    return DriveComparison(
        tuple(drives), laws, predictions, errors, scores, best, clock, (*warnings, *_doubts(drives, laws, best))
    )


def _best(laws: Mapping[str, DriveFit], scores: Mapping[str, float]) -> str:
    known = {name: value for name, value in scores.items() if np.isfinite(value)}
    if not known:
        return REFERENCE if REFERENCE in laws else next(name for name in laws if laws[name].values)
    near = [name for name, value in known.items() if value <= min(known.values()) * (1 + _SAME)]
    criterion = {name: laws[name].deviance + 2 * len(laws[name].values) for name in near}
    likely = [name for name in near if criterion[name] <= min(criterion.values()) + _INDISTINCT]
    return min(likely, key=lambda name: (len(laws[name].values), criterion[name]))


def _doubts(drives: Sequence[Drive], laws: Mapping[str, DriveFit], best: str) -> list[str]:
    """Warnings about the fits."""
    doubts = [f"law {name}: the fit did not converge" for name, law in laws.items() if not law.converged]
    law = laws[best]
    if law.fit.nodes.whitening is None and any(drive.whitening is not None for drive in drives):
        doubts.append("the covariances of the poses don't tell how they scatter: all poses count alike")
    if wild := unlike_sprockets(law.fit.noise):
        doubts.append(f"law {best}: {wild}")
    for name, reason in law.held.items():
        if reason.startswith("not determined"):
            doubts.append(f"{name} is held at {law.values.get(name, law.extras.get(name, 0.0)):g}: {reason}")
    for name, value in law.values.items():
        if name.startswith("offset") and name in law.interval95 and law.interval95[name][1] < 0:
            doubts.append(
                f"law {best}: {name} = {value * 1e3:+.1f} mm puts the centre of rotation inside the track, which "
                "friction doesn't do: is half_gauge too large, or do the poses turn too far?"
            )
        if name.startswith("radius_error") and abs(value) > 0.1:
            doubts.append(f"law {best}: {name} = {value:+.0%} is large: are gear and sprocket_radius right?")
    return [*doubts, *_mounting(law), *_left_out(law)]


def _mounting(law: DriveFit) -> list[str]:
    """What the drive tells of the sensor and its clock, where it is neither chance nor negligible."""
    told = []
    for name, unit, factor, least, ways in _TOLD:
        value, error = factor * law.extras[name], factor * law.stderr.get(name, np.inf)
        if abs(value) > max(3 * error, least):
            told.append(f"{ways[value < 0].format(f'{abs(value):.3g} ± {error:.2g} {unit}')}; the law allows for it")
    return told


def _left_out(law: DriveFit) -> list[str]:
    """What was left out of the drives."""
    doubts = []
    if law.left_out > 0.1 * (law.poses + law.left_out):
        doubts.append(f"{law.left_out} of {law.left_out + law.poses} poses are outlying and left out")
    if law.breaks:
        doubts.append(f"{law.breaks} step(s) of the poses are left out: lasting jumps, or slip out of all proportion")
    return doubts
