"""Doubts about identified laws, one line each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackslip.errors import counted
from trackslip.identification.drive_fit import unlike_sprockets
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drives import PreparedDrive
from trackslip.identification.fitted import FittedLaw, SteadyFit
from trackslip.identification.sensor import offset_between_sides
from trackslip.slip.families import FAMILIES

_CERTAIN = 3.0  # size of a value that is no chance [standard errors]
_LARGE_RADIUS_ERROR = 0.1  # radius error above which a wrong gear or sprocket radius is more likely [-]
_MANY = 0.1  # share of outlying poses worth a line
_SENSOR: dict[str, tuple[str, float, float, str, str]] = {
    "sensor_y": (
        "mm",
        1e3,
        5.0,
        "the sensor sits {} to the left, if the ICRs are equal",
        "the sensor sits {} to the right, if the ICRs are equal",
    ),
    "sensor_yaw": (
        "°",
        180 / np.pi,
        0.5,
        "the sensor is mounted {} counter-clockwise",
        "the sensor is mounted {} clockwise",
    ),
    "clock_offset": (
        "ms",
        1e3,
        20.0,
        "the encoders' clock is {} ahead of the poses'",
        "the encoders' clock is {} behind the poses'",
    ),
}  # unit as printed, SI to unit, size worth a line, words for positive and for negative values


def doubts_of_samples(laws: Mapping[str, SteadyFit], best: str) -> list[str]:
    """Warnings about laws fitted to samples."""
    doubts, law = [], laws[best]
    if law.lacks_fit and law.determined:
        doubts.append(
            f"law {best}: it misses the samples by {law.rms:.2g} rms, more than they scatter (lack of fit), so its "
            "intervals are widened"
        )
    doubts += _implausible_values(law)
    if "icr_sides" in laws:
        offset, error = offset_between_sides(laws["icr_sides"])
        if abs(offset) > _CERTAIN * error:
            differ, sits = (f"{1e3 * k * abs(offset):.1f} ± {1e3 * k * error:.2g} mm" for k in (2, 1))
            doubts.append(
                f"law icr_sides: D_left and D_right differ by {differ}: the sensor may sit {sits} to the "
                f"{'left' if offset > 0 else 'right'} of the middle (--sensor X Y YAW, or --estimate-sensor); an "
                "offset and unequal ICRs can't be told apart"
            )
    if FAMILIES[best].two_sided:
        doubts.append(f"left and right turns differ: {best} describes both, the other laws assume symmetry")
    return doubts


def doubts_of_drives(drives: Sequence[PreparedDrive], laws: Mapping[str, DriveFit], best: str) -> list[str]:
    """Warnings about laws fitted to drives."""
    doubts = [
        f"law {name}: the fit to whole drives did not converge, so its values and errors are rough"
        for name, law in laws.items()
        if law.values and not law.converged
    ]
    law = laws[best]
    if law.fit.nodes.whitening is None and any(drive.whitening is not None for drive in drives):
        doubts.append("the covariances of the poses don't tell how they scatter: all poses count alike")
    if wild := unlike_sprockets(law.fit.noise):
        doubts.append(f"law {best}: {wild}")
    for name, reason in law.held.items():
        if reason.startswith("not determined"):
            doubts.append(f"{name} is held at {law.values.get(name, law.extras.get(name, 0.0)):g}: {reason}")
    return [*doubts, *_implausible_values(law), *_mounting(law), *_left_out(law)]


def _implausible_values(law: FittedLaw) -> list[str]:
    """Questions about ICRs inside their tracks and large radius errors."""
    doubts = []
    for name, value in law.values.items():
        if name.startswith("offset") and name in law.interval95 and law.interval95[name][1] < 0:
            doubts.append(
                f"law {law.name}: {name} = {1e3 * value:.1f} ± {1e3 * law.stderr[name]:.2g} mm is negative, but tracks "
                "that skid have their ICRs outside: is half_gauge right, do the poses turn too far, or does the sensor "
                "sit off the middle (--sensor X Y YAW, or --estimate-sensor)?"
            )
        if name.startswith("radius_error") and abs(value) > _LARGE_RADIUS_ERROR:
            doubts.append(
                f"law {law.name}: {name} = {value:+.0%} is implausible for a track: are gear and sprocket_radius right?"
            )
    return doubts


def _mounting(law: DriveFit) -> list[str]:
    """Estimates of the sensor's mounting and clock that are neither chance nor negligible."""
    told = []
    for name, (unit, factor, least, positive, negative) in _SENSOR.items():
        value, error = factor * law.extras[name], factor * law.stderr.get(name, np.inf)
        if abs(value) > max(_CERTAIN * error, least):
            line = (positive if value > 0 else negative).format(f"{abs(value):.3g} ± {error:.2g} {unit}")
            told.append(f"{line}; the law allows for it")
    return told


def _left_out(law: DriveFit) -> list[str]:
    """Poses and steps that were left out of the drives."""
    doubts = []
    if law.left_out > _MANY * (law.poses + law.left_out):
        doubts.append(f"{law.left_out} of {counted(law.left_out + law.poses, 'pose')} left out: outlying")
    if law.breaks:
        doubts.append(
            f"{counted(law.breaks, 'step')} of the poses left out: lasting jumps, or slip out of all proportion"
        )
    return doubts
