"""Identified laws, with all other inputs to odometry, from identifications and files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.arguments import checks_arguments
from trackslip.errors import LogError, TrackslipError, require_finite
from trackslip.files import reason
from trackslip.identification.path import GYRO
from trackslip.identification.result import Identification, identification_to_json
from trackslip.kinematics import RobotGeometry, wrap_angle
from trackslip.laws.base import NoSlip
from trackslip.laws.file import NO_SLIP, StoredLaws, read_stored, stored_laws
from trackslip.odometry.law_in_use import LawInUse as LawInUse
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.se2 import Mounting


def no_slip(geometry: RobotGeometry) -> LawInUse:
    """The law without slip, as used by controllers without compensation."""
    return LawInUse(NO_SLIP, NoSlip(), geometry)


@checks_arguments
def identified_law(
    source: str | Path | Identification, name: str | None = None, robot: RobotGeometry | None = None
) -> LawInUse:
    """Get a law from an identification, or from a JSON file of laws, which has no noise and no
    sensor.

    Args:
        source: an identification, its results folder, or a file that `load_laws` reads.
        name: name of the law; by default the best law, the only law in a file, or the law with the
            best fit.
        robot: geometry for which the law must have been identified, if given.

    Raises:
        LogError: if the source cannot be read, is for another robot, or does not state which law is
            best.
        InvalidValueError: if the source has no law called `name`.
    """
    if isinstance(source, Identification):
        stored = stored_laws(identification_to_json(source), "the identification", robot=robot)
    else:
        stored = read_stored(Path(source), robot)
    chosen = stored.law_named(name)
    try:
        return LawInUse(chosen, stored.laws[chosen], stored.geometry, **_beside(stored, chosen))
    except (TrackslipError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise LogError(
            f"{stored.name}: what it says of law {chosen!r} is damaged ({reason(error)})"
        ) from error


def _beside(stored: StoredLaws, name: str) -> dict[str, Any]:
    """Fields of LawInUse besides the law: errors from its fit, other fields only from a fit to
    whole drives.
    """
    known: dict[str, Any] = {}
    fit = stored.fit(name)
    if fit.get("values") and fit.get("stderr"):
        errors = LawErrors.stored(fit)
        # unknown errors aren't zero
        with_errors = set(fit["values"]) & set(fit["stderr"])
        if set(errors.names) >= with_errors:
            known["errors"] = errors
    drive = stored.content.get("drive")
    if not drive:
        return known

    # a law without a fit of its own to whole drives gets the noise and sensor of the best law
    own_fit = stored.drive_fit(name)
    drive_fit = own_fit or drive["laws"][drive["best"]]
    extras = {key: float(value) for key, value in drive_fit["extras"].items()}
    for key, value in extras.items():
        require_finite(key, value)
    known["noise"] = SlipNoise.of(drive_fit["noise"])
    known["drift"] = extras["drift"] if own_fit else 0.0
    known["clock_offset"] = extras["clock_offset"] - extras["lag"]
    known["mounting"] = Mounting(
        x=extras["sensor_x"],
        y=extras["sensor_y"],
        yaw=float(wrap_angle(extras["sensor_yaw"])),
    )
    if "gyro" in drive_fit["noise"]:
        known["gyro"] = _gyro(drive_fit, extras)
    return known


def _gyro(fit: Mapping[str, Any], extras: Mapping[str, float]) -> Gyro:
    """The errors of the gyroscope in a fit to whole drives with the parameters `extras`."""
    bias_error, scale_error = (float(fit["stderr"].get(name) or 0.0) for name in GYRO)
    return Gyro(
        bias=extras["gyro_bias"],
        scale=extras["gyro_scale"],
        noise=float(fit["noise"]["gyro"]),
        bias_error=bias_error,
        scale_error=scale_error,
    )
