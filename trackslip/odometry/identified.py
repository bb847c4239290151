"""Identified laws with everything else that odometry needs: noise, errors of the parameters, sensor and clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackslip.errors import LogError, TrackslipError, require_finite
from trackslip.files import reason
from trackslip.identification.path import GYRO
from trackslip.identification.result import Identification, identification_to_json
from trackslip.kinematics import RobotGeometry, wrap_angle
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.file import NO_SLIP, StoredLaws, read_stored, stored_laws
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.se2 import Mounting


@dataclass(frozen=True)
class LawInUse:
    """A law for odometry."""

    name: str  # name of its family
    law: SlipLaw
    geometry: RobotGeometry  # of the robot for which the law was identified
    noise: SlipNoise | None = None  # slip that varies; None if it was not identified
    errors: LawErrors | None = None
    """Errors of the law's parameters, as wide as their 95 % intervals; None if they are not known."""
    drift: float = 0.0  # c, for a lateral speed of -c v w in turns [s]
    mounting: Mounting | None = None
    """Mounting of the pose sensor when the law was identified; None if not known."""
    clock_offset: float | None = None
    """Encoder clock minus pose clock at that time, less the lag of the motion; None if not known [s]."""
    gyro: Gyro | None = None  # errors of the gyroscope used then; None without one

    def odometry(self, **start: Any) -> SlipOdometry:
        """Odometry by this law; `start` and `start_covariance` as for SlipOdometry."""
        return SlipOdometry(self.law, self.geometry, self.noise, self.errors, self.drift, gyro=self.gyro, **start)


def no_slip(geometry: RobotGeometry) -> LawInUse:
    """The law without slip, as in controllers without compensation."""
    return LawInUse(NO_SLIP, NoSlip(), geometry)


def identified_law(
    source: str | Path | Identification, name: str | None = None, robot: RobotGeometry | None = None
) -> LawInUse:
    """A law from an identification, or from a JSON file of laws, which says nothing about noise and sensor.

    Args:
        source: an identification, the folder of its results, or a file that `load_laws` reads.
        name: of the law; by default the best one, the only one of a file, or the one that fits best.
        robot: geometry that the law must have been identified for, if given.

    Raises:
        LogError: if the source cannot be read, was made for another robot, or does not say which law is best.
        InvalidValueError: if it has no law of this name.
    """
    if isinstance(source, Identification):
        stored = stored_laws(identification_to_json(source), "the identification", robot=robot)
    else:
        stored = read_stored(Path(source), robot)
    chosen = stored.law_named(name)
    try:
        return LawInUse(chosen, stored.laws[chosen], stored.geometry, **_beside(stored, chosen))
    except (TrackslipError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise LogError(f"{stored.name}: what it says of law {chosen!r} is damaged ({reason(error)})") from error


def _beside(stored: StoredLaws, name: str) -> dict[str, Any]:
    """Noise, errors, sensor and clock, from the fit to whole drives, otherwise from the fit to steady stretches."""
    known: dict[str, Any] = {}
    fit = stored.fit(name)
    if fit.get("values") and fit.get("stderr"):
        errors = LawErrors.stored(fit)
        if set(errors.names) >= set(fit["values"]) & set(fit["stderr"]):  # an unknown error isn't zero
            known["errors"] = errors
    drive = stored.content.get("drive")
    if not drive:
        return known
    own = stored.drive_fit(name)
    fit = own or drive["laws"][drive["best"]]
    extras = {key: float(value) for key, value in fit["extras"].items()}
    for key, value in extras.items():
        require_finite(key, value)
    if "gyro" in fit["noise"]:
        bias, scale = extras["gyro_bias"], extras["gyro_scale"]
        errors_of_gyro = (float(fit["stderr"].get(name) or 0.0) for name in GYRO)
        known["gyro"] = Gyro(bias, scale, float(fit["noise"]["gyro"]), *errors_of_gyro)
    return known | {
        "noise": SlipNoise.of(fit["noise"]),
        "drift": extras["drift"] if own else 0.0,
        "clock_offset": extras["clock_offset"] - extras["lag"],
        "mounting": Mounting(extras["sensor_x"], extras["sensor_y"], float(wrap_angle(extras["sensor_yaw"]))),
    }
