"""Encoder readings made into mean sprocket speeds in the intervals between readings.

A reading is the mean speed since the previous reading. So readings tell the angles of the sprockets
at the times of reading; fits need a smooth curve between these. Nothing here changes the angle that
a sprocket turned between two readings, or the order in which it turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import PchipInterpolator

from trackslip.kinematics import Array
from trackslip.logs.repeats import LONGEST_HELD, changes_of_speeds, without_repeats
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import STANDING

BENDS: Final = 0.05  # time within which paths hardly bend [s]
_FEWEST_HELD: Final = 4  # least number of values that tell whether values are held
_SEVERAL: Final = 1.5  # least number of rows that usually repeat a held value
_EXACTLY: Final = 0.02  # largest deviation of a speed from a whole number of ticks [ticks]
_NEARLY_ALL: Final = 0.97  # least share of readings with whole numbers of ticks
_FEW_TICKS: Final = 40  # largest number of ticks per reading that counts as few
_CHANGING: Final = 0.05  # least share of readings that differ from the one before
_NO_TICK: Final = 1e-9  # speed [rad/s] or angle [rad] below which a reading has no tick
# one in so many readings may be smaller than a tick, as its time or angle is wrong
_SMALLER: Final = 500


@dataclass(frozen=True)
class Encoders:
    """Mean sprocket speeds in successive intervals."""

    edges: Array  # (M + 1,) ends of the intervals, by the encoder clock [s]
    omega: Array  # (M, 2) mean speeds [rad/s]
    by_ticks: bool = False  # true if angles change linearly from tick to tick

    def between(self, ends: np.ndarray) -> Encoders:
        """The means between the edges numbered `ends` (n + 1,), which include the first and last
        edge.
        """
        turned = np.add.reduceat(self.omega * np.diff(self.edges)[:, None], ends[:-1])
        edges = self.edges[ends]
        return replace(self, edges=edges, omega=turned / np.diff(edges)[:, None])

    def merged(self, most: int) -> Encoders:
        """The encoders with at most about `most` intervals, each of which merges several."""
        stride = math.ceil(len(self.omega) / max(most, 1))
        if stride == 1:
            return self
        last = len(self.omega)
        return self.between(np.append(np.arange(0, last, stride), last))

    def at(self, time: Array) -> Array:
        """Speeds (n, 2) at times (n,) [rad/s], each in the interval that ends at or after it."""
        interval = np.searchsorted(self.edges, time) - 1
        return self.omega[np.clip(interval, 0, len(self.omega) - 1)]

    def smooth(self) -> Encoders:
        """The encoders with angles on a smooth curve between readings, divided where these are more
        than BENDS apart.

        Fits need a continuous speed: with steps, they end away from their minimum. The curve is
        monotone between readings: a sprocket that stands or turns one way still does (F. N. Fritsch
        and J. Butland, *A method for constructing local monotone piecewise cubic interpolants*,
        1984). Its slope at a reading depends on the readings before and after, so that near the end
        of a part of a log, it may differ from that of the whole log.
        """
        readings = self._without_repeats()
        step = np.diff(readings.edges)
        parts = np.maximum(np.rint(step / BENDS), 1).astype(int)
        if (parts == 1).all():
            return readings
        # each interval in equal parts
        interval = np.repeat(np.arange(len(step)), parts)
        first = np.repeat(np.cumsum(parts) - parts, parts)
        share = (np.arange(len(interval)) - first) / parts[interval]  # that has passed
        begins = readings.edges[interval] + share * step[interval]
        edges = np.append(begins, readings.edges[-1])
        angles = PchipInterpolator(readings.edges, readings.angles)(edges)
        return Encoders(edges, np.diff(angles, axis=0) / np.diff(edges)[:, None])

    def _without_repeats(self) -> Encoders:
        """Merge intervals that repeat a reading, if readings are logged several times.

        That isn't stated in a log: it is guessed from speeds that stay equal for several rows. A
        value that lasts longer than usual was read several times: it keeps the usual time of a
        reading at both ends, and all intervals in between.
        """
        # a value lasts from edge to edge
        bounds = np.append(changes_of_speeds(self.omega), len(self.omega))
        duration = np.diff(self.edges[bounds])

        # at rest, equal values tell nothing
        turning = (np.abs(self.omega[bounds[:-1]]) > STANDING).any(axis=1)
        if turning.sum() < _FEWEST_HELD:
            return self
        usual = float(np.median(duration[turning]))
        if np.median(np.diff(bounds)[turning]) < _SEVERAL or usual > LONGEST_HELD:
            return self
        return self.between(without_repeats(self.edges, bounds, usual))

    @property
    def angles(self) -> Array:
        """Angles (M + 1, 2) turned from the first edge to each [rad]."""
        turned = np.cumsum(self.omega * np.diff(self.edges)[:, None], axis=0)
        return np.concatenate([np.zeros((1, 2)), turned])


def encoders_of(log: RunLog) -> Encoders:
    """The encoder readings in a log: mean sprocket speeds from reading to reading.

    The angle turned from the first to the last row is that of the log, whatever its rows, and so is
    the angle from reading to reading. For encoders with few ticks, the angle changes linearly from
    tick to tick; near the end of a part of a log, it may differ from that of the whole log, as the
    tick beyond the end is unknown.
    """
    # the ends of the log count as readings, so that no angle is lost
    ends = np.union1d(np.flatnonzero(log.is_read), [0, len(log.time) - 1])
    readings = Encoders(log.time, log.omega[1:]).between(ends)

    ticks = _few_ticks(readings)
    if ticks is not None:
        sides = zip(readings.omega.T, ticks.T, strict=True)
        omega = [_between_ticks(readings.edges, speeds, count) for speeds, count in sides]
        return Encoders(readings.edges, np.column_stack(omega), by_ticks=True)
    return readings


def _few_ticks(encoders: Encoders) -> np.ndarray | None:
    """Number of ticks (M, 2) in each interval, if nearly all speeds of a sprocket are small
    multiples of a fixed angle, or of a fixed speed; else None.

    They are multiples of a fixed speed if the robot divided ticks by its usual time between
    readings instead of the time that passed.
    """
    speeds = np.abs(encoders.omega)
    angles = speeds * np.diff(encoders.edges)[:, None]
    for sizes in (angles, speeds):
        if any(_are_few_ticks(side) for side in sizes.T):
            return np.column_stack([_ticks(side) for side in sizes.T])
    return None


def _ticks(size: Array) -> Array:
    """Sizes (M,) in units of the smallest, except for outliers: whole numbers, 0 only for 0."""
    turning = np.sort(size[size > _NO_TICK])
    if not len(turning):
        return np.zeros(len(size))
    tick = turning[len(turning) // _SMALLER]
    return np.where(size > 0, np.maximum(np.round(size / tick), 1), 0)


def _are_few_ticks(size: Array) -> bool:
    """True if nearly all sizes (M,) are small multiples of the smallest."""
    ticks = _ticks(size)
    if len(ticks) < 2 or not ticks.any():  # a single one can't change
        return False
    tick = np.median(size[ticks > 0] / ticks[ticks > 0])
    exact = np.abs(size / tick - ticks) < _EXACTLY
    if exact.mean() <= _NEARLY_ALL or ticks[exact].max() > _FEW_TICKS:
        return False
    return bool((np.diff(ticks) != 0).mean() > _CHANGING)


def _between_ticks(edges: Array, omega: Array, ticks: Array) -> Array:
    """Mean speeds (M,) of a sprocket between edges (M + 1,), if the angle changes linearly from
    tick to tick.

    The ticks (M,) of an interval are spread evenly: each in the middle of its share.
    """
    step = np.diff(edges)
    turned = omega * step
    angle = np.append(0.0, np.cumsum(turned))  # at the edges
    ticked = np.flatnonzero(ticks)

    # the first and the last tick of an interval are half a share from its ends
    half_time = step[ticked] / (2 * ticks[ticked])
    half_angle = turned[ticked] / (2 * ticks[ticked])
    times = np.column_stack([edges[ticked] + half_time, edges[ticked + 1] - half_time])
    angles = np.column_stack([angle[ticked] + half_angle, angle[ticked + 1] - half_angle])

    # the angle is known at both ends, too
    known_time = np.concatenate([edges[:1], times.ravel(), edges[-1:]])
    known_angle = np.concatenate([angle[:1], angles.ravel(), angle[-1:]])
    smooth = np.interp(edges, known_time, known_angle)
    return np.asarray(np.diff(smooth) / step)
