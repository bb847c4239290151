"""Encoder readings that a log repeats in several rows.

A table of several sensors often has filled cells: forwards, with the last reading, or backwards,
with the next one. A row that repeats a reading is no reading. For an angle, it hardly matters which
of its rows is the reading. For a mean speed since the previous reading, it does: times an interval,
the speed must be the angle turned in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip.kinematics import Array

_ROUNDING: Final = 1e-9  # relative difference up to which speeds are equal
_SAME_STEP: Final = 1e-6  # difference up to which steps are equal, relative to the largest
# least share of values that several rows have, for rows to repeat readings
_OFTEN: Final = 0.1
_FEWEST: Final = 20  # least number of values that tell whether rows repeat readings
_FEWEST_BENDS: Final = 200  # least number of bends of speeds that tell their interval
# an interval so many times as long as usual is a standstill or a gap
_LONG: Final = 3.0
LONGEST_HELD: Final = 0.3
"""Usual time above which equal speeds may be a constant speed, not a repeated reading [s]."""
# a step so many times as large as usual is no motion, but that of an angle that wraps
_WRAP: Final = 5.0
# least number of ticks between readings: slow sprockets stay at a tick for several readings, too
_SEVERAL_TICKS: Final = 3.0
# readings are in the last rows of values if speeds are smoother by this factor than by first rows
_SMOOTHER: Final = 0.9
# least power of an interval with which speeds vary inversely, for them to be means over it
_LEAST_POWER: Final = 0.1
_SIGNIFICANT: Final = 5.0  # [standard errors]


def changes_of_speeds(omega: Array) -> np.ndarray:
    """Rows (m,) in which new speeds begin, of speeds (n, 2) in successive rows, and 0."""
    same = np.isclose(omega[1:], omega[:-1], rtol=_ROUNDING, atol=0.0).all(axis=1)
    return np.append(0, 1 + np.flatnonzero(~same))


def _changes_of_angles(angles: Array) -> np.ndarray:
    """Rows (m,) in which new angles begin, of angles (n, k) in successive rows, and 0."""
    # angles may be large numbers of ticks, of which each counts
    same = (angles[1:] == angles[:-1]).all(axis=1)
    return np.append(0, 1 + np.flatnonzero(~same))


def without_repeats(time: Array, changes: np.ndarray, usual: float) -> np.ndarray:
    """Rows (r,) of the times (n,) that are readings, if a reading is in each of the rows `changes`
    (m,), and rows after it repeat it.

    A value that lasts for longer than the `usual` time between readings [s] was read several times:
    all rows count that are as far from both of its ends.
    """
    row = np.arange(len(time))
    value = np.searchsorted(changes, row, side="right") - 1
    since = time - time[changes[value]]
    until = np.append(time[changes], time[-1])[value + 1] - time
    is_reading = np.minimum(since, until) >= usual
    is_reading[changes] = True
    return np.flatnonzero(is_reading)


def angle_readings(time: Array, angles: Array) -> np.ndarray | None:
    """Rows (r,) that are readings, of angles or positions (n, k) at times (n,); None if no row
    repeats a reading.

    A driving sprocket whose angle stays the same, and jumps several ticks later on, again and
    again, wasn't read in between.
    """
    changes = _changes_of_angles(angles)
    if len(changes) < _FEWEST:
        return None
    rows = np.diff(changes)
    interval = np.diff(time[changes])
    usual = float(np.median(interval))
    drives = interval < _LONG * usual

    step = np.abs(np.diff(angles[changes], axis=0)).max(axis=1)
    is_repeated = (rows > 1) & drives
    often = is_repeated.sum() >= _OFTEN * drives.sum()
    if not often or np.median(step) < _SEVERAL_TICKS * _tick(step):
        return None

    # the first row of each value, or the last: backwards in time, that is the first one
    first = without_repeats(time, changes, usual)
    backwards = without_repeats(-time[::-1], _changes_of_angles(angles[::-1]), usual)
    last = (len(time) - 1 - backwards)[::-1]
    roughness = [_roughness(time[rows], angles[rows]) for rows in (first, last)]
    return last if roughness[1] < _SMOOTHER * roughness[0] else first


def _tick(step: Array) -> float:
    """The smallest step, or difference of steps, of steps (m,) that aren't 0."""
    sizes = np.unique(step)
    differences = np.diff(sizes)
    is_more = differences > _SAME_STEP * sizes[-1]
    return float(np.append(differences[is_more], sizes[0]).min())


def _roughness(time: Array, angles: Array) -> float:
    """Root mean square of the bends of speeds from angles (n, k) at times (n,)."""
    step = np.diff(angles, axis=0)
    size = np.abs(step).max(axis=1)
    is_motion = size < _WRAP * np.median(size[size > 0])
    speeds = step[is_motion] / np.diff(time)[is_motion, None]
    bends = np.diff(speeds, n=2, axis=0)
    return float(np.sqrt((bends**2).mean()))


@dataclass(frozen=True)
class Repeats:
    """Speeds that several rows have, and the two intervals of which each may be the mean.

    If rows repeat the last reading, a speed is the mean between the first rows of the value before
    and of its own (*before*). If rows repeat the next reading, it is the mean between the last rows
    of both (*held*); so it is, but for a delay, if it was the speed at one time.

    A mean speed made from counts varies inversely with the interval of the counts, whose stamps
    jitter. With the interval T_k in units of the usual one, w_k (1 + p (T_k - 1)) is smoothest for
    p = 1 if the counts are of T, and for p = 0 if the speed doesn't depend on T. Smooth means
    here that each value is close to the mean of its neighbours; p is found by least squares.
    """

    rows: np.ndarray  # (m,) number of successive rows that have the same speeds
    duration: float  # usual time for which several rows have the same speeds [s]; 0 if none do
    # sizes of speeds times each interval, in units of the usual one: how far the sprockets turned
    turned_before: float
    turned_held: float
    # (b,) bends of speeds, and of speeds times T - 1, from the mean of their neighbours [rad/s]
    bends: Array
    bends_before: Array
    bends_held: Array
    speed: float  # root mean square of the speeds [rad/s]

    @classmethod
    def of(cls, logs: Sequence[tuple[Array, Array]]) -> Repeats | None:
        """The repeats in logs, each with times (n,) [s] and speeds (n, 2) [rad/s]; None for too
        few different speeds.
        """
        if not logs:
            return None
        parts = [_Speeds.of(time, omega) for time, omega in logs]
        rows = np.concatenate([part.rows for part in parts])
        durations = np.concatenate([part.duration[part.rows > 1] for part in parts])
        speeds = np.concatenate([part.omega[part.known] for part in parts])
        if len(rows) < _FEWEST or not speeds.any():
            return None

        # bends, one after the other in all logs
        bends = []
        bends_before = []
        bends_held = []
        for part in parts:
            bends.append(part.bends(np.ones(len(part.rows))))
            bends_before.append(part.bends(part.before - 1))
            bends_held.append(part.bends(part.held - 1))
        return cls(
            rows=rows,
            duration=float(np.median(durations)) if len(durations) else 0.0,
            turned_before=sum(part.turned(part.before) for part in parts),
            turned_held=sum(part.turned(part.held) for part in parts),
            bends=np.concatenate(bends),
            bends_before=np.concatenate(bends_before),
            bends_held=np.concatenate(bends_held),
            speed=float(np.sqrt((speeds**2).mean())),
        )

    @property
    def are_frequent(self) -> bool:
        """True if rows repeat speeds more often than by chance."""
        return bool((self.rows > 1).mean() >= _OFTEN)

    @property
    def may_be_constant(self) -> bool:
        """True if equal speeds last so long that the sprockets may have turned at a constant
        speed, as exact encoders show at constant commands.
        """
        return self.duration > LONGEST_HELD

    @property
    def difference(self) -> float:
        """By how much the sprockets turn further if speeds are means before, relative to held."""
        return self.turned_before / self.turned_held - 1 if self.turned_held > 0 else 0.0

    @property
    def are_before(self) -> bool:
        """True if speeds are means up to the first row that has them."""
        power, error = _power(self.bends, self.bends_before)
        other, _ = _power(self.bends, self.bends_held)
        return power > max(_LEAST_POWER, _SIGNIFICANT * error) and power >= other

    @property
    def are_held(self) -> bool:
        """True if speeds are means up to the last row that has them."""
        power, error = _power(self.bends, self.bends_held)
        other, _ = _power(self.bends, self.bends_before)
        return power > max(_LEAST_POWER, _SIGNIFICANT * error, other)

    @property
    def scatter(self) -> float:
        """Standard deviation of speeds from their neighbours, relative to the speeds, that the
        intervals don't explain [-].

        A bend is one value minus half of two others, so that its variance is 1.5 times theirs.
        """
        by_interval = self.bends_before if self.are_before else self.bends_held
        bend = float(np.sqrt(((self.bends + by_interval) ** 2).mean()))
        return bend / np.sqrt(1.5) / self.speed


@dataclass(frozen=True)
class _Speeds:
    """Successive speeds of a log, each in several rows, while the robot drives."""

    omega: Array  # (m, 2) [rad/s]
    rows: np.ndarray  # (m,) number of rows that have each
    duration: Array  # (m,) time up to the next value, or the end [s]
    before: Array  # (m,) interval up to the first row, in units of the usual one [-]
    held: Array  # (m,) interval up to the last row, in units of the usual one [-]
    known: np.ndarray  # (m,) bool: false after gaps and standstills

    @classmethod
    def of(cls, time: Array, omega: Array) -> _Speeds:
        """The speeds in rows (n, 2) at times (n,), but the first, whose interval isn't known."""
        first = changes_of_speeds(omega)
        last = np.append(first[1:] - 1, len(time) - 1)
        before = np.diff(time[first])
        held = np.diff(time[last])
        usual = float(np.median(before)) if len(before) else 1.0
        known = np.maximum(before, held) < _LONG * usual
        rows = (last - first + 1)[1:]
        duration = np.diff(np.append(time[first], time[-1]))[1:]
        return cls(omega[first[1:]], rows, duration, before / usual, held / usual, known)

    def turned(self, interval: Array) -> float:
        """Sum of the sizes of the turns in intervals (m,), in units of the usual one."""
        return float((np.abs(self.omega) * interval[:, None])[self.known].sum())

    def bends(self, factor: Array) -> Array:
        """Differences (b,) of speeds times a factor (m,) from the mean of the speeds before and
        after.
        """
        scaled = self.omega * factor[:, None]
        bend = scaled[1:-1] - (scaled[:-2] + scaled[2:]) / 2
        known = self.known[1:-1] & self.known[:-2] & self.known[2:]
        return bend[known].ravel()


def _power(bends: Array, by_interval: Array) -> tuple[float, float]:
    """The power p of an interval with which speeds vary inversely, and its standard error, as in
    `Repeats`; 0 and infinity if it can't be told.
    """
    size = float(by_interval @ by_interval)
    if len(bends) < _FEWEST_BENDS or size == 0:
        return 0.0, np.inf
    power = -float(bends @ by_interval) / size
    rest = bends + power * by_interval
    # the rest may be larger where the interval is unusual
    return power, float(np.linalg.norm(rest * by_interval)) / size


def speed_readings(time: Array, omega: Array) -> np.ndarray | None:
    """Rows (r,) that are readings, of speeds (n, 2) at times (n,) that are means up to the first
    row that has them; None if rows repeat no reading, or the next one, or if that can't be told.
    """
    repeats = Repeats.of([(time, omega)])
    if repeats is None or not repeats.are_frequent or not repeats.are_before:
        return None
    changes = changes_of_speeds(omega)
    interval = np.diff(time[changes])
    return without_repeats(time, changes, float(np.median(interval)))
