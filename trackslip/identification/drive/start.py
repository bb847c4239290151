"""Starting values: clock offset and ratio of turns from comparing turns or paths, and the trajectory from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.drive.drives import Drive
from trackslip.kinematics import Array, RobotGeometry, body_twist, wrap_angle

_OFFSETS = np.arange(-2.0, 2.0001, 0.05)  # clock offsets tried [s]
_FINE = np.arange(-0.06, 0.0601, 0.01)  # around the best of them [s]
_TURN_RATIOS = 1 / (1 + np.concatenate([np.arange(-0.3, 1.61, 0.1), np.arange(1.8, 3.01, 0.2)]))  # b / (b + D)
_TURN_TIME = 1.0  # over which turns are compared [s]
_WINDOW = 10.0  # of paths that are laid over each other, without headings [s]
_CAP = 3.0  # deviations beyond which turns count no further [median deviations]
_RATIO_LIMITS = (0.2, 2.0)


def start(drives: Sequence[Drive], geometry: RobotGeometry) -> tuple[float, float]:
    """Offset D of a constant ICR [m] and clock offset [s] that fit the drives best."""
    ratios = np.ones(1) if all(drive.has_heading for drive in drives) else _TURN_RATIOS

    def best(offsets: Array) -> tuple[float, float, float]:
        tried = [
            (cost, ratio, float(offset))
            for offset in offsets
            for ratio, cost in _costs(drives, geometry, float(offset), ratios)
        ]
        return min(tried)

    _, ratio, offset = best(_OFFSETS)
    _, ratio, offset = best(offset + _FINE)
    return geometry.half_gauge * (1 / float(np.clip(ratio, *_RATIO_LIMITS)) - 1), offset


def trajectory(drive: Drive, geometry: RobotGeometry, offset: float, clock_offset: float) -> Array:
    """States (K, 3) of a drive's nodes: measured, else dead reckoned with D = `offset` [m]."""
    ratio = geometry.half_gauge / (geometry.half_gauge + offset)
    place, heading = reckoned(drive, geometry, ratio, drive.time + clock_offset)
    measured = np.isfinite(drive.pose[:, 0])
    z = drive.pose[:, 0] + 1j * drive.pose[:, 1]
    if drive.has_heading:
        known = np.isfinite(drive.pose[:, 2])
        turned = np.unwrap(drive.pose[known, 2] - heading[known])
        turned = np.interp(drive.time, drive.time[known], turned)
    else:
        turned = _turned_to(place, np.where(measured, z, 0), measured, drive.time)
    last = np.maximum.accumulate(np.where(measured, np.arange(len(z)), -1))
    last = np.where(last < 0, int(np.argmax(measured)), last)
    at = np.where(measured, z, z[last] + np.exp(1j * turned[last]) * (place - place[last]))
    return np.column_stack([at.real, at.imag, heading + turned])


def reckoned(drive: Drive, geometry: RobotGeometry, ratio: float, time: Array) -> tuple[np.ndarray, Array]:
    """Complex places [m] and headings [rad] (K,) at encoder times, from sprocket speeds whose turns are scaled."""
    v, w = body_twist(drive.omega, 0.0, geometry).T
    step = np.diff(drive.edges)
    heading = np.concatenate([[0.0], np.cumsum(ratio * w * step)])
    middle = (heading[1:] + heading[:-1]) / 2
    place = np.concatenate([[0.0], np.cumsum(v * step * np.exp(1j * middle))])
    return np.interp(time, drive.edges, place), np.interp(time, drive.edges, heading)


def _costs(drives: Sequence[Drive], geometry: RobotGeometry, offset: float, ratios: Array) -> list[tuple[float, float]]:
    """Ratios of turns and the costs that they leave, at a clock offset."""
    if len(ratios) == 1:
        real, commanded = (
            np.concatenate(parts) for parts in zip(*(_turns(d, geometry, offset) for d in drives), strict=True)
        )
        power = float(commanded @ commanded)
        ratio = float(real @ commanded) / power if power > 0 else 1.0
        for _ in range(3):  # a few times, because turns across a jump must not count
            deviation = np.abs(real - ratio * commanded)
            weight = deviation <= _CAP * 1.4826 * np.median(deviation)
            power = float(np.sum(weight * commanded**2))
            ratio = float(np.sum(weight * real * commanded)) / power if power > 0 else 1.0
        deviation = np.abs(real - ratio * commanded)
        return [(ratio, float(np.mean(np.minimum(deviation, 0.2))))]
    return [(float(ratio), sum(_misfit(drive, geometry, offset, float(ratio)) for drive in drives)) for ratio in ratios]


def _turns(drive: Drive, geometry: RobotGeometry, offset: float) -> tuple[Array, Array]:
    """Measured and commanded turns between poses about _TURN_TIME apart [rad]."""
    known = np.flatnonzero(np.isfinite(drive.pose[:, 2]))
    time, phi = drive.time[known], drive.pose[known, 2]
    stride = min(max(1, round(_TURN_TIME / drive.interval)), max(1, len(time) - 1))
    _, heading = reckoned(drive, geometry, 1.0, time + offset)
    near = time[stride:] - time[:-stride] < 3 * _TURN_TIME + 3 * drive.interval
    return (phi[stride:] - phi[:-stride])[near], (heading[stride:] - heading[:-stride])[near]


def _misfit(drive: Drive, geometry: RobotGeometry, offset: float, ratio: float) -> float:
    """Median distance of windows of dead reckoning, each laid over the measured positions [m]."""
    measured = np.flatnonzero(np.isfinite(drive.pose[:, 0]))
    time = drive.time[measured]
    place, _ = reckoned(drive, geometry, ratio, time + offset)
    z = drive.pose[measured, 0] + 1j * drive.pose[measured, 1]
    size = min(max(6, round(_WINDOW / drive.interval)), len(z))
    firsts = np.arange(0, len(z) - size + 1, max(1, size // 2))
    rows = firsts[:, None] + np.arange(size)
    if not len(rows):
        raise LogError(f"run {drive.name!r}: too few poses")
    a, c = (values[rows] - values[rows].mean(axis=1, keepdims=True) for values in (z, place))
    squares = np.sum(np.abs(a) ** 2 + np.abs(c) ** 2, axis=1) - 2 * np.abs(np.sum(a * c.conj(), axis=1))
    return float(np.median(np.sqrt(np.maximum(squares, 0) / size)))


def _turned_to(place: np.ndarray, z: np.ndarray, measured: np.ndarray, time: Array) -> Array:
    """Angles (K,) that turn dead reckoning onto the positions within a window around each node."""
    columns = np.stack([measured, measured * z, measured * place, measured * z * place.conj()])
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum(columns, axis=1)], axis=1)
    low = np.searchsorted(time, time - _WINDOW / 2)
    high = np.searchsorted(time, time + _WINDOW / 2, side="right")
    number, a, c, product = sums[:, high] - sums[:, low]
    return np.unwrap(np.angle(product - a * c.conj() / np.maximum(number.real, 1)))


def wrapped_difference(a: Array, b: Array) -> Array:
    """a - b (...) in [-pi, pi)."""
    return wrap_angle(a - b)
