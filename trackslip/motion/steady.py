"""The steady part of a run, found by its sprocket speeds, clock and poses."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

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
        return (self.log.time > self.window[0]) & (self.log.time < self.window[1])


def steady_part(log: RunLog, geometry: RobotGeometry, settle: float = SETTLE) -> SteadyPart:
    """The longest steady stretch of a run.

    Args:
        log: the run.
        geometry: limits how far the robot can move from row to row.
        settle: time excluded after the sprockets have become steady [s].

    Raises:
        LogError: if the run is at rest or has no steady stretch that is long enough.
    """
    log, breaks, notes = _without_jumps(log, geometry)
    step = np.diff(log.time)
    usual = float(np.median(step))
    gaps = np.flatnonzero(step > max(_GAP * usual, _MIN_GAP))
    notes += [f"its clock has a gap from t = {log.time[k]:g} s to {log.time[k + 1]:g} s" for k in gaps]
    begin, end = _longest_constant(log, np.union1d(breaks, gaps), usual)
    window = (float(log.time[begin]) + max(settle, MARGIN), float(log.time[end]) - MARGIN)
    rows = (log.time > window[0]) & (log.time < window[1])
    if rows.sum() < 3:
        raise LogError(
            f"run {log.run!r}: "
            + "; ".join([*notes, ""])
            + f"steady from {log.time[begin]:g} s to {log.time[end]:g} s only, too short: "
            f"the first {max(settle, MARGIN):g} s and last {MARGIN:g} s of it are left out"
        )
    if not np.abs(log.omega[rows]).max() > _STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    if log.time[end] - log.time[begin] < 0.8 * (log.time[-1] - log.time[0]):
        notes.append(f"steady, and used, from {window[0]:g} s to {window[1]:g} s only")
    return SteadyPart(log, window, tuple(f"run {log.run!r}: {note}" for note in notes))


def _without_jumps(log: RunLog, geometry: RobotGeometry) -> tuple[RunLog, np.ndarray, list[str]]:
    """The run with glitches marked as not valid, the rows after which its poses continue elsewhere, and notes."""
    rows = np.flatnonzero(log.is_valid)
    position = log.pose[rows, :2]
    speed = _OVERDRIVE * geometry.sprocket_radius * np.abs(log.omega).max()
    far = np.hypot(*np.diff(position, axis=0).T) > _JUMP + speed * np.diff(log.time[rows])
    if not far.any():
        return log, np.empty(0, int), []
    if far.mean() > _MOSTLY:
        times = np.median(np.hypot(*np.diff(position, axis=0).T)) / np.median(
            speed / _OVERDRIVE * np.diff(log.time[rows])
        )
        unit = next((f"; it looks like {name}" for name, per in _LENGTHS if per / 2 < times < per * 1.4), "")
        raise LogError(
            f"run {log.run!r}: its poses move {times:.3g} times as far as its sprockets drive: check the units "
            f"(m, rad/s){unit}"
        )
    valid = log.is_valid.copy()
    breaks, notes = [], []
    lost: list[int] = []
    last = 0  # the last plausible pose; `lost` are the implausible ones since
    for k in range(1, len(rows)):
        way = float(np.hypot(*(position[k] - position[last])))
        elapsed = log.time[rows[k]] - log.time[rows[last]]
        if way <= _JUMP + speed * elapsed:
            last, lost = k, []
            continue
        if not lost:
            notes.append(
                f"its pose jumps by {way:.3g} m at t = {log.time[rows[k]]:g} s, where its sprockets allow "
                f"{_JUMP + speed * elapsed:.3g} m"
            )
        lost.append(k)
        valid[rows[k]] = False
        if log.time[rows[k]] - log.time[rows[lost[0]]] >= _RESETTLED:
            breaks.append(rows[last])
            valid[rows[lost]] = True
            breaks.append(rows[lost[0]] - 1)
            last, lost = k, []
    return replace(log, valid=valid), np.array(sorted(set(breaks)), int), notes


def _longest_constant(log: RunLog, breaks: np.ndarray, usual: float) -> tuple[int, int]:
    """First and last row of the longest stretch without a break whose sprocket speeds change by at most _DRIFT."""
    size = max(1, round(_BLOCK / usual))
    tolerance = _DRIFT * np.abs(_means(log.omega, size)).max()
    best = (0, 0)
    edges = np.concatenate([[-1], breaks, [len(log.time) - 1]])
    for before, last in itertools.pairwise(edges):
        first = int(before) + 1
        mean = _means(log.omega[first : last + 1], size)
        for a, b in _longest_within(mean, tolerance):
            stretch = (first + a * size, min(first + (b + 1) * size - 1, int(last)))
            if b == len(mean) - 1:
                stretch = (stretch[0], int(last))
            if log.time[stretch[1]] - log.time[stretch[0]] > log.time[best[1]] - log.time[best[0]]:
                best = stretch
    return best


def _means(values: Array, size: int) -> Array:
    """Means (blocks, 2) of blocks of `size` rows out of (T, 2); the last block includes the remainder."""
    blocks = max(1, len(values) // size)
    starts = np.arange(blocks) * size
    counts = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]


def _longest_within(mean: Array, tolerance: float) -> list[tuple[int, int]]:
    """The longest run of rows (first, last) in which no column of `mean` (n, 2) varies by more than `tolerance`."""
    best, first = (0, 0), 0
    lows: list[deque[int]] = [deque(), deque()]
    highs: list[deque[int]] = [deque(), deque()]
    for k in range(len(mean)):
        for j in range(2):
            while lows[j] and mean[lows[j][-1], j] >= mean[k, j]:
                lows[j].pop()
            while highs[j] and mean[highs[j][-1], j] <= mean[k, j]:
                highs[j].pop()
            lows[j].append(k)
            highs[j].append(k)
        while any(mean[highs[j][0], j] - mean[lows[j][0], j] > tolerance for j in range(2)):
            first += 1
            for j in range(2):
                while lows[j][0] < first:
                    lows[j].popleft()
                while highs[j][0] < first:
                    highs[j].popleft()
        if k - first > best[1] - best[0]:
            best = (first, k)
    return [best]
