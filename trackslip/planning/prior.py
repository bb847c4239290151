"""Prior knowledge from an earlier identification: the law, its errors, and the slip that no law describes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trackslip.errors import LogError
from trackslip.files import reason
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.file import StoredLaws, read_stored
from trackslip.odometry.uncertainty import LawErrors, SlipNoise
from trackslip.planning.limits import MOST_DOUBT, Knowledge, first_knowledge

_PATH_LAW = "icr_radius"  # by which paths are predicted
_SIDES = "icr_sides"
_DEVIATIONS = 4.0  # of errors that the area allows for
_LEAST_REACH, _LEAST_RADIUS, _LEAST_PULL = 0.01, 0.005, 0.0005  # doubts that always remain
_LEAST_SLIP = 1e-4  # [m/sqrt(m), rad/sqrt(m)]


@dataclass(frozen=True)
class PriorIdentification:
    """An earlier identification that a plan builds on."""

    law: str
    """Name of the law."""
    geometry: RobotGeometry
    values: Array  # (q,) parameters of the law
    known: LawErrors
    knowledge: Knowledge


def read_identification(path: str | Path, law: str | None = None) -> PriorIdentification:
    """Read a folder of `identify`, its summary.json, or a file of laws with their errors; by default the best law.

    Raises InvalidValueError if the law is missing, LogError if it can't be planned for, or has no standard error.
    """
    stored = read_stored(Path(path))
    law = stored.law_named(law)
    try:
        known = _errors(stored, law)
        np.linalg.cholesky(known.covariance)
        knowledge = _knowledge(stored, law)
    except (ValueError, KeyError, TypeError, AttributeError, np.linalg.LinAlgError) as error:
        raise LogError(f"{stored.name}: what it says of the law {law} is damaged ({reason(error)})") from error
    if not known.names:
        raise LogError(f"{stored.name}: no standard errors of the law {law} in it")
    return PriorIdentification(law, stored.geometry, np.array([*stored.values(law).values()]), known, knowledge)


def _errors(stored: StoredLaws, law: str) -> LawErrors:
    """Errors of those parameters of the law that the identification has fitted."""
    fit = stored.fit(law)
    return LawErrors.stored(fit) if fit.get("stderr") else LawErrors((), np.zeros((0, 0)))


def _knowledge(stored: StoredLaws, law: str) -> Knowledge:
    """What the laws say about the robot's paths, completed by typical values."""
    usual = first_knowledge(stored.geometry)
    name = _PATH_LAW if _PATH_LAW in stored.laws else law
    values, known = stored.values(name), _errors(stored, name)
    doubts = dict(zip(known.names, _DEVIATIONS * np.sqrt(np.diag(known.covariance)), strict=True))
    if "offset" in doubts:
        offset = values["offset"]
        doubt = doubts["offset"] / (stored.geometry.half_gauge + offset)
        usual = replace(usual, offset=offset, reach_doubt=_within(doubt, _LEAST_REACH))
    if "radius_error" in doubts:
        doubt = _within(doubts["radius_error"], _LEAST_RADIUS)
        usual = replace(usual, radius_error=values["radius_error"], radius_doubt=doubt)
    if _SIDES in stored.laws:
        sides = stored.values(_SIDES)
        pull = abs(sides["radius_error_left"] - sides["radius_error_right"])
        usual = replace(usual, pull=_within(pull, _LEAST_PULL))
    noise = (stored.drive_fit(law) or {}).get("noise")
    if noise:
        white = SlipNoise.of(noise)
        along, across, turning = (max(size, _LEAST_SLIP) for size in (white.forward, white.sideways, white.turn))
        usual = replace(usual, slip=(along, across, turning))
    return usual


def _within(doubt: float, least: float) -> float:
    return float(np.clip(doubt, least, MOST_DOUBT))
