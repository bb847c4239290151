"""The offset between the encoder and pose clocks, from the correlations of distances and of turns
at all time shifts.

The offset is independent of gains and of the signs of turns. It is searched over the whole length
of a drive: poses that are close together give speeds and yaw rates on a common time grid, poses
that are far apart give the distance and the turn from each pose to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from trackslip.drives.drive import Drive
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.checks import unwrapped_headings

# largest offset that a fit finds by itself; also the prior's standard deviation in `path.EXTRAS`
# [s]
NEAR: Final = 2.0
GRID: Final = 0.1  # step of the common time grid, and the clock error that gains allow for [s]
# half the time over which velocities are computed: noise of 2 cm then becomes 3 cm/s [s]
_HALF: Final = 0.5
_FITS: Final = 0.5  # least share of the variance that a credible clock offset explains
_APART: Final = (
    3.0  # least difference to another offset: drivers change speed every few seconds [s]
)
# least log-likelihood ratio of the best offset to all others; between unrelated motions, the best
# of all offsets is ahead of the second best by 3 in 1 % of drives
_EVIDENCE: Final = 5.0
_FEWEST_STEPS: Final = 10  # least number of steps from pose to pose that tell an offset
_MOST_STEPS: Final = 400  # most steps from pose to pose that are compared with the wheels
_MOST_CELLS: Final = 1_000_000  # most steps times offsets at a time, to limit memory
_LONGEST: Final = 200_000  # most points of a time grid
_EXACT: Final = 1e-4  # least share of the variance that is left unexplained


@dataclass(frozen=True)
class Clock:
    """The offset between the encoder and pose clocks of a drive."""

    offset: float  # encoder clock minus pose clock [s]; 0 if the motion doesn't determine it
    # share of the variance in speeds and yaw rates that the wheels explain at this offset
    share: float = 0.0
    # true if every other offset leaves at least twice as much variance unexplained
    distinct: bool = False
    checked: bool = False  # true if no offset above NEAR explains the motion as well


class _Shares(NamedTuple):
    """How well wheels and poses match at each of S offsets."""

    offset: Array  # (S,) ascending [s]
    share: Array  # (S,) share of the variance in distances and turns that the wheels explain
    motions: float  # number of independent motions


def median_offset(clocks: Iterable[Clock]) -> float:
    """Median of the clock offsets up to NEAR that could be determined from motion [s]; 0 if there
    are none.
    """
    near = [clock.offset for clock in clocks if clock.share > 0 and abs(clock.offset) <= NEAR]
    return float(np.median(near)) if near else 0.0


def clock_of_drive(drive: Drive) -> Clock:
    """The clock offset at which a drive's encoders and poses match best; offsets above NEAR must
    match much better.
    """
    time, pose = _all_poses(drive)
    rare = drive.interval > 2 * _HALF
    shares = _of_rare_poses(drive, time, pose) if rare else _of_dense_poses(drive, time, pose)
    if shares is None:
        return Clock(0.0)
    offset, share, motions = shares
    apart = max(_APART, 1.5 * drive.interval)
    near = np.abs(offset) <= NEAR

    # an offset above NEAR must leave all others behind
    best = int(np.argmax(share))
    others = share[np.abs(offset - offset[best]) > apart].max(initial=0.0)
    rest = 1 - share[best]
    ahead = _ahead(share[best], others, motions)
    distinct = bool(share[best] >= _FITS and 1 - others >= 2 * rest and ahead >= _EVIDENCE)
    if near.any() and not near[best]:
        nearest = float(share[near].max())
        distinct &= _ahead(share[best], nearest, motions) >= _EVIDENCE
    if not distinct:
        best = int(np.argmax(np.where(near, share, -1.0)))
    # between poses far apart, an offset that isn't distinct is no better than none
    credible = distinct or (near.any() and not rare)
    if share[best] < _FITS or not credible:
        return Clock(0.0, float(share[best]) if near.any() else 0.0)

    far = share[np.abs(offset) > max(NEAR, apart)].max(initial=0.0)
    checked = bool(near[best] and _ahead(share[best], far, motions) >= _EVIDENCE)
    exact = _top_of_parabola(offset, share, best)
    found = Clock(exact, float(share[best]), distinct, checked)
    if not rare:
        return found
    found = _refined(found, drive, time, pose)
    # the offsets up to NEAR are as likely as one that is slightly above
    return replace(found, offset=float(np.clip(found.offset, -NEAR, NEAR))) if near[best] else found


def _ahead(share: float, other: float, motions: float) -> float:
    """Log-likelihood ratio of an offset to another, from the shares of the variance that they
    explain in `motions` independent motions.
    """
    least = 1e-9
    return 0.5 * motions * math.log(max(1 - other, least) / max(1 - share, least))


def _all_poses(drive: Drive) -> tuple[Array, Array]:
    """Times (K,) and poses (K, 3) of a drive in ascending order, also those outside the encoder
    readings.
    """
    if drive.beyond is None:
        return drive.time, drive.pose
    time = np.append(drive.time, drive.beyond[:, 0])
    pose = np.concatenate([drive.pose, drive.beyond[:, 1:]])
    order = np.argsort(time, kind="stable")
    return time[order], pose[order]


def _top_of_parabola(offset: Array, share: Array, best: int) -> float:
    """The offset at the top of a parabola through the best share and its neighbours [s]."""
    if not 0 < best < len(share) - 1:
        return float(offset[best])
    before, at, after = share[best - 1 : best + 2]
    bend = before - 2 * at + after
    if bend >= 0:
        return float(offset[best])
    step = offset[best + 1] - offset[best]
    return float(offset[best] + np.clip((before - after) / (2 * bend), -0.5, 0.5) * step)


def _combined(of_distances: Array, of_turns: Array) -> Array:
    """Shares (S,) of both distances and turns, weighted by how well each can match."""
    shares = np.stack([of_distances, of_turns])
    weights = shares.max(axis=1)
    return np.asarray(weights @ shares / max(weights.sum(), 1e-9))


# poses that are close together


def _of_dense_poses(drive: Drive, time: Array, pose: Array) -> _Shares | None:
    """Shares from speeds and yaw rates on a common time grid; None if the drive is too short."""
    duration = max(drive.edges[-1] - drive.edges[0], time[-1] - time[0])
    step = max(GRID, duration / _LONGEST)
    half = max(_HALF, 2 * drive.interval)
    of_poses = np.arange(time[0] + half, time[-1] - half, step)
    of_wheels = np.arange(drive.edges[0] + half, drive.edges[-1] - half, step)
    if min(len(of_poses), len(of_wheels)) < 2 * NEAR / step:
        return None
    turned = drive.angles(of_wheels + half) - drive.angles(of_wheels - half)
    left, right = turned / (2 * half)
    least = round(10 * _HALF / step)
    speed = _speeds(time, pose, of_poses, half)
    turn = _yaw_rates(time, pose, of_poses, half)
    shares = _combined(
        _shared(speed, np.abs(right + left), least, positive=True),
        _shared(turn, right - left, least),
    )
    shifts = np.arange(1 - len(of_poses), len(of_wheels))
    offset = drive.edges[0] - time[0] + shifts * step
    count = min(len(of_poses), len(of_wheels)) * step / (2 * half)
    return _Shares(offset, shares, count)


def _speeds(time: Array, pose: Array, grid: Array, half: float) -> Array:
    """Measured speeds (N,) around the times `grid` (N,) [m/s]; NaN where unknown."""
    placed = np.isfinite(pose[:, 0])
    if placed.sum() <= 2:
        return np.full(len(grid), np.nan)
    place = pose[placed, 0] + 1j * pose[placed, 1]
    before = np.interp(grid - half, time[placed], place)
    after = np.interp(grid + half, time[placed], place)
    speed = np.abs(after - before) / (2 * half)
    return _limited(np.where(_in_gaps(time[placed], grid, half), np.nan, speed))


def _yaw_rates(time: Array, pose: Array, grid: Array, half: float) -> Array:
    """Measured yaw rates (N,) around the times `grid` (N,), from headings or, without these, from
    the course of positions [rad/s]; NaN where unknown.
    """
    headed = np.isfinite(pose[:, 2])
    if headed.sum() > 2:
        heading = unwrapped_headings(pose[headed, 2])
        begin = np.interp(grid - half, time[headed], heading)
        end = np.interp(grid + half, time[headed], heading)
        rate = (end - begin) / (2 * half)
        return _limited(np.where(_in_gaps(time[headed], grid, half), np.nan, rate))
    placed = np.isfinite(pose[:, 0])
    if placed.sum() <= 2:
        return np.full(len(grid), np.nan)
    place = pose[placed, 0] + 1j * pose[placed, 1]
    here = np.interp(grid, time[placed], place)
    first = here - np.interp(grid - half, time[placed], place)
    second = np.interp(grid + half, time[placed], place) - here
    rate = _course_changes(first, second) / half
    return _limited(np.where(_in_gaps(time[placed], grid, half), np.nan, rate))


def _course_changes(first: np.ndarray, second: np.ndarray) -> Array:
    """Changes of course (N,) from complex motions `first` (N,) to the motions `second` (N,) that
    follow [rad]; NaN where either is too short to have a course.
    """
    course = np.angle(second * np.conj(first))
    course = wrap_angle(2 * course) / 2  # a robot may reverse
    size = np.sqrt(np.mean(np.abs(first + second) ** 2))
    shorter = np.minimum(np.abs(first), np.abs(second))
    return np.where(shorter < 0.15 * size, np.nan, course)


def _limited(values: Array) -> Array:
    """Replace outliers in values (N,), such as those from jumps in poses, with NaN."""
    size = np.abs(values)
    if np.isnan(size).all():
        return values
    return np.where(size <= 1.5 * np.nanquantile(size, 0.95), values, np.nan)


def _in_gaps(time: Array, grid: Array, half: float) -> np.ndarray:
    """(N,) bool: true for times `grid` (N,) that lie in a gap between successive values of
    `time`.
    """
    row = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return np.asarray(time[row] - time[row - 1] > 2 * half)


def _shared(values: Array, by: Array, least: int, positive: bool = False) -> Array:
    """Squared correlation (S,) of values (N,) with the wheels' values `by` (M,), at each shift (S =
    N + M - 1).

    It is 0 if fewer than `least` points or half the shorter series overlap and, with `positive`, if
    it is negative. With sums over the n points that overlap at a shift, the mean of the values is
    m = sum(v) / n, their variance sum(v²) / n - m², and their covariance with the wheels' values
    sum(v b) / n - m m_b. All sums at all shifts are correlations, computed by Fourier transforms.
    """
    known = np.isfinite(values)
    if known.sum() < least:
        return np.zeros(len(values) + len(by) - 1)
    # centred, so that rounding doesn't matter
    values = np.where(known, values - values[known].mean(), 0.0)
    by = by - by.mean()
    present = known.astype(float)
    everywhere = np.ones(len(by))

    def sums(a: Array, b: Array) -> Array:
        """Sums (S,) of products of a (N,) with b (M,) at each shift."""
        size = len(a) + len(b) - 1
        spectrum = np.fft.rfft(b, size) * np.fft.rfft(a[::-1], size)
        return np.asarray(np.fft.irfft(spectrum, size))

    count = np.maximum(sums(present, everywhere), 0.5)
    mean = sums(values, everywhere) / count
    mean_by = sums(present, by) / count
    variance = sums(values**2, everywhere) / count - mean**2
    variance_by = sums(present, by**2) / count - mean_by**2
    covariance = sums(values, by) / count - mean * mean_by
    if positive:
        covariance = covariance.clip(min=0.0)

    enough = count >= max(least, 0.5 * min(known.sum(), len(by)))
    enough &= variance > 0.1 * np.mean(values[known] ** 2)
    enough &= variance_by > 1e-3 * by.var() + 1e-12
    product = np.where(enough, variance * variance_by, 1.0)
    return np.where(enough, covariance**2 / product, 0.0)


# poses that are far apart


class _Steps(NamedTuple):
    """Values (n,) measured between the times `begin` (n,) and `end` (n,) of the pose clock [s]."""

    begin: Array
    end: Array
    value: Array


def _of_rare_poses(drive: Drive, time: Array, pose: Array) -> _Shares | None:
    """Shares from distances and turns between successive poses; None if these are too few.

    Between poses far apart, nothing is interpolated: at each offset, the wheels' distance and turn
    are read at the times of the same two poses.
    """
    step = min(drive.interval / 4, 1.0)
    first = drive.edges[0] - time[-1]
    last = drive.edges[-1] - time[0]
    step = max(step, (last - first) / _LONGEST)
    count = math.ceil((last - first) / step)
    # a grid that contains 0
    offset = step * np.arange(math.floor(first / step), math.floor(first / step) + count + 1)
    distances = _distances(time, pose)
    turns = _turns(time, pose)
    if max(len(distances.value), len(turns.value)) < _FEWEST_STEPS:
        return None
    shares = _shares_at(drive, distances, turns, offset)
    return _Shares(offset, shares, max(len(distances.value), len(turns.value)))


def _refined(clock: Clock, drive: Drive, time: Array, pose: Array) -> Clock:
    """A clock of rare poses with the best offset on a grid as fine as for dense poses."""
    around = min(drive.interval / 4, 1.0)
    offset = clock.offset + np.arange(-around, around + GRID / 2, GRID / 2)
    shares = _shares_at(drive, _distances(time, pose), _turns(time, pose), offset)
    best = int(np.argmax(shares))
    return replace(clock, offset=_top_of_parabola(offset, shares, best), share=float(shares[best]))


def _shares_at(drive: Drive, distances: _Steps, turns: _Steps, offset: Array) -> Array:
    """Shares (S,) of distances and turns at offsets (S,).

    The shares left unexplained are multiplied, as their likelihoods are: a chord is a poor measure
    of the distance between poses far apart, and must not weigh as much as an exact turn.
    """
    angle_left, angle_right = drive.angles(drive.edges)
    # shares are independent of the sprockets' radius and gauge
    moved = np.abs(np.diff(angle_left) + np.diff(angle_right))
    distance = np.append(0.0, np.cumsum(moved))
    turn = angle_right - angle_left
    of_distances = _shared_by_steps(distances, drive.edges, distance, offset, positive=True)
    of_turns = _shared_by_steps(turns, drive.edges, turn, offset)
    known = [share for share in (of_distances, of_turns) if share.any()]
    if not known:
        return of_turns
    rest = np.maximum(1 - np.stack(known), _EXACT)
    return np.asarray(1 - np.exp(np.log(rest).mean(axis=0)))


def _distances(time: Array, pose: Array) -> _Steps:
    """Distances between successive positions [m]."""
    placed = np.isfinite(pose[:, 0])
    at = time[placed]
    chord = np.hypot(*np.diff(pose[placed, :2], axis=0).T)
    return _without_outliers(_Steps(at[:-1], at[1:], chord))


def _turns(time: Array, pose: Array) -> _Steps:
    """Turns between successive headings or, without these, between the middles of successive
    chords [rad].
    """
    headed = np.isfinite(pose[:, 2])
    if headed.sum() > 2:
        at = time[headed]
        turn = wrap_angle(np.diff(pose[headed, 2]))
        return _without_outliers(_Steps(at[:-1], at[1:], turn))
    placed = np.isfinite(pose[:, 0])
    if placed.sum() <= 2:
        return _Steps(time[:0], time[:0], time[:0])
    place = pose[placed, 0] + 1j * pose[placed, 1]
    chord = np.diff(place)
    middle = (time[placed][1:] + time[placed][:-1]) / 2
    return _without_outliers(
        _Steps(middle[:-1], middle[1:], _course_changes(chord[:-1], chord[1:]))
    )


def _without_outliers(steps: _Steps) -> _Steps:
    """At most _MOST_STEPS of the steps, without gaps between poses, unknown values and outliers."""
    if not len(steps.value):
        return steps
    duration = steps.end - steps.begin
    known = np.isfinite(_limited(steps.value)) & (duration <= 4 * np.median(duration))
    rows = np.flatnonzero(known)
    rows = rows[:: max(1, math.ceil(len(rows) / _MOST_STEPS))]
    return _Steps(steps.begin[rows], steps.end[rows], steps.value[rows])


def _shared_by_steps(
    steps: _Steps, edges: Array, sums: Array, offset: Array, positive: bool = False
) -> Array:
    """Squared correlation (S,) of steps with those of the wheels, at offsets (S,).

    `sums` (M + 1,) are the wheels' distances or turns up to the times `edges` (M + 1,). It is 0 if
    fewer than half the steps that fit into the drive overlap and, with `positive`, if it is
    negative.
    """
    shares = np.zeros(len(offset))
    if len(steps.value) < _FEWEST_STEPS:
        return shares
    at_once = max(1, _MOST_CELLS // len(steps.value))
    fitting = min(1.0, np.ptp(edges) / (steps.end[-1] - steps.begin[0])) * len(steps.value)
    for begin in range(0, len(offset), at_once):
        some = offset[begin : begin + at_once, None]
        inside = (steps.begin + some >= edges[0]) & (steps.end + some <= edges[-1])
        by = np.interp(steps.end + some, edges, sums) - np.interp(steps.begin + some, edges, sums)
        count = np.maximum(inside.sum(axis=1), 1)

        def mean(values: Array, inside: Array = inside, count: Array = count) -> Array:
            """Means over the steps that overlap, at each offset."""
            return np.asarray((values * inside).sum(axis=1) / count)

        mean_by = mean(by)
        mean_value = mean(np.broadcast_to(steps.value, by.shape))
        variance_by = mean(by**2) - mean_by**2
        variance = mean(np.broadcast_to(steps.value**2, by.shape)) - mean_value**2
        covariance = mean(by * steps.value) - mean_by * mean_value
        if positive:
            covariance = covariance.clip(min=0.0)
        enough = count >= max(_FEWEST_STEPS, 0.5 * fitting)
        enough &= variance > 0.1 * steps.value.var()
        enough &= variance_by > 1e-12
        product = np.where(enough, variance * variance_by, 1.0)
        shares[begin : begin + at_once] = np.where(enough, covariance**2 / product, 0.0)
    return shares
