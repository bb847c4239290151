"""Encoder readings made into mean sprocket speeds in the intervals between rows."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.motion.steady import STANDING


def interval_means(time: Array, omega: Array, ticks: bool | None = None) -> Array:
    """Mean sprocket speeds (T - 1, 2) between rows at `time` (T,), from the logged speeds (T, 2).

    A row has the mean speed since the previous row. But many robots log each encoder reading
    several times: such a reading counts once, in the middle of the rows that repeat it, and speeds
    change linearly between readings. For encoders with few ticks, the angle changes linearly from
    tick to tick.
    """
    ticks = counts_few_ticks(time, omega) if ticks is None else ticks
    means_of_side = _between_ticks if ticks else _between_readings
    return np.column_stack([means_of_side(time, side) for side in omega.T])


def _between_ticks(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of a sprocket, as if each tick came in the middle of the interval that
    counts the tick.
    """
    step = np.diff(time)
    angle = np.concatenate([[0.0], np.cumsum(omega[1:] * step)])
    ticked = np.flatnonzero(omega[1:])
    middle, half = (time[ticked] + time[ticked + 1]) / 2, (angle[ticked] + angle[ticked + 1]) / 2
    ends = (
        np.concatenate([time[:1], middle, time[-1:]]),
        np.concatenate([angle[:1], half, angle[-1:]]),
    )
    return np.diff(np.interp(time, *ends)) / step


def _between_readings(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of a sprocket whose readings may each be logged several times."""
    read = np.flatnonzero(np.diff(omega, prepend=np.nan) != 0)  # first rows of readings
    turning = np.abs(omega[read[:-1]]) > STANDING
    if turning.sum() < 4:
        return omega[1:]
    rows, usual = np.median(np.diff(read)[turning]), float(np.median(np.diff(time[read])[turning]))
    if rows < 1.5 or usual > 0.5:  # a new reading in every row, or a long-held command
        return omega[1:]
    begin = time[np.maximum(read - 1, 0)]
    end = np.append(begin[1:], time[-1])
    inside = np.minimum(end - begin, usual) / 2  # a longer-lasting value was read several times
    knots = np.column_stack([begin + inside, end - inside]).ravel()
    at_rows = np.interp(time, knots, np.repeat(omega[read], 2))
    return np.asarray(at_rows[1:] + at_rows[:-1]) / 2


def counts_few_ticks(time: Array, omega: Array) -> bool:
    """True if nearly all speeds (T, 2) of a sprocket are small multiples of a fixed speed, or a
    fixed angle per row.
    """
    for size in (np.abs(side * by) for side in omega[1:].T for by in (np.diff(time), 1.0)):
        turning = np.sort(size[size > 1e-9])
        if len(turning):
            # in units of the smallest, except for outliers
            ticks = size / turning[len(turning) // 500]
            near = np.round(ticks)
            exact = np.abs(ticks - near) < 0.02
            if (
                exact.mean() > 0.97
                and near[exact].max() <= 40
                and (np.diff(near) != 0).mean() > 0.05
            ):
                return True
    return False


def merged(time: Array, omega: Array, most: int) -> tuple[Array, Array]:
    """Merge the intervals between `time` (T,) into at most `most`; returns their ends (M + 1,) and
    means (M, 2).
    """
    stride = -(-len(omega) // max(most, 1))
    if stride == 1:
        return time, omega
    ends = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    turned = np.add.reduceat(omega * np.diff(time)[:, None], ends[:-1])
    return time[ends], turned / np.diff(time[ends])[:, None]
