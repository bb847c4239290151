"""Findings on a session: the share of located scans, odd motion or scatter, and the size of the plate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import PlateBeams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.scan import Plate, Scan, extract_plate
from trackslip.rangefinder.session import Sighting

_FEW = 0.5  # share of the scans with a pose below which that is told
_BUSY = 0.02  # share of the scans with something else moving above which that is told
_ROUGH = 1.5  # scatter on the plate over the noise above which that is told [-]
_NO_TURN = 1e-3  # turn of the plate per radian of the sprockets below which it hasn't turned
_LENGTHS = (0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98, 1.02, 1.04, 1.07, 1.1, 1.15, 1.2, 1.3)  # of the one stated
_THICKNESSES = (0.3, 0.5, 0.7, 1.4, 2.0, 3.0)  # likewise
_SCANS = 150  # compared
_HUBER = 3.0
_ITERATIONS = 6
_MIN_GAIN = 12.0  # fall of the negative log likelihood that isn't chance
_MIN_RETURNS = 8


def findings(seen: Sighting, plate: Plate) -> tuple[str, ...]:
    """A line for each."""
    valid, noise = seen.estimate.valid, seen.scan.noise
    share = float(valid.mean())
    found = [*seen.series.notes]
    if share < _FEW:
        found.append(f"the plate was located in {100 * share:.0f} % of the scans only")
    better = fitting_size(replace(seen.scan, ranges=seen.series.ranges[valid]), plate, seen.estimate.pose[valid])
    if better is not None:
        size, stated = (f"{one.length:.2g} x {one.thickness:.2g} m" for one in (better, plate))
        longest = f"; what moves is {seen.moving.length:.2f} m long" if np.isfinite(seen.moving.length) else ""
        found.append(f"the ranges fit a plate of about {size} better than {stated}{longest}: is its size right?")
    turn = float(seen.motion.matrix[2, 1] - seen.motion.matrix[2, 0])
    if turn < -_NO_TURN:
        found.append(
            "the plate turns against the sprockets: are left and right swapped, or is the scanner upside down?"
        )
    if seen.moving.share > _BUSY:
        found.append(
            f"something else moves in {100 * seen.moving.share:.0f} % of the scans; it isn't taken for the plate"
        )
    if seen.scatter > _ROUGH * noise:
        found.append(
            f"ranges scatter by {1e3 * seen.scatter:.1f} mm on the plate, and by {1e3 * noise:.1f} mm elsewhere: "
            "is it flat, upright and as thick as stated?"
        )
    if not seen.front:
        found.append("the robot only turns on the spot: which end of the plate is the front one isn't known")
    return tuple(found)


def fitting_size(scan: Scan, plate: Plate, pose: Array) -> Plate | None:
    """The plate, longer, shorter, thicker or thinner, that the ranges (S, B) fit much better; None if there is none.

    `pose` (S, 3) are the plate's poses in the scanner's frame, with the size stated.
    """
    rows = np.arange(len(pose))[:: -(-len(pose) // _SCANS)]
    part = replace(scan, ranges=scan.ranges[rows].astype(float))
    wide = replace(plate, length=plate.length * _LENGTHS[-1])
    cluster = extract_plate(part, wide, pose[rows])
    full = np.flatnonzero(cluster.count >= _MIN_RETURNS)
    if len(full) < _MIN_RETURNS:
        return None
    beams, start = PlateBeams.of(part, cluster.take(full)), pose[rows][full]
    sizes = [(plate.length * factor, plate.thickness) for factor in _LENGTHS]
    sizes += [(plate.length, plate.thickness * factor) for factor in _THICKNESSES]
    others = [Plate(*size) for size in sizes if size[1] < size[0]]
    stated, *costs = (
        PlateLikelihood(one, _HUBER).climb(beams, start, _ITERATIONS).cost.sum() for one in (plate, *others)
    )
    best = int(np.argmin(costs))
    return others[best] if costs[best] < stated - _MIN_GAIN else None
