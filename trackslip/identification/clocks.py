"""The offset between the clocks of encoders and poses, by the correlation of speeds and turns at all shifts.

Neither gains nor signs matter: at each shift, the sizes of the measured velocities are regressed on those of speed and
turn by the wheels, and the measured yaw rates on the speeds of both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.checks import unwrapped

NEAR = 2.0
"""Offset that a fit finds by itself from a start value [s]: its prior (`path.EXTRAS`)."""
_GRID, _MOST = 0.1, 200_000  # step of the common grid [s], and its largest number of points
_HALF = 0.5  # half of the time over which velocities are taken [s]: noise of 2 cm is 3 cm/s then
_FITS = 0.5  # share of the variance that a clock explains at least
_APART = 3.0  # shifts [s] that are other ones, for drivers who change speed every few seconds


@dataclass(frozen=True)
class Clock:
    """How the clocks of a drive agree."""

    offset: float
    """Encoder clock minus pose clock [s]; 0 where the motion doesn't show it."""
    share: float
    """Of the variance of speeds and yaw rates that wheels explain with this offset."""
    distinct: bool
    """True if no other offset leaves less than twice the variance."""


def clock_of(drives: Sequence[PreparedDrive]) -> float:
    """The median of the drives' offsets, where motion shows them [s]; 0 if it is more than a fit would find."""
    offsets = [clock.offset for clock in map(clock_of_drive, drives) if clock.share > 0]
    offset = float(np.median(offsets or [0.0]))
    return offset if abs(offset) <= NEAR else 0.0


def clock_of_drive(drive: PreparedDrive) -> Clock:
    """The offset at which encoders and poses of a drive fit best: near 0 unless a farther one is much better."""
    time, pose = drive.every_pose
    begin = float(drive.edges[0] - time[0])
    length = max(drive.edges[-1] - drive.edges[0], time[-1] - time[0])
    half = max(_HALF, 2 * drive.interval)
    step = max(_GRID, length / _MOST)
    of_poses = np.arange(time[0] + half, time[-1] - half, step)
    of_wheels = np.arange(drive.edges[0] + half, drive.edges[-1] - half, step)
    if min(len(of_poses), len(of_wheels)) < 2 * NEAR / step:
        return Clock(0.0, 0.0, False)
    measured, wheels = _by_poses(time, pose, of_poses, half), _by_wheels(drive, of_wheels, half)
    lag, share = _explained(measured, wheels, round(2 * _HALF * 5 / step))
    offset = begin + lag * step
    best = int(np.argmax(share))
    others = share[np.abs(lag - lag[best]) * step > _APART]
    distinct = bool(share[best] >= _FITS and 1 - others.max(initial=0.0) >= 2 * (1 - share[best]))
    if not distinct:
        near = np.abs(offset) <= NEAR
        if not near.any():
            return Clock(0.0, 0.0, False)
        best = int(np.flatnonzero(near)[np.argmax(share[near])])
    if share[best] < _FITS:
        return Clock(0.0, float(share[best]), False)
    between = 0.0
    if 0 < best < len(share) - 1:
        before, at, after = share[best - 1 : best + 2]
        bend = before - 2 * at + after
        between = float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0
    return Clock(float(offset[best]) + between * step, float(share[best]), distinct)


def _by_poses(time: Array, pose: Array, grid: Array, half: float) -> tuple[Array, Array]:
    """Sizes of velocities [m/s] and yaw rates [rad/s] (N,) around times of a grid, NaN where not known."""
    placed, headed = np.isfinite(pose[:, 0]), np.isfinite(pose[:, 2])
    speed, turn = np.full(len(grid), np.nan), np.full(len(grid), np.nan)
    if placed.sum() > 2:
        place = pose[placed, 0] + 1j * pose[placed, 1]
        before, here, after = (np.interp(grid + at, time[placed], place) for at in (-half, 0.0, half))
        speed = np.abs(after - before) / (2 * half)
        course = np.angle((after - here) * np.conj(here - before))
        course = wrap_angle(2 * course) / 2  # a robot may reverse
        slow = np.minimum(np.abs(after - here), np.abs(here - before)) < 0.3 * np.sqrt(np.mean(speed**2)) * half
        turn = np.where(slow, np.nan, course / half)
        speed[_far(time[placed], grid, half)] = turn[_far(time[placed], grid, half)] = np.nan
    if headed.sum() > 2:
        heading = unwrapped(pose[headed, 2])
        turn = (np.interp(grid + half, time[headed], heading) - np.interp(grid - half, time[headed], heading)) / 2
        turn /= half
        turn[_far(time[headed], grid, half)] = np.nan
    return _limited(speed), _limited(turn)


def _limited(values: Array) -> Array:
    """Values (N,), NaN for those out of all proportion, as where poses jump."""
    known = np.isfinite(values)
    if not known.any():
        return values
    most = 1.5 * float(np.quantile(np.abs(values[known]), 0.95))
    return np.where(known & (np.abs(values) <= most), values, np.nan)


def _far(time: Array, grid: Array, half: float) -> np.ndarray:
    """(N,) bool: whether a time of the grid lies in a gap."""
    row = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return np.asarray(time[row] - time[row - 1] > 2 * half)


def _by_wheels(drive: PreparedDrive, grid: Array, half: float) -> Array:
    """Mean speeds (2, N) of both sprockets around times of a grid [rad/s]."""
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(drive.omega * np.diff(drive.edges)[:, None], axis=0)])
    return np.stack(
        [np.interp(grid + half, drive.edges, a) - np.interp(grid - half, drive.edges, a) for a in angle.T]
    ) / (2 * half)


def _explained(measured: tuple[Array, Array], wheels: Array, least: int) -> tuple[np.ndarray, Array]:
    """Shifts (S,) of the wheels' grid against the poses', and the share of the variance that wheels explain there.

    Shifts count that leave half of the shorter part, and `least` points.
    """
    left, right = wheels
    sizes = np.stack([np.abs(right + left), np.abs(right - left)])
    speed, turn = measured
    shares = [_share(speed, sizes, least, positive=True), _share(turn, wheels, least)]
    weights = np.array([share.max() for share in shares])
    count, length = len(measured[0]), wheels.shape[-1]
    return np.arange(1 - count, length), np.asarray(weights @ np.stack(shares) / max(weights.sum(), 1e-9))


def _share(values: Array, by: Array, least: int, positive: bool = False) -> Array:
    """Share (S,) of the variance of values (N,) that a regression on those of the wheels (2, M) explains.

    Only terms with `positive` coefficients count, if need be: sizes grow together.
    """
    known = np.isfinite(values)
    if known.sum() < least:
        return np.zeros(len(values) + by.shape[-1] - 1)
    values = np.where(known, values - values[known].mean(), 0.0)
    by = by - by.mean(axis=1, keepdims=True)
    size = scipy.fft.next_fast_len(len(values) + by.shape[-1])

    def sums(a: Array, b: Array) -> Array:
        spectrum = np.conj(scipy.fft.rfft(a, size)) * scipy.fft.rfft(b, size)
        return np.asarray(np.roll(scipy.fft.irfft(spectrum, size), len(a) - 1)[: len(a) + by.shape[-1] - 1])

    present, all_there = known.astype(float), np.ones(by.shape[-1])
    count = np.maximum(sums(present, all_there), 0.5)
    mean = sums(values, all_there) / count
    variance = sums(values**2, all_there) / count - mean**2
    means = [sums(present, b) / count for b in by]
    with_each = np.stack([sums(values, b) / count - mean * m for b, m in zip(by, means, strict=True)])
    between = np.stack(
        [
            [sums(present, a * b) / count - m * k for b, k in zip(by, means, strict=True)]
            for a, m in zip(by, means, strict=True)
        ]
    )
    floor = 1e-3 * float(np.trace(np.cov(by))) + 1e-12
    matrix = np.moveaxis(between, -1, 0) + floor * np.eye(2)
    slope = np.linalg.solve(matrix, with_each.T[..., None])[..., 0]
    explained = np.einsum("fs,sf->s", with_each, slope.clip(min=0.0) if positive else slope)
    enough = (count >= max(least, 0.5 * min(known.sum(), by.shape[-1]))) & (
        variance > 0.1 * np.mean(values[known] ** 2)
    )
    return np.where(enough, np.clip(explained / np.maximum(variance, 1e-12), 0.0, 1.0), 0.0)
