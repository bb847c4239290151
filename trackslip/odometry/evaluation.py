"""Errors of odometry by a law on logs of drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip import se2
from trackslip.errors import InvalidValueError, LogError, counted
from trackslip.identification.prediction import trailing_heading
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.runlog import MEASURED, RunLog
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.trajectory_errors import (
    Statistics,
    Stretches,
    Trajectory,
    absolute_errors,
    errors_after_metres,
    errors_after_seconds,
)
from trackslip.se2 import Mounting

LENGTHS = (1.0, 2.0, 5.0, 10.0)
"""Lengths of the stretches over which relative errors are taken [m and s]."""
_MIN_POSES = 2
_STRETCHES = ("way", "position", "heading")  # arrays of Stretches


@dataclass(frozen=True)
class PoseErrors:
    """Errors of poses."""

    position: Statistics | None
    """Errors of positions [m]; None if there are none."""
    heading: Statistics | None
    """Absolute errors of headings [rad]; None if none were measured."""


@dataclass(frozen=True)
class RelativeErrors(PoseErrors):
    """Errors at the ends of stretches of one length, from every start."""

    count: int
    """Number of stretches, which overlap."""
    position_per_way: float
    """Sum of the position errors over the distance driven; NaN at rest [-]."""
    heading_per_way: float
    """Sum of the heading errors over the distance driven; NaN if none were measured [rad/m]."""


@dataclass(frozen=True)
class DriveErrors:
    """Absolute errors on one drive."""

    name: str
    poses: int
    duration: float
    """From the first to the last pose [s]."""
    way: float
    """Driven between them [m]."""
    aligned: PoseErrors
    """After alignment to all positions."""
    from_first: PoseErrors
    """After alignment to the first pose."""


@dataclass(frozen=True)
class OdometryErrors:
    """Errors of odometry by one law."""

    aligned: PoseErrors
    """Absolute ones, with each drive aligned to all its measured positions, as by Umeyama, without scale."""
    from_first: PoseErrors
    """Absolute ones, with each drive aligned to its first measured pose."""
    after_metres: Mapping[float, RelativeErrors]
    """Relative ones by the way driven [m]."""
    after_seconds: Mapping[float, RelativeErrors]
    """Relative ones by the time passed [s]."""
    drives: tuple[DriveErrors, ...]
    """Absolute ones by drive."""
    trajectories: tuple[Trajectory, ...]
    """The compared trajectories."""
    notes: tuple[str, ...] = ()
    """Parts that could not be evaluated, a line each."""


def odometry_errors(
    logs: RunLog | Sequence[RunLog],
    odometry: SlipOdometry,
    mounting: Mounting | None = None,
    clock_offset: float = 0.0,
    lengths: Sequence[float] = LENGTHS,
) -> OdometryErrors:
    """Errors of odometry against the measured poses of drives.

    Relative errors are errors of the motion over stretches from every measured pose, after `lengths` of way and time:
    the way is the distance of the middle of the tracks by the encoders, without slip. They include the errors of the
    measured poses at both ends of a stretch. Without measured headings, stretches start with the heading at which the
    odometry fits the positions of the last 10 s.

    Args:
        logs: one or several drives.
        odometry: of the robot; its pose and covariance do not matter. It takes the logs' gyro if it has one.
        mounting: of the sensor that measured the poses; at the turning centre by default.
        clock_offset: encoder clock minus pose clock [s].
        lengths: of stretches [m and s].

    Raises:
        LogError: if no drive has poses to compare with.
        InvalidValueError: for a length that is not positive.
    """
    for length in lengths:
        if not 0 < length < np.inf:
            raise InvalidValueError("lengths", length, "finite and > 0")
    trajectories, notes = [], []
    for log in [logs] if isinstance(logs, RunLog) else logs:
        try:
            trajectories.append(trajectory_of(log, odometry, mounting or Mounting(), clock_offset))
        except LogError as error:
            notes.append(str(error))
    return errors_of(trajectories, notes, lengths)


def errors_of(
    trajectories: Sequence[Trajectory], notes: Sequence[str] = (), lengths: Sequence[float] = LENGTHS
) -> OdometryErrors:
    """Errors of estimated trajectories, as `odometry_errors` gives those of odometry; raises LogError without any."""
    notes = list(notes)
    if not trajectories:
        raise LogError(notes[0] if notes else "no drives")
    after_metres, after_seconds = (
        {length: errors for length in lengths if (errors := _relative([of(one, length) for one in trajectories]))}
        for of in (errors_after_metres, errors_after_seconds)
    )
    for unit, found in (("m", after_metres), ("s", after_seconds)):
        short = [f"{length:g}" for length in lengths if length not in found]
        if short:
            notes.append(f"no two poses are {', '.join(short)} {unit} apart, so relative errors end before")
    return OdometryErrors(
        aligned=_absolute(trajectories, aligned=True),
        from_first=_absolute(trajectories, aligned=False),
        after_metres=after_metres,
        after_seconds=after_seconds,
        drives=tuple(_of_drive(one) for one in trajectories),
        trajectories=tuple(trajectories),
        notes=tuple(notes),
    )


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
        heading = trailing_heading(at, measured[:, :2], estimated)
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


def _absolute(trajectories: Sequence[Trajectory], aligned: bool) -> PoseErrors:
    """Absolute errors of all drives together."""
    errors = [absolute_errors(drive, aligned) for drive in trajectories]
    position, heading = (np.concatenate(part) for part in zip(*errors, strict=True))
    return PoseErrors(Statistics.of(_known(position)), Statistics.of(_known(heading)))


def _relative(parts: Sequence[Stretches]) -> RelativeErrors | None:
    """Relative errors of all drives together; None if there is no stretch."""
    found = Stretches(*(np.concatenate([getattr(one, name) for one in parts]) for name in _STRETCHES))
    if not len(found.way):
        return None
    turned = np.isfinite(found.heading)
    return RelativeErrors(
        position=Statistics.of(found.position),
        heading=Statistics.of(found.heading[turned]),
        count=len(found.way),
        position_per_way=_ratio(found.position, found.way),
        heading_per_way=_ratio(found.heading[turned], found.way[turned]),
    )


def _of_drive(drive: Trajectory) -> DriveErrors:
    span = slice(None, None, max(1, len(drive.time) - 1))
    duration, way = (float(np.diff(values[span]).sum()) for values in (drive.time, drive.way))
    return DriveErrors(
        drive.name, len(drive.time), duration, way, _absolute([drive], aligned=True), _absolute([drive], aligned=False)
    )


def _ratio(errors: Array, way: Array) -> float:
    """Sum of errors (n,) over the sum of ways (n,); NaN at rest."""
    return float(errors.sum() / way.sum()) if way.sum() > 0 else float("nan")


def _known(errors: Array) -> Array:
    return errors[np.isfinite(errors)]
