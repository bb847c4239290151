"""Motion in the scans: what moves besides the plate, and ranges of a plate that moves during a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, wrap_angle
from trackslip.localization.bound import directed, range_jacobian
from trackslip.localization.returns import Returns
from trackslip.localization.scan import MAX_GAP, Plate, Scan, returns_of
from trackslip.rangefinder.background import Background
from trackslip.rangefinder.series import ScanSeries

_MARGIN = 0.1  # around a plate, where beams tell nothing of the background [m]
_BESIDE = 0.3  # distance from the plate of returns that are from something else [m]
_MIN_RETURNS = 5  # of something else in a scan, at least
_LENGTH = 90.0  # percentile of the lengths seen: the plate is seen broadside now and then [%]
_WORTH = 0.1  # correction below which ranges are left as they are [standard deviations]


@dataclass(frozen=True)
class Moving:
    """Moving objects in the scans."""

    share: float
    """Share of the scans with another moving object than the plate [-]."""
    length: float
    """Length of the largest moving thing in a scan, exceeded in a tenth of the scans [m]; NaN if nothing moves."""


def moving_things(scan: Scan, plate: Plate, pose: Array, valid: np.ndarray) -> Moving:
    """Moving objects in scans with ranges (S, B) whose plates are at poses (S, 3), where `valid` (S,)."""
    returns = returns_of(scan)
    away = plate.outside(pose, returns.row, returns.x, returns.y) > _BESIDE
    others = np.bincount(returns.row[away], minlength=len(pose)) >= _MIN_RETURNS
    share = float(others[valid].mean()) if valid.any() else 0.0
    return Moving(share, _length(returns, len(pose)))


def _length(returns: Returns, scans: int) -> float:
    if not len(returns.row):
        return float("nan")
    pieces = returns.split(MAX_GAP)
    large = pieces.count >= _MIN_RETURNS
    longest = np.zeros(scans)
    np.maximum.at(longest, pieces.row[large], pieces.extent[large])
    seen = longest > 0
    return float(np.percentile(longest[seen], _LENGTH)) if seen.any() else float("nan")


def around_plate(bearings: Array, ranges: np.ndarray, plate: Plate, pose: Array) -> np.ndarray:
    """(S, B) bool: beams that may have met plates at poses (S, 3) in the scanner's frame, going by their ranges."""
    radius = np.hypot(plate.length, plate.thickness) / 2 + _MARGIN
    distance = np.maximum(np.hypot(pose[:, 0], pose[:, 1]), radius)[:, None]
    off = wrap_angle(bearings - np.arctan2(pose[:, 1], pose[:, 0])[:, None])
    towards = np.abs(off) < np.arcsin(radius / distance)
    return np.asarray(towards & ~(np.abs(ranges - distance) > radius))


def cut_where_nothing_moves(series: ScanSeries, background: Background) -> ScanSeries:
    """A full circle that begins where fewest returns move."""
    tolerance = background.tolerance(background.noise or 0.0)
    moves = np.isfinite(series.ranges) & ~(np.abs(series.ranges - background.level) < tolerance)
    count = moves.sum(axis=0)
    beams = len(count)
    window = beams // 8
    around = np.cumsum(np.concatenate([count, count, count]))
    sums = around[beams + window : 2 * beams + window] - around[beams - window : 2 * beams - window]
    return series.from_beam(int(np.argmin(sums)))


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
