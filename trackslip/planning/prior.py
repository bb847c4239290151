"""Prior knowledge from an earlier identification: the law, its errors, and the slip that no law describes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from trackslip.errors import InvalidValueError, LogError
from trackslip.odometry.identified import LawInUse, identified_law
from trackslip.planning.limits import MOST_DOUBT, Knowledge, first_knowledge

_PATH_LAW = "icr_radius"  # by which paths are predicted
_DEVIATIONS = 4.0  # of errors that the area allows for
_LEAST_REACH, _LEAST_RADIUS = 0.01, 0.005  # doubts that always remain [-]
_LEAST_SLIP = 1e-4  # [m/sqrt(m), rad/sqrt(m)]


def read_identification(path: str | Path, law: str | None = None) -> tuple[LawInUse, Knowledge]:
    """A law, by default the best one, of an identification or of a file, and what it tells of the robot's paths.

    Raises InvalidValueError if the law is missing, LogError if it has no standard errors.
    """
    used = identified_law(path, law)
    if used.errors is None or not used.errors.names:
        raise LogError(f"{path}: no standard errors of the law {used.name} in it")
    try:
        by_path = identified_law(path, _PATH_LAW)
    except InvalidValueError:
        by_path = used
    knowledge = first_knowledge(used.geometry)
    errors = by_path.errors or used.errors
    doubts = dict(zip(errors.names, _DEVIATIONS * np.sqrt(np.diag(errors.covariance)), strict=True))
    if "offset" in doubts:
        offset = float(vars(by_path.law)["offset"])
        doubt = np.clip(doubts["offset"] / (used.geometry.half_gauge + offset), _LEAST_REACH, MOST_DOUBT)
        knowledge = replace(knowledge, offset=offset, reach_doubt=float(doubt))
    if "radius_error" in doubts:
        doubt, error = np.clip(doubts["radius_error"], _LEAST_RADIUS, MOST_DOUBT), vars(by_path.law)["radius_error"]
        knowledge = replace(knowledge, radius_error=float(error), radius_doubt=float(doubt))
    if used.noise is not None:
        along, across, turning = (max(size, _LEAST_SLIP) for size in vars(used.noise).values())
        knowledge = replace(knowledge, slip=(along, across, turning))
    return used, knowledge
