"""What an identification before tells of a robot: its law, how well that is known, and how much it slips besides."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.file_format import require_known_format, require_known_manifest
from trackslip.planning.information import Known
from trackslip.planning.limits import Knowledge, first_knowledge
from trackslip.slip.families import family, law_from_values

_PATH_LAW = "icr_radius"  # by which paths are predicted
_SIDES = "icr_sides"
_DEVIATIONS = 4.0  # of errors that the area allows for
_LEAST_REACH, _LEAST_RADIUS, _LEAST_PULL = 0.01, 0.005, 0.0005  # doubts that always remain
_LEAST_SLIP = 1e-4  # [m/sqrt(m), rad/sqrt(m)]
_NORMAL = 1.96  # half of a 95 % interval [standard errors]
_SLIPS = ("slip_forward", "slip_sideways", "slip_turn")


@dataclass(frozen=True)
class Before:
    """An identification that a plan goes on from."""

    geometry: RobotGeometry
    values: Array  # (q,) parameters of the law
    known: Known
    knowledge: Knowledge


def read_identification(path: str | Path, law: str) -> Before:
    """Read what `identify` has stored in a folder, or in a summary.json.

    Raises LogError if there is nothing of this law, or no error of any of its parameters.
    """
    path = Path(path)
    file = path / "summary.json" if path.is_dir() else path
    try:
        if path.is_dir():
            require_known_manifest(path)
        content = json.loads(file.read_text(encoding="utf-8"))
        require_known_format(content, file)
        geometry = RobotGeometry(*(float(content["geometry"][name]) for name in ("half_gauge", "sprocket_radius")))
        laws = _laws(content)
        if law not in laws:
            found = ", ".join(laws) or "none"
            raise LogError(f"{file}: no law {law} in it; found {found}")
        values = _values(law, laws[law], geometry)
        known = _known(law, laws[law], file)
        return Before(geometry, values, known, _knowledge(laws, law, geometry))
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except LogError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, np.linalg.LinAlgError) as error:
        raise LogError(f"{file}: not the summary of an identification ({type(error).__name__}: {error})") from error


def _laws(content: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Laws by name: those of whole drives, which have noise and correlations, else those of steady stretches."""
    steady = {name: law for name, law in content["slip_laws"].items() if law.get("stderr")}
    return steady | {name: law for name, law in (content.get("drive") or {}).get("laws", {}).items() if law["values"]}


def _values(law: str, stored: Mapping[str, Any], geometry: RobotGeometry) -> Array:
    law_from_values(law, stored["values"], geometry.half_gauge)  # checks them
    return np.array([float(stored["values"][name]) for name in family(law).names])


def _known(law: str, stored: Mapping[str, Any], file: Path) -> Known:
    errors = _errors(law, stored)
    if not errors:
        raise LogError(f"{file}: no standard errors of the law {law} in it")
    names, deviation = tuple(errors), np.array(list(errors.values()))
    correlation = np.eye(len(names))
    if "correlation" in stored:
        order = list(stored["stderr"])
        at = [order.index(name) for name in names]
        whole = np.array(stored["correlation"], float)
        correlation = whole[np.ix_(at, at)] if whole.shape == (len(order), len(order)) else correlation
    covariance = correlation * np.outer(deviation, deviation)
    np.linalg.cholesky(covariance)
    return Known(names, covariance)


def _errors(law: str, stored: Mapping[str, Any]) -> dict[str, float]:
    """Standard errors of the law's parameters, as wide as their intervals say."""
    found = {}
    for name in family(law).names:
        error = stored["stderr"].get(name)
        if error is None or not 0 < float(error) < np.inf:
            continue
        low, high = stored.get("interval95", {}).get(name) or (0.0, 0.0)
        found[name] = max(float(error), (float(high) - float(low)) / (2 * _NORMAL))
    return found


def _knowledge(laws: Mapping[str, Mapping[str, Any]], law: str, geometry: RobotGeometry) -> Knowledge:
    """What the laws tell of the robot's paths; of what they don't tell, what is usual."""
    usual = first_knowledge(geometry)
    by = laws.get(_PATH_LAW, laws[law])
    name = _PATH_LAW if _PATH_LAW in laws else law
    values, errors = by["values"], _errors(name, by)
    if "offset" in errors:
        offset = float(values["offset"])
        doubt = _DEVIATIONS * errors["offset"] / (geometry.half_gauge + offset)
        usual = replace(usual, offset=offset, reach_doubt=_within(doubt, _LEAST_REACH))
    if "radius_error" in errors:
        doubt = _within(_DEVIATIONS * errors["radius_error"], _LEAST_RADIUS)
        usual = replace(usual, radius_error=float(values["radius_error"]), radius_doubt=doubt)
    sides = laws.get(_SIDES, {}).get("values", {})
    if {"radius_error_left", "radius_error_right"} <= sides.keys():
        pull = abs(float(sides["radius_error_left"]) - float(sides["radius_error_right"]))
        usual = replace(usual, pull=_within(pull, _LEAST_PULL))
    noise = laws[law].get("noise")
    if noise:
        along, across, turning = (max(float(noise[name]), _LEAST_SLIP) for name in _SLIPS)
        usual = replace(usual, slip=(along, across, turning))
    return usual


def _within(doubt: float, least: float) -> float:
    return float(np.clip(doubt, least, 0.9))
