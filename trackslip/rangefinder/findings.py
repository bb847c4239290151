"""What a reader should know of a session: how much of it was located, and what looks wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.localization.scan import Plate
from trackslip.rangefinder.session import Sighting
from trackslip.rangefinder.size import fitting_size

_FEW = 0.5  # share of the scans with a pose below which that is told
_BUSY = 0.02  # share of the scans with something else moving above which that is told
_ROUGH = 1.5  # scatter on the plate over the noise above which that is told [-]
_NO_TURN = 1e-3  # turn of the plate per radian of the sprockets below which it hasn't turned


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
