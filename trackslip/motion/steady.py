"""The steady part of a run, found by its sprocket speeds, clock and poses; its motion must be steady, too."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES, arc
from trackslip.motion.steady_twist import within

SETTLE = 1.5
"""Default time from steady sprockets to a steady robot [s]."""
MARGIN = 0.5
"""Time excluded at the end of a steady part, and at least at its start, because of the filters' transients [s]."""
_BLOCK = 0.5  # time over which sprocket speeds are averaged for comparison [s]
_DRIFT = 0.05  # maximum change of a steady sprocket's mean speed, relative to the faster sprocket
_GAP = 5.0  # time step that is a gap in the clock [median time steps]
_MIN_GAP = 0.3  # [s]
_JUMP = 0.3  # maximum error of a plausible pose [m]
_OVERDRIVE = 3.0  # maximum ratio of the distance between plausible poses to that of the faster sprocket [-]
_STANDING = 1e-3  # sprocket speed at rest: one turn takes more than an hour and a half [rad/s]
_MOSTLY = 0.5  # share of implausible steps above which the units are wrong, not the poses
_LENGTHS = (("millimetres", 1000.0), ("centimetres", 100.0))
_MIN_HALF = 2 * MIN_ARC_POSES  # minimum number of valid poses in each half, to compare them
_SIGNIFICANT = 6.0  # significant difference between the halves [standard errors]
_CHANGE = 0.05  # relevant relative change of the twist
_TURNING = 0.2  # curvature [1/m] of nearly straight paths, and radius [m] of turns nearly in place
_RESETTLED = 1.0  # time after which displaced poses are the continuation of the track, not a glitch [s]


@dataclass(frozen=True)
class SteadyPart:
    """A run and its longest stretch of constant sprocket speeds without breaks in poses and clock."""

    log: RunLog
    """The run, with poses that jump away and back marked as not valid."""
    window: tuple[float, float]
    """Start and end [s]."""
    notes: tuple[str, ...]
    """What was excluded besides settling, one line each."""

    @property
    def rows(self) -> np.ndarray:
        """(T,) bool: the rows in the window."""
        return within(self.log.time, self.window)


def steady_part(log: RunLog, geometry: RobotGeometry, settle: float = SETTLE) -> SteadyPart:
    """The longest steady stretch of a run, less `settle` [s] at its start; the geometry limits jumps of the poses.

    Raises LogError if the run is at rest or has no steady stretch that is long enough.
    """
    log, breaks, notes = _without_jumps(log, geometry)
    step = np.diff(log.time)
    usual = float(np.median(step))
    gaps = np.flatnonzero(step > max(_GAP * usual, _MIN_GAP))
    notes += [f"its clock has a gap from t = {log.time[k]:g} s to {log.time[k + 1]:g} s" for k in gaps]
    begin, end = _longest_constant(log, np.union1d(breaks, gaps), usual)
    lead = max(settle, MARGIN)
    window = (float(log.time[begin]) + lead, float(log.time[end]) - MARGIN)
    rows = within(log.time, window)
    if rows.sum() < 3:
        notes.append(f"steady from {log.time[begin]:g} s to {log.time[end]:g} s only, too short")
        left_out = f"the first {lead:g} s and last {MARGIN:g} s of it are left out"
        raise LogError(f"run {log.run!r}: {'; '.join(notes)}: {left_out}")
    if not np.abs(log.omega[rows]).max() > _STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    if log.time[end] - log.time[begin] < 0.8 * (log.time[-1] - log.time[0]):
        notes.append(f"steady, and used, from {window[0]:g} s to {window[1]:g} s only")
    return SteadyPart(log, window, tuple(f"run {log.run!r}: {note}" for note in notes))


def require_steady_motion(part: SteadyPart) -> None:
    """Raise LogError if the twist differs between the halves of a steady part although the sprocket speeds do not.

    For example, the robot drives onto other ground or against an obstacle.
    """
    begin, end = part.window
    middle = (begin + end) / 2
    halves = (part.rows & part.log.is_valid & (late == (part.log.time > middle)) for late in (False, True))
    if min(half.sum() for half in halves) < _MIN_HALF:
        return  # too few to compare
    first, second = arc(part.log, (begin, middle)), arc(part.log, (middle, end))
    change = second.twist - first.twist
    error = np.sqrt(np.diag(first.covariance + second.covariance))
    significant = np.abs(change) > _SIGNIFICANT * error
    v, w = np.abs(np.stack([first.twist, second.twist])).max(axis=0)
    size = np.array([v + _TURNING * w, w + _TURNING * v])
    if (significant & (np.abs(change) > _CHANGE * size)).any():
        v, w = change
        raise LogError(
            f"run {part.log.run!r}: its sprockets are steady from {begin:g} s to {end:g} s, but its motion is not: "
            f"v changes by {v:+.3g} m/s and w by {w:+.3g} rad/s from the first half to the second"
        )


def _without_jumps(log: RunLog, geometry: RobotGeometry) -> tuple[RunLog, np.ndarray, list[str]]:
    """The run with glitches marked as not valid, the rows after which its poses continue elsewhere, and notes."""
    rows = np.flatnonzero(log.is_valid)
    position, time = log.pose[rows, :2], log.time[rows]
    speed = _OVERDRIVE * geometry.sprocket_radius * np.abs(log.omega).max()
    ways, steps = np.hypot(*np.diff(position, axis=0).T), np.diff(time)
    far = ways > _JUMP + speed * steps
    if not far.any():
        return log, np.empty(0, int), []
    if far.mean() > _MOSTLY:
        times = np.median(ways) / np.median(speed / _OVERDRIVE * steps)
        unit = next((f"; it looks like {name}" for name, per in _LENGTHS if per / 2 < times < per * 1.4), "")
        raise LogError(
            f"run {log.run!r}: its poses move {times:.3g} times as far as its sprockets drive: check the units "
            f"(m, rad/s){unit}"
        )
    valid = log.is_valid.copy()
    breaks: list[int] = []
    notes: list[str] = []
    lost: list[int] = []
    last = 0  # the last plausible pose; `lost` are the implausible ones since
    for k in range(1, len(rows)):
        way, allowed = np.hypot(*(position[k] - position[last])), _JUMP + speed * (time[k] - time[last])
        if way <= allowed:
            last, lost = k, []
            continue
        if not lost:
            where = f"at t = {time[k]:g} s, where its sprockets allow {allowed:.3g} m"
            notes.append(f"its pose jumps by {way:.3g} m {where}")
        lost.append(k)
        valid[rows[k]] = False
        if time[k] - time[lost[0]] >= _RESETTLED:
            valid[rows[lost]] = True
            breaks += [rows[last], rows[lost[0]] - 1]
            last, lost = k, []
    return replace(log, valid=valid), np.array(breaks, int), notes


def _longest_constant(log: RunLog, breaks: np.ndarray, usual: float) -> tuple[int, int]:
    """First and last row of the longest stretch without a break whose sprocket speeds change by at most _DRIFT."""
    size = max(1, round(_BLOCK / usual))
    tolerance = _DRIFT * np.abs(_means(log.omega, size)).max()
    best = (0, 0)
    edges = np.concatenate([[-1], breaks, [len(log.time) - 1]])
    for before, last in itertools.pairwise(edges):
        first = int(before) + 1
        mean = _means(log.omega[first : last + 1], size)
        a, b = _longest_within(mean, tolerance)
        stretch = (first + a * size, int(last) if b == len(mean) - 1 else first + (b + 1) * size - 1)
        if log.time[stretch[1]] - log.time[stretch[0]] > log.time[best[1]] - log.time[best[0]]:
            best = stretch
    return best


def _means(values: Array, size: int) -> Array:
    """Means (blocks, 2) of blocks of `size` rows out of (T, 2); the last block includes the remainder."""
    blocks = max(1, len(values) // size)
    starts = np.arange(blocks) * size
    counts = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]


def _longest_within(mean: Array, tolerance: float) -> tuple[int, int]:
    """The longest run of rows (first, last) in which no column of `mean` (n, 2) varies by more than `tolerance`."""
    best, first = (0, 0), 0
    low = high = mean[0]
    for k, value in enumerate(mean):
        low, high = np.minimum(low, value), np.maximum(high, value)
        if (high - low > tolerance).any():  # restart at the earliest row that varies little up to this one
            back = mean[first : k + 1][::-1]
            lows, highs = np.minimum.accumulate(back), np.maximum.accumulate(back)
            length = int((highs - lows <= tolerance).all(axis=1).sum())
            first, low, high = k + 1 - length, lows[length - 1], highs[length - 1]
        if k - first > best[1] - best[0]:
            best = (first, k)
    return best
