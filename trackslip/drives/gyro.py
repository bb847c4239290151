"""A gyro's turns: about which axis, with which sign, in which unit, and whether they are the
robot's.

The same rules hold for all logs. A gyro must follow the headings or, where none are measured, the
sprockets. Its turns are compared with theirs by correlation about zero: Pearson's, about the means,
would be noise for a robot that keeps turning at one rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.drives.poses import Poses
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MEASURED, RunLog

# duration of the turns that are compared: poses may be stamped half a second late [s]
_TURN_TIME: Final = 2.0
_FEWEST_TURNS: Final = 5  # least number of turns for a comparison
_LEAST_TURN: Final = 0.1  # least rms of the turns for a comparison [rad]
# least correlation with the robot's turns: of ten turns about a random axis of three, 3 % reach it
_FOLLOWS: Final = 0.8
_SAME_UNIT: Final = (0.5, 2.0)  # limits on the ratio between turns in the same unit [-]
# component above which the yaw axis counts as an axis of the IMU, for an angle below 11° [-]
_ALONG: Final = 0.98
_UPWARDS: Final = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Turns:
    """Turns of a robot during each _TURN_TIME, and a gyro's about k axes."""

    robot: Array  # (n,) by the headings or the sprockets [rad], of unknown scale by the latter
    gyro: Array  # (k, n) [rad]
    by_headings: bool

    @property
    def compared(self) -> bool:
        """True if the robot turns often and far enough for a comparison."""
        enough = len(self.robot) >= _FEWEST_TURNS
        return enough and bool(np.mean(self.robot**2) >= _LEAST_TURN**2)

    def about(self, axis: Array) -> Array:
        """The gyro's turns (n,) about an axis (k,) [rad]."""
        return axis @ self.gyro

    def agreement(self, axis: Array) -> float:
        """Correlation about zero of the robot's turns with the gyro's about an axis (k,)."""
        turns = self.about(axis)
        size = np.linalg.norm(self.robot) * np.linalg.norm(turns)
        return float(self.robot @ turns / size) if size > 0 else 0.0

    def scale(self, axis: Array) -> float:
        """How many times as far the gyro turns about an axis (k,) as the robot."""
        return float(self.robot @ self.about(axis) / (self.robot @ self.robot))


def turns_of(log: RunLog, angles: Array) -> Turns:
    """Turns of the robot in a log, and of a gyro by its angles (k, T) at the log's rows [rad]."""
    by_headings = bool(log.has_heading.any())
    if by_headings:
        rows = np.flatnonzero(log.has_heading)
        heading = np.unwrap(log.pose[rows, 2])
    else:
        rows = np.arange(len(log.time))
        difference = log.omega[1:] @ [-1.0, 1.0]
        heading = np.append(0.0, np.cumsum(difference * np.diff(log.time)))
    time = log.time[rows]
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _TURN_TIME)))
    return Turns(np.diff(heading[ends]), np.diff(angles[:, rows[ends]]), by_headings)


@dataclass(frozen=True)
class YawAxis:
    """The axis about which an IMU turns when the robot turns to the left."""

    axis: Array  # (3,) in the IMU's frame
    found: bool  # false if it is assumed, because the robot hardly turns


def yaw_axis(log: RunLog, angles: Array) -> YawAxis | None:
    """The yaw axis of an IMU that turned by `angles` (3, T) about its axes up to each row of a log
    [rad]; None if none of its axes follows the robot's turns.
    """
    turns = turns_of(log, angles)
    if not turns.compared:
        return YawAxis(np.array(_UPWARDS), found=False)
    covariance = turns.gyro @ turns.robot
    axis = covariance / max(float(np.linalg.norm(covariance)), 1e-300)
    if np.abs(axis).max() > _ALONG:
        axis = np.where(np.abs(axis) > _ALONG, np.sign(axis), 0.0)
    return YawAxis(axis, found=True) if turns.agreement(axis) >= _FOLLOWS else None


def with_usable_gyro(log: RunLog) -> tuple[RunLog, str]:
    """The log, without its gyro if that doesn't follow the robot's turns, and a line that says so,
    or else an empty one.

    Raises LogError for yaw rates in a wrong unit or positive clockwise.
    """
    sums = turn_sums(log)
    if sums is None:
        return log, ""
    turns = turns_of(log, sums[None, :, 0])
    yaw = np.ones(1)
    if not turns.compared or not turns.about(yaw).any():
        return log, ""
    agreement = turns.agreement(yaw)
    leader = "headings" if turns.by_headings else "sprockets"
    if abs(agreement) < _FOLLOWS:
        why = f"its turns don't follow the {leader} (correlation {agreement:.2f})"
        return replace(log, gyro=None), f"run {log.run!r}: gyro left out: {why}"

    least, most = _SAME_UNIT
    must = "it must be in rad/s, counter-clockwise"
    if turns.by_headings and not least < turns.scale(yaw) < most:
        times = f"it turns {turns.scale(yaw):.3g} times as far as the headings"
        raise LogError(f"run {log.run!r}: gyro: {times}: {must}")
    if agreement < 0:
        raise LogError(f"run {log.run!r}: gyro: it turns against the sprockets: {must}")
    return log, ""


def turn_sums(log: RunLog) -> Array | None:
    """Sums (T, 2) up to each row: the gyro's turn [rad] and the time with readings [s]; None
    without a gyro.
    """
    if log.gyro is None:
        return None
    rates = np.column_stack([np.nan_to_num(log.gyro), np.isfinite(log.gyro)])[1:]
    steps = rates * np.diff(log.time)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def mean_yaw_rates(log: RunLog, time: Array) -> Array | None:
    """Mean yaw rates (T,) from the gyro between successive times (T,) [rad/s], NaN if not measured;
    None without a gyro.
    """
    sums = turn_sums(log)
    if sums is None:
        return None
    turned, measured = (np.diff(np.interp(time, log.time, column)) for column in sums.T)
    step = np.diff(time)
    rate = np.where(measured >= MEASURED * step, turned / step, np.nan)
    return np.append(np.nan, rate)


def measures_alone(log: RunLog) -> bool:
    """True if a gyro, and nothing else, measures the motion in a log."""
    return log.gyro is not None and not log.is_valid.any() and log.beyond is None


def with_headings_by_gyro(log: RunLog) -> RunLog:
    """The log with its gyro's headings as poses and without the gyro, if that measures alone, else
    the log.

    Raises LogError for a gyro that doesn't follow the sprockets, or with a wrong sign.
    """
    if not measures_alone(log):
        return log
    usable, note = with_usable_gyro(log)
    if usable.gyro is None:
        raise LogError(note)
    return replace(log, pose=headings_by_gyro(log).pose, valid=None, gyro=None)


def headings_by_gyro(log: RunLog) -> Poses:
    """Headings from a log's gyro in all of its rows, without positions.

    The gyro's bias comes from the sprockets: a robot turns in proportion to their difference, and
    the rest of the yaw rate is the bias. Where the gyro wasn't read, the sprockets tell the turns.
    """
    assert log.gyro is not None
    difference = log.omega @ [-1.0, 1.0]
    read = np.isfinite(log.gyro)
    columns = np.column_stack([difference, np.ones(len(log.time))])
    proportion, bias = np.linalg.lstsq(columns[read], log.gyro[read])[0]
    rate = np.where(read, log.gyro - bias, proportion * difference)
    heading = np.append(0.0, np.cumsum(rate[1:] * np.diff(log.time)))
    nowhere = np.full((len(heading), 2), np.nan)
    return Poses(log.time, np.column_stack([nowhere, heading]), repeated=0, interpolated=0)
