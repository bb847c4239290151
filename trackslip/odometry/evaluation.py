"""Errors of odometry by a law on logs of drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip import se2
from trackslip.errors import LogError, counted
from trackslip.identification.prediction import PredictionErrors, trailing_heading
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.runlog import MEASURED, RunLog
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.trajectory_errors import Trajectory, errors_after_metres, errors_after_seconds
from trackslip.se2 import Mounting

LENGTHS = (1.0, 2.0, 5.0, 10.0)
"""Lengths of the stretches over which relative errors are taken [m and s]."""
_MIN_POSES = 2


@dataclass(frozen=True)
class OdometryErrors:
    """Errors of odometry by one law."""

    after_metres: Mapping[float, PredictionErrors]
    """By the way driven [m]."""
    after_seconds: Mapping[float, PredictionErrors]
    """By the time passed [s]."""
    trajectories: tuple[Trajectory, ...]
    """The compared trajectories."""
    notes: tuple[str, ...] = ()
    """Parts that could not be evaluated, a line each."""


def odometry_errors(
    logs: RunLog | Sequence[RunLog],
    odometry: SlipOdometry,
    mounting: Mounting | None = None,
    clock_offset: float = 0.0,
) -> OdometryErrors:
    """Errors of odometry against the measured poses of drives.

    Relative errors are errors of the motion over stretches from every measured pose, after LENGTHS of way and time: the
    way is the distance of the middle of the tracks by the encoders, without slip. They include the errors of the
    measured poses at both ends of a stretch. Without measured headings, stretches start with the heading at which the
    odometry fits the positions of the last 10 s.

    Args:
        logs: one or several drives.
        odometry: of the robot; its pose and covariance do not matter. It takes the logs' gyro if it has one.
        mounting: of the sensor that measured the poses; at the turning centre by default.
        clock_offset: encoder clock minus pose clock [s].

    Raises:
        LogError: if no drive has poses to compare with.
    """
    trajectories, notes = [], []
    for log in [logs] if isinstance(logs, RunLog) else logs:
        try:
            trajectories.append(trajectory_of(log, odometry, mounting or Mounting(), clock_offset))
        except LogError as error:
            notes.append(str(error))
    return errors_of(trajectories, notes)


def errors_of(trajectories: Sequence[Trajectory], notes: Sequence[str] = ()) -> OdometryErrors:
    """Errors of estimated trajectories, as `odometry_errors` gives those of odometry; raises LogError without any."""
    if not trajectories:
        raise LogError(notes[0] if notes else "no drives")
    notes, errors = list(notes), {"m": dict[float, PredictionErrors](), "s": dict[float, PredictionErrors]()}
    for unit, errors_after in (("m", errors_after_metres), ("s", errors_after_seconds)):
        short = []
        for length in LENGTHS:
            every = np.concatenate([errors_after(drive, length) for drive in trajectories], axis=1)
            if every.size:
                errors[unit][length] = PredictionErrors.of(*every)
            else:
                short.append(f"{length:g}")
        if short:
            notes.append(f"no two poses are {', '.join(short)} {unit} apart, so relative errors end before")
    return OdometryErrors(errors["m"], errors["s"], tuple(trajectories), tuple(notes))


def trajectory_of(log: RunLog, odometry: SlipOdometry, mounting: Mounting, clock_offset: float) -> Trajectory:
    """Measured poses of a log, and the sensor's poses by odometry; raises LogError if there are fewer than two."""

    def by_odometry(at: Array) -> Array:
        time = np.union1d(log.time, at)
        gyro = None if odometry.gyro is None else _readings(log, time + odometry.gyro.clock)
        path = odometry.path(time, log.omega[np.searchsorted(log.time, time)], gyro)
        return se2.compose(path.pose[np.searchsorted(time, at)], mounting.pose)

    return estimated_trajectory(log, by_odometry, odometry.geometry, clock_offset)


def estimated_trajectory(
    log: RunLog, estimate: Callable[[Array], Array], geometry: RobotGeometry, clock_offset: float
) -> Trajectory:
    """Measured poses of a log, and those that `estimate` gives of the sensor at times (K,) of the encoders' clock.

    Raises LogError if there are fewer than two.
    """
    rows = np.flatnonzero(log.has_place)
    at = log.time[rows] + clock_offset
    covered = (at >= log.time[0]) & (at <= log.time[-1])
    if covered.sum() < _MIN_POSES:
        count = f"{int(covered.sum())} of {counted(len(rows), 'measured pose')}"
        raise LogError(f"run {log.run!r}: encoders were read at {count}, needs at least {_MIN_POSES}")
    rows, at = rows[covered], at[covered]
    estimated = estimate(at)
    measured = log.pose[rows]
    heading = measured[:, 2]
    if not np.isfinite(heading).any():
        place, estimated_place = (pose[:, 0] + 1j * pose[:, 1] for pose in (measured, estimated))
        heading = trailing_heading(at, place, estimated_place, estimated[:, 2])
    speed = np.abs(body_twist(log.omega[1:], 0.0, geometry)[:, 0])
    way = np.concatenate([[0.0], np.cumsum(speed * np.diff(log.time))])
    return Trajectory(log.run, log.time[rows], np.interp(at, log.time, way), measured, estimated, heading)


def _readings(log: RunLog, time: Array) -> Array | None:
    """Mean yaw rates (T,) by the gyro since the time before of (T,), NaN where not measured; None without a gyro."""
    if log.gyro_sums is None:
        return None
    turned, measured = (np.diff(np.interp(time, log.time, sums)) for sums in log.gyro_sums.T)
    step = np.diff(time)
    return np.append(np.nan, np.where(measured >= MEASURED * step, turned / step, np.nan))
