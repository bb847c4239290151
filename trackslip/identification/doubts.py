"""Doubts about identified laws, in the words of `trackslip.doubts`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from trackslip.doubts import MANY, Doubt, doubt
from trackslip.errors import LogError, counted
from trackslip.identification.drive_fit import unlike_sprockets
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.drive_prediction import refitted
from trackslip.identification.drives import PreparedDrive
from trackslip.identification.fitted import FittedLaw, SteadyFit
from trackslip.identification.intervals import CONFIDENCE, half_widths
from trackslip.identification.sensor import offset_between_sides
from trackslip.slip.families import FAMILIES

_CERTAIN = 3.0  # size of a value that is no chance [standard errors]
_LARGE_RADIUS_ERROR = 0.1  # radius error above which a wrong gear or sprocket radius is more likely [-]
_SHORT_WAY = 10.0  # way of the belts that shows too little [half gauges]
_SENSOR = {
    "sensor_y": ("mm", 1e3, 5.0, "the sensor sits {} to the {}, if the ICRs are equal", "left", "right"),
    "sensor_yaw": ("°", 180 / np.pi, 0.5, "the sensor is mounted {} {}", "counter-clockwise", "clockwise"),
    "clock_offset": ("ms", 1e3, 20.0, "the encoders' clock is {} {} the poses'", "ahead of", "behind"),
}  # unit as printed, SI to unit, size worth a line, words, and those for positive and for negative values


def doubts_of_samples(laws: Mapping[str, SteadyFit], best: str) -> list[Doubt]:
    """Doubts about laws fitted to samples."""
    law = laws[best]
    doubts = [doubt("misses", law=best, by=law.rms)] if law.lacks_fit and law.determined else []
    doubts += _implausible_values(law)
    if "icr_sides" in laws:
        offset, error = offset_between_sides(laws["icr_sides"])
        if abs(offset) > _CERTAIN * error:
            differ, sits = (f"{1e3 * k * abs(offset):.1f} ± {1e3 * k * error:.2g} mm" for k in (2, 1))
            doubts.append(doubt("sides", differ=differ, sits=f"{sits} to the {'left' if offset > 0 else 'right'}"))
    return doubts + ([doubt("unequal", law=best)] if FAMILIES[best].two_sided else [])


def doubts_of_drives(drives: Sequence[PreparedDrive], laws: Mapping[str, DriveFit], best: str) -> list[Doubt]:
    """Doubts about laws fitted to drives."""
    law = laws[best]
    shown = next((one for one in (law, *laws.values()) if one.values), law)
    doubts = [*_left_out(law), *_halves(law), *_little(shown)]
    doubts += [doubt("rough", law=name) for name, one in laws.items() if one.values and not one.converged]
    if law.fit.nodes.whitening is None and any(drive.whitening is not None for drive in drives):
        doubts.append(doubt("alike"))
    if wild := unlike_sprockets(law.fit.noise):
        doubts.append(doubt("wild", law=best, what=wild))
    return [*doubts, *_implausible_values(law), *_mounting(law)]


def _implausible_values(law: FittedLaw) -> list[Doubt]:
    """Questions about ICRs inside their tracks and large radius errors."""
    doubts = []
    for name, value in law.values.items():
        if name.startswith("offset") and name in law.interval95 and law.interval95[name][1] < 0:
            doubts.append(doubt("inside", law=law.name, name=name, value=1e3 * value, error=1e3 * law.stderr[name]))
        if name.startswith("radius_error") and abs(value) > _LARGE_RADIUS_ERROR:
            doubts.append(doubt("far", law=law.name, name=name, value=value, times=1 + value))
    return doubts


def _mounting(law: DriveFit) -> list[Doubt]:
    """Estimates of the sensor's mounting and clock that are neither chance nor negligible."""
    told = []
    for name, (unit, factor, least, words, positive, negative) in _SENSOR.items():
        value, error = factor * law.extras[name], factor * law.stderr.get(name, np.inf)
        if abs(value) > max(_CERTAIN * error, least):
            size = f"{abs(value):.3g} ± {error:.2g} {unit}"
            told.append(doubt("sensor", what=words.format(size, positive if value > 0 else negative)))
    return told


def _left_out(law: DriveFit) -> list[Doubt]:
    """Poses and steps that were left out of the drives."""
    total, doubts = law.left_out + law.poses, []
    if law.left_out > MANY * total:
        what = f"{law.left_out:,} of {counted(total, 'pose')}"
        why = "are clocks and geometry right, or do the poses jump?"
        doubts.append(doubt("left out", what=what, share=100 * law.left_out / total, why=why))
    if law.breaks:
        doubts.append(doubt("breaks", what=counted(law.breaks, "step")))
    return doubts


def _halves(law: DriveFit) -> list[Doubt]:
    """Parameters that differ between the two halves of the way by more than their joint intervals allow."""
    fit, first = law.fit, law.fit.nodes.first
    way = np.append(0.0, np.cumsum(fit.residuals.way))
    if len(first) > 2:  # whole drives, by their middles
        way = np.repeat((way[first[:-1]] + way[first[1:] - 1]) / 2, np.diff(first))
    early = way < fit.residuals.way.sum() / 2
    try:
        halves = [refitted(fit, rows) for rows in (early, ~early)]
        (a, wide_a), (b, wide_b) = ((half.values[half.free], half_widths(half)) for half in halves)
    except (LogError, np.linalg.LinAlgError):
        return []  # a half tells too little
    normal = scipy.special.ndtri
    many = normal(1 - (1 - CONFIDENCE) / 2 / max(len(a), 1)) / normal((1 + CONFIDENCE) / 2)  # Bonferroni
    told = []
    for k in np.flatnonzero(np.abs(a - b) > many * np.hypot(wide_a, wide_b)):
        name = law.free[k]
        unit = EXTRAS[name].unit if name in EXTRAS else FAMILIES[law.name].parameters[name].unit
        told.append(f"{name} {a[k]:.3g} ± {wide_a[k]:.2g} and {b[k]:.3g} ± {wide_b[k]:.2g} {unit}".rstrip())
    return [doubt("halves", law=law.name, what=", ".join(told))] if told else []


def _little(law: DriveFit) -> list[Doubt]:
    """Parameters that the driving leaves open, and too short a way."""
    told, doubts = [], []
    way, gauge = float(law.fit.residuals.way.sum()), law.fit.model.geometry.half_gauge
    if way < _SHORT_WAY * gauge:
        told.append(f"the belts drive {way:.2g} m, which is less than {_SHORT_WAY:g} half gauges")
    for name, why in law.held.items():
        if why.startswith("not determined"):
            value = law.values.get(name, law.extras.get(name, 0.0))
            line = doubt("held", name=name, value=value, why=why)
            if name in law.values or name == "sensor_y":  # without it, D may be wrong
                told.append(line)
            else:
                doubts.append(line)
    return [*([doubt("little", what="; ".join(told))] if told else []), *doubts]
