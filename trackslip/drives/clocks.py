"""The offset between the encoder and pose clocks, from the correlations of speeds and of turns at
all time shifts.

The offset is independent of gains and of the signs of turns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip.drives.drive import Drive
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.checks import unwrapped

# largest offset that a fit finds by itself; also the prior's standard deviation in `path.EXTRAS`
# [s]
NEAR: Final = 2.0
GRID: Final = 0.1  # step of the common time grid, and the clock error that gains allow for [s]
# half the time over which velocities are computed: noise of 2 cm then becomes 3 cm/s [s]
_HALF: Final = 0.5
_FITS: Final = 0.5  # least share of the variance that a credible clock offset explains


@dataclass(frozen=True)
class Clock:
    """The offset between the encoder and pose clocks of a drive."""

    offset: float  # encoder clock minus pose clock [s]; 0 if the motion doesn't determine it
    # share of the variance in speeds and yaw rates that the wheels explain at this offset
    share: float = 0.0
    # true if every other offset leaves at least twice as much variance unexplained
    distinct: bool = False


def median_offset(clocks: Iterable[Clock]) -> float:
    """Median of the clock offsets up to NEAR that could be determined from motion [s]; 0 if there
    are none.
    """
    return float(
        np.median(
            [each.offset for each in clocks if each.share > 0 and abs(each.offset) <= NEAR] or [0.0]
        )
    )


def clock_of_drive(drive: Drive) -> Clock:
    """The clock offset at which a drive's encoders and poses match best; offsets above NEAR must
    match much better.
    """
    poses = np.column_stack([drive.time, drive.pose])
    if drive.beyond is not None:
        poses = np.concatenate([poses, drive.beyond])
        poses = poses[np.argsort(poses[:, 0], kind="stable")]
    time = poses[:, 0]
    half = max(_HALF, 2 * drive.interval)
    step = max(GRID, max(drive.edges[-1] - drive.edges[0], time[-1] - time[0]) / 200_000)
    of_poses, of_wheels = (np.arange(t[0] + half, t[-1] - half, step) for t in (time, drive.edges))
    if min(len(of_poses), len(of_wheels)) < 2 * NEAR / step:
        return Clock(0.0)
    left, right = (drive.angles(of_wheels + half) - drive.angles(of_wheels - half)) / (2 * half)
    speed, turn = _velocities(time, poses[:, 1:], of_poses, half)
    least = round(10 * _HALF / step)
    shares = np.stack(
        [
            _shared(speed, np.abs(right + left), least, positive=True),
            _shared(turn, right - left, least),
        ]
    )
    weights = shares.max(axis=1)
    share = weights @ shares / max(weights.sum(), 1e-9)
    offset = drive.edges[0] - time[0] + np.arange(1 - len(of_poses), len(of_wheels)) * step
    best = int(np.argmax(share))
    others = share[np.abs(offset - offset[best]) > 3.0]  # drivers change speed every few seconds
    distinct = bool(share[best] >= _FITS and 1 - others.max(initial=0.0) >= 2 * (1 - share[best]))
    near = np.abs(offset) <= NEAR
    if not distinct:
        best = int(np.argmax(np.where(near, share, -1.0)))
    if share[best] < _FITS or not (distinct or near.any()):
        return Clock(0.0, float(share[best]) if near.any() else 0.0)
    between = 0.0
    if 0 < best < len(share) - 1:  # the top of a parabola through three points
        before, at, after = share[best - 1 : best + 2]
        bend = before - 2 * at + after
        between = float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0
    return Clock(float(offset[best]) + between * step, float(share[best]), distinct)


def _velocities(time: Array, pose: Array, grid: Array, half: float) -> tuple[Array, Array]:
    """Measured speeds (N,) [m/s] and yaw rates (N,) [rad/s] around the times `grid` (N,); NaN where
    unknown.
    """
    placed, headed = np.isfinite(pose[:, 0]), np.isfinite(pose[:, 2])
    speed, turn = np.full(len(grid), np.nan), np.full(len(grid), np.nan)
    if placed.sum() > 2:
        place = pose[placed, 0] + 1j * pose[placed, 1]
        before, here, after = (
            np.interp(grid + at, time[placed], place) for at in (-half, 0.0, half)
        )
        speed = np.abs(after - before) / (2 * half)
        course = np.angle((after - here) * np.conj(here - before))
        course = wrap_angle(2 * course) / 2  # a robot may reverse
        slow = (
            np.minimum(np.abs(after - here), np.abs(here - before))
            < 0.3 * np.sqrt(np.mean(speed**2)) * half
        )
        turn = np.where(slow, np.nan, course / half)
        speed[_far(time[placed], grid, half)] = turn[_far(time[placed], grid, half)] = np.nan
    if headed.sum() > 2:
        heading = unwrapped(pose[headed, 2])
        begin, end = (np.interp(grid + at, time[headed], heading) for at in (-half, half))
        turn = np.where(_far(time[headed], grid, half), np.nan, (end - begin) / (2 * half))
    return _limited(speed), _limited(turn)


def _limited(values: Array) -> Array:
    """Replace outliers in values (N,), such as those from jumps in poses, with NaN."""
    size = np.abs(values)
    if np.isnan(size).all():
        return values
    return np.where(size <= 1.5 * np.nanquantile(size, 0.95), values, np.nan)


def _far(time: Array, grid: Array, half: float) -> np.ndarray:
    """(N,) bool: true for times `grid` (N,) that lie in a gap between successive values of
    `time`.
    """
    row = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return np.asarray(time[row] - time[row - 1] > 2 * half)


def _shared(values: Array, by: Array, least: int, positive: bool = False) -> Array:
    """Squared correlation (S,) of values (N,) with the wheels' values `by` (M,), at each shift (S =
    N + M - 1).

    It is 0 if fewer than `least` points or half the shorter series overlap and, with `positive`, if
    it is negative.
    """
    known = np.isfinite(values)
    if known.sum() < least:
        return np.zeros(len(values) + len(by) - 1)
    values = np.where(known, values - values[known].mean(), 0.0)
    present, everywhere, by = known.astype(float), np.ones(len(by)), by - by.mean()

    def sums(a: Array, b: Array) -> Array:
        size = len(a) + len(b) - 1
        return np.asarray(np.fft.irfft(np.fft.rfft(b, size) * np.fft.rfft(a[::-1], size), size))

    count = np.maximum(sums(present, everywhere), 0.5)
    mean, mean_by = sums(values, everywhere) / count, sums(present, by) / count
    variance, variance_by = (
        sums(values**2, everywhere) / count - mean**2,
        sums(present, by**2) / count - mean_by**2,
    )
    covariance = sums(values, by) / count - mean * mean_by
    if positive:
        covariance = covariance.clip(min=0.0)
    enough = count >= max(least, 0.5 * min(known.sum(), len(by)))
    enough &= (variance > 0.1 * np.mean(values[known] ** 2)) & (
        variance_by > 1e-3 * by.var() + 1e-12
    )
    return np.where(enough, covariance**2 / np.where(enough, variance * variance_by, 1.0), 0.0)
