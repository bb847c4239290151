"""Checks of measured poses by odometry: the offset of their clock, and jumps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.outliers import outlying
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import LENGTHS, trajectory_of
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.trajectory_errors import Stretches, Trajectory, errors_after_seconds, errors_between
from trackslip.se2 import Mounting

_STEP = 0.05  # of the offset for the parabola [s]
_MAX_MOVE = 0.2  # in one iteration [s]
_ITERATIONS = 4
_MATTERS = 0.02  # difference of offsets that is told [s]
_GAIN = 0.9  # of the squares, below which another offset is better
_FAR = 3.0  # size of an error beyond which it counts no more [medians]
_JUMP = 6.0  # error of the step across a lasting jump [median of all steps]


def better_clock_offset(
    logs: Sequence[RunLog], odometry: SlipOdometry, mounting: Mounting, clock_offset: float
) -> float | None:
    """The offset [s] with which odometry fits clearly better over short stretches; None if this one is as good."""
    first = _squares(logs, odometry, mounting, clock_offset)
    best, least = clock_offset, first
    for _ in range(_ITERATIONS):
        beside = [_squares(logs, odometry, mounting, best + sign * _STEP) for sign in (-1, 1)]
        if not np.isfinite([least, *beside]).all():
            return None
        bend = beside[0] - 2 * least + beside[1]
        slope = (beside[1] - beside[0]) / 2
        move = -slope / bend if bend > 0 else -np.sign(slope) * _MAX_MOVE / _STEP
        tried = best + float(np.clip(move * _STEP, -_MAX_MOVE, _MAX_MOVE))
        squares = _squares(logs, odometry, mounting, tried)
        if not squares < least:
            break
        best, least = tried, squares
    return best if abs(best - clock_offset) > _MATTERS and least < _GAIN * first else None


def _squares(logs: Sequence[RunLog], odometry: SlipOdometry, mounting: Mounting, clock_offset: float) -> float:
    """Mean square of the errors over the shortest stretches, outlying ones limited; NaN if there are none."""
    drives = []
    for log in logs:
        try:
            drives.append(trajectory_of(log, odometry, mounting, clock_offset))
        except LogError:
            continue
    for length in LENGTHS:
        sizes = [_sizes(errors_after_seconds(drive, length), odometry.geometry.half_gauge) for drive in drives]
        size = np.concatenate([*sizes, np.zeros(0)])
        if len(size):
            return float(np.mean(np.minimum(size, _FAR * np.median(size)) ** 2))
    return float("nan")


def _sizes(found: Stretches, half_gauge: float) -> Array:
    """Sizes (n,) of errors [m], with heading errors as the way by which they move the tracks."""
    return np.hypot(found.position, half_gauge * np.nan_to_num(found.heading))


def jumps(drive: Trajectory) -> tuple[int, int]:
    """Number of outlying poses of a drive, and of lasting jumps, as odometry shows them."""
    state = np.column_stack([drive.measured[:, :2], drive.heading])
    bad, lasting = outlying(drive.measured, state, drive.estimated)
    row = np.arange(len(drive.time))
    usual = errors_between(drive, row[:-1], row[1:]).position
    after = np.flatnonzero(lasting)
    across = errors_between(drive, after - 1, after).position
    return int(bad.sum()), int((across > _JUMP * np.median(usual)).sum()) if len(usual) else 0
