"""Whether the plate has the size that was stated: the ranges fit another one better if it has not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import Beams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.scan import Plate, Scan, extract_plate

_LENGTHS = (0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98, 1.02, 1.04, 1.07, 1.1, 1.15, 1.2, 1.3)  # of the one stated
_THICKNESSES = (0.3, 0.5, 0.7, 1.4, 2.0, 3.0)  # likewise
_SCANS = 150  # compared
_HUBER = 3.0
_ITERATIONS = 6
_MIN_GAIN = 12.0  # fall of the negative log likelihood that isn't chance
_MIN_RETURNS = 8


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
    beams, start = Beams.of(part, cluster.take(full)), pose[rows][full]
    sizes = [(plate.length * factor, plate.thickness) for factor in _LENGTHS]
    sizes += [(plate.length, plate.thickness * factor) for factor in _THICKNESSES]
    others = [Plate(*size) for size in sizes if size[1] < size[0]]
    stated, *costs = (
        PlateLikelihood(one, _HUBER).climb(beams, start, _ITERATIONS).cost.sum() for one in (plate, *others)
    )
    best = int(np.argmin(costs))
    return others[best] if costs[best] < stated - _MIN_GAIN else None
