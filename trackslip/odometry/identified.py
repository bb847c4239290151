"""A law as identified, with all that odometry needs beside it: noise, errors of its parameters, sensor and clock."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import LogError, TrackslipError
from trackslip.identification.result import Identification, identification_to_json
from trackslip.kinematics import RobotGeometry, wrap_angle
from trackslip.odometry.mounting import Mounting
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import LawErrors, SlipNoise
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import NoSlip
from trackslip.slip.law_file import load_laws

NO_SLIP = "none"
"""Name of the law of a robot that doesn't slip."""
_NORMAL_95 = 1.959963984540054  # half width of a 95 % interval [standard deviations]


@dataclass(frozen=True)
class LawInUse:
    """A law to reckon with."""

    name: str
    """Name of its family."""
    law: SlipLaw
    geometry: RobotGeometry
    """The one the law was identified for."""
    noise: SlipNoise | None = None
    """Slip that varies; None if it was not identified."""
    errors: LawErrors | None = None
    """Errors of the law's parameters, as wide as their 95 % intervals; None if they are not known."""
    drift: float = 0.0
    """c, for a lateral speed of -c v w in turns [s]."""
    mounting: Mounting | None = None
    """Where the sensor of the poses sat in the driving that the law was identified from; None if not known."""
    clock_offset: float | None = None
    """Encoder clock minus pose clock there, less the lag of the motion; None if not known [s]."""

    def odometry(self, **start: Any) -> SlipOdometry:
        """Odometry by this law; `start` and `start_covariance` as for SlipOdometry."""
        return SlipOdometry(self.law, self.geometry, self.noise, self.errors, self.drift, **start)


def no_slip(geometry: RobotGeometry) -> LawInUse:
    """The law that controllers have which know of no slip."""
    return LawInUse(NO_SLIP, NoSlip(), geometry)


def identified_law(
    source: str | Path | Identification, name: str | None = None, robot: RobotGeometry | None = None
) -> LawInUse:
    """A law of an identification, or of a JSON file of laws, which knows neither noise nor sensor.

    Args:
        source: an identification, the folder of its results, or a file that `load_laws` reads.
        name: of the law; by default the best one, or the only one of a file.
        robot: geometry that the law must have been identified for, if given.

    Raises:
        LogError: if the source cannot be read, was made for another robot, or has no such law.
    """
    if isinstance(source, Identification):
        content: Mapping[str, Any] = identification_to_json(source)
        geometry, laws, text = source.geometry, dict(source.laws), "the identification"
        if robot is not None and not np.allclose(_sizes(geometry), _sizes(robot)):
            raise LogError(f"{text} is of a robot with {_told(geometry)}, the robot has {_told(robot)}")
    else:
        text = str(source)
        laws = load_laws(source, robot)
        path = Path(source)
        file = path / "summary.json" if path.is_dir() else path
        content = json.loads(file.read_text(encoding="utf-8"))
        geometry = RobotGeometry(*(float(content["geometry"][key]) for key in ("half_gauge", "sprocket_radius")))
    laws.setdefault(NO_SLIP, NoSlip())
    chosen = name or _default(content, list(laws), text)
    if chosen not in laws:
        raise LogError(f"{text}: has no law {chosen!r}, but {', '.join(laws)}")
    try:
        return LawInUse(chosen, laws[chosen], geometry, **_beside(content, chosen))
    except (TrackslipError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise LogError(
            f"{text}: what it says of law {chosen!r} is damaged ({type(error).__name__}: {error})"
        ) from error


def _default(content: Mapping[str, Any], names: list[str], text: str) -> str:
    best = content.get("best")
    slipping = [name for name in names if name != NO_SLIP]
    if isinstance(best, str) and best in names:
        return best
    if len(slipping) == 1:
        return slipping[0]
    raise LogError(f"{text}: names no best law: choose one of {', '.join(names)}")


def _beside(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    """What is known beside the law: by the fit to whole drives, else to steady stretches."""
    drive = content.get("drive")
    steady = (content.get("laws") or {}).get(name)
    of_drives = drive["laws"].get(name) if drive else None
    own = of_drives if content.get("method") == "drive" or steady is None else steady
    found: dict[str, Any] = {}
    if own is not None and own["values"]:
        errors, correlation = _errors(own), np.array(own["correlation"], float)
        if np.isfinite([*errors.values()]).all() and np.isfinite(correlation).all():
            found["errors"] = LawErrors.of(own["values"], errors, correlation)
    if drive:
        fit = of_drives or drive["laws"][drive["best"]]
        extras = {key: float(value) for key, value in fit["extras"].items()}
        found["noise"] = SlipNoise.of(fit["noise"])
        found["drift"] = extras["drift"] if of_drives else 0.0
        found["mounting"] = Mounting(extras["sensor_x"], extras["sensor_y"], float(wrap_angle(extras["sensor_yaw"])))
        found["clock_offset"] = extras["clock_offset"] - extras["lag"]
    return found


def _errors(fit: Mapping[str, Any]) -> dict[str, float]:
    """Standard errors that agree with the 95 % intervals, which allow for slip that lasts."""
    errors = {}
    for name, error in fit["stderr"].items():
        low, high = np.array(fit["interval95"].get(name, (0.0, 0.0)), float)
        errors[name] = max(float(np.array(error, float)), float(high - low) / 2 / _NORMAL_95)  # null becomes NaN
    return errors


def _sizes(geometry: RobotGeometry) -> tuple[float, float]:
    return geometry.half_gauge, geometry.sprocket_radius


def _told(geometry: RobotGeometry) -> str:
    return f"half_gauge = {geometry.half_gauge:g} m and sprocket_radius = {geometry.sprocket_radius:g} m"
