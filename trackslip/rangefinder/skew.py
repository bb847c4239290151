"""Ranges of a plate that moves during the scan, as if it had stood still where its middle beam met it."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.bound import directed, range_jacobian
from trackslip.localization.scan import Plate
from trackslip.rangefinder.moving import around_plate

_WORTH = 0.1  # correction below which ranges are left as they are [standard deviations]


def straightened(
    ranges: np.ndarray, bearings: Array, lag: Array, plate: Plate, pose: Array, rate: Array, noise: float
) -> np.ndarray:
    """Ranges (S, B) of plates at poses (S, 3) that move at `rate` (S, 3) [m/s, m/s, rad/s], in the scanner's frame.

    To first order, a range changes by its gradient times the way of the plate between the beam's time, `lag` (B,) after
    the first beam's, and that of the plate's middle beam. The arrays are those given where that is nothing.
    """
    middle = np.interp(np.arctan2(pose[:, 1], pose[:, 0]), bearings, lag)
    on = around_plate(bearings, ranges, plate, pose) & np.isfinite(ranges)
    row, beam = np.nonzero(on)
    late = lag[beam] - middle[row]
    if not late.any():
        return ranges
    width = on.sum(axis=1)
    place = np.arange(len(row)) - np.repeat(np.cumsum(width) - width, width)
    bearing = np.zeros((len(pose), int(width.max(initial=1))))
    bearing[row, place] = bearings[beam]
    gradient = range_jacobian(pose, plate, directed(bearing))[row, place]
    change = late * np.einsum("hi,hi->h", gradient, rate[row])
    if np.abs(change).max(initial=0.0) < _WORTH * noise:
        return ranges
    result = ranges.copy()
    result[row, beam] -= change
    return result
