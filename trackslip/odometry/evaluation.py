"""Errors of a law's odometry on logged drives: relative errors over stretches, alignment, and files
for other tools.

The relative error over a stretch is the estimated minus the measured motion from the start to the
end of the stretch, in the frame of the start; see Kuemmerle et al., "On measuring the accuracy of
SLAM algorithms" (2009), and Geiger et al., "Are we ready for autonomous driving? The KITTI vision
benchmark suite" (2012).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.drives.encoders import encoders_of
from trackslip.drives.gyro import mean_yaw_rates, with_usable_gyro
from trackslip.drives.poses import measured_poses
from trackslip.errors import InvalidValueError, LogError, OutputError, counted
from trackslip.identification.prediction import PredictionErrors, trailing_heading
from trackslip.kinematics import Array, RobotGeometry, body_twist, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.se2 import Mounting, rotate

_TOLERANCE = 0.1  # largest relative deviation from the requested length of a stretch, as in evo [-]
_ROUNDING = 1e-6  # rounding of time stamps [s]


@dataclass(frozen=True)
class Trajectory:
    """Measured and estimated poses of a sensor at the same times in a drive."""

    name: str  # name of the drive
    time: Array  # (K,) stamps of the measured poses [s]
    way: Array  # (K,) distance driven up to each pose [m]
    measured: Array  # (K, 3) measured poses [m, m, rad]; headings are NaN where not measured
    estimated: Array  # (K, 3) estimated poses [m, m, rad], from an arbitrary start
    # (K,) headings at starts of stretches, measured or from earlier positions [rad]; NaN if unknown
    heading: Array

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.measured[:, 2]).any())

    @property
    def placed(self) -> Array:
        """Estimated poses (K, 3), aligned at the first pose with a heading or, without headings, at
        all positions.
        """
        if not self.has_heading:
            return best_fit(self.estimated, self.measured)
        return from_pose(
            self.estimated, self.measured, int(np.isfinite(self.measured[:, 2]).argmax())
        )


def errors_after_metres(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches of `length` [m], to within a tenth, that start at each
    pose.
    """
    return errors_between(drive, *stretches(drive.way, length, _TOLERANCE * length))


def errors_after_seconds(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches of `length` [s], to within half an interval, that
    start at each pose.
    """
    usual = float(np.median(np.diff(drive.time))) if len(drive.time) > 1 else 0.0
    return errors_between(
        drive, *stretches(drive.time, length, min(_TOLERANCE * length, usual / 2 + _ROUNDING))
    )


def stretches(axis: Array, length: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (n,) of stretches of about `length` on an ascending axis (K,), with the best
    end for each start.

    Of equally good ends, as at rest, the first is used. Starts without an end within the tolerance
    are left out.
    """
    if len(axis) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    start = np.arange(len(axis))
    after = np.clip(np.searchsorted(axis, axis + length), 1, len(axis) - 1)
    before = np.searchsorted(axis, axis[after - 1])
    missed = np.abs(axis[[before, after]] - axis - length)
    end = np.where(missed[0] <= missed[1], before, after)
    near = (missed.min(axis=0) <= tolerance) & (end > start)
    return start[near], end[near]


def errors_between(drive: Trajectory, start: np.ndarray, end: np.ndarray) -> Array:
    """Errors (3, n) over stretches between poses `start` (n,) and `end` (n,) whose starts have
    known headings.

    The rows are the distance driven [m], the distance between the estimated and the measured end
    [m], and the absolute error of the turn [rad], which is NaN where no turn was measured.
    """
    known = np.isfinite(drive.heading[start])
    start, end = start[known], end[known]
    turn = drive.heading[start] - drive.estimated[start, 2]
    step = drive.estimated[end] - drive.estimated[start]
    driven = np.column_stack([rotate(turn, step[:, :2]), step[:, 2]])
    error = driven - (drive.measured[end] - drive.measured[start])
    position, heading = np.hypot(error[:, 0], error[:, 1]), np.abs(wrap_angle(error[:, 2]))
    return np.stack([drive.way[end] - drive.way[start], position, heading])


def moved(pose: Array, turn: float, pivot: Array, target: Array) -> Array:
    """Turn poses (K, 3) by `turn` [rad] about the point `pivot` (2,), which moves to `target`
    (2,).
    """
    return np.column_stack([target + rotate(turn, pose[:, :2] - pivot), pose[:, 2] + turn])


def best_fit(pose: Array, measured: Array) -> Array:
    """Move poses (K, 3) so that their positions are closest to the measured positions (K, 3), in
    least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns"
    (1991), without scale.
    """
    centre, target = pose[:, :2].mean(axis=0), measured[:, :2].mean(axis=0)
    here, there = (pose[:, :2] - centre) @ [1, 1j], (measured[:, :2] - target) @ [1, 1j]
    return moved(pose, float(np.angle(np.vdot(here, there))), centre, target)


def from_pose(pose: Array, measured: Array, row: int = 0) -> Array:
    """Move poses (K, 3) so that the pose in `row` equals the measured pose in `row` of (K, 3),
    including heading.
    """
    return moved(pose, float(measured[row, 2] - pose[row, 2]), pose[row, :2], measured[row, :2])


def write_tum(path: str | Path, time: ArrayLike, pose: ArrayLike) -> None:
    """Write poses (K, 3) [m, m, rad] at times (K,) [s] in the TUM format for tools such as evo.

    The poses lie in the plane z = 0. NaN headings, which were not measured, are written as 0.

    Raises:
        InvalidValueError: if the numbers of times and poses differ.
        OutputError: if the file cannot be written.
    """
    time, pose = np.asarray(time, float), np.asarray(pose, float)
    if time.ndim != 1 or pose.shape != (len(time), 3):
        raise InvalidValueError(
            "pose", pose.shape, f"of shape {(*time.shape, 3)}, as there are that many times"
        )
    half, none = np.nan_to_num(pose[:, 2], nan=0.0) / 2, np.zeros(len(time))
    rows = np.column_stack([time, pose[:, :2], none, none, none, np.sin(half), np.cos(half)])
    text = "".join(" ".join(map("{:.9f}".format, row)) + "\n" for row in rows.tolist())
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


LENGTHS = (1.0, 2.0, 5.0, 10.0)
"""Lengths of the stretches for relative errors [m and s]."""


@dataclass(frozen=True)
class OdometryErrors:
    """Odometry errors of a law."""

    after_metres: Mapping[float, PredictionErrors]
    """Errors by the distance driven [m]."""
    after_seconds: Mapping[float, PredictionErrors]
    """Errors by the time elapsed [s]."""
    trajectories: tuple[Trajectory, ...]
    """The compared trajectories."""
    notes: tuple[str, ...] = ()
    """Parts of the drives that could not be evaluated, one line each."""


def odometry_errors(
    logs: RunLog | Sequence[RunLog],
    odometry: SlipOdometry,
    mounting: Mounting | None = None,
    clock_offset: float = 0.0,
) -> OdometryErrors:
    """Compute errors of odometry relative to the measured poses in drives.

    Relative errors are errors in the motion over stretches that start at each measured pose and
    last for LENGTHS of distance and time. Distance is that of the middle of the tracks, from the
    encoders without slip. Relative errors include errors of the measured poses at both ends.
    Without measured headings, a stretch starts with the heading at which the odometry fits the
    positions of the last 10 s.

    Args:
        logs: one or several drives.
        odometry: odometry of the robot; its pose and covariance have no effect. With a `gyro`, it
            uses the logs' gyro.
        mounting: mounting of the sensor that measured the poses; at the turning centre by default.
        clock_offset: encoder clock minus pose clock [s].

    Raises:
        LogError: if no drive has at least two measured poses during its encoder readings.
    """
    trajectories = list[Trajectory]()
    notes = list[str]()
    for log in [logs] if isinstance(logs, RunLog) else logs:
        try:
            if odometry.gyro is not None:
                log, note = with_usable_gyro(log)
                notes += [note] if note else []
            trajectories.append(trajectory_of(log, odometry, mounting or Mounting(), clock_offset))
        except LogError as error:
            notes.append(str(error))
    return errors_of(trajectories, notes)


def errors_of(trajectories: Sequence[Trajectory], notes: Sequence[str] = ()) -> OdometryErrors:
    """Summarise errors of trajectories, as in `odometry_errors`; raises LogError if there are no
    trajectories.
    """
    if not trajectories:
        raise LogError(notes[0] if notes else "no drives")
    notes, errors = (
        list(notes),
        {"m": dict[float, PredictionErrors](), "s": dict[float, PredictionErrors]()},
    )
    for unit, errors_after in (("m", errors_after_metres), ("s", errors_after_seconds)):
        short = []
        for length in LENGTHS:
            every = np.concatenate([errors_after(drive, length) for drive in trajectories], axis=1)
            if every.size:
                errors[unit][length] = PredictionErrors.of(*every)
            else:
                short.append(f"{length:g}")
        if short:
            notes.append(
                f"no two poses are {', '.join(short)} {unit} apart, so relative errors end before"
            )
    return OdometryErrors(errors["m"], errors["s"], tuple(trajectories), tuple(notes))


def trajectory_of(
    log: RunLog, odometry: SlipOdometry, mounting: Mounting, clock_offset: float
) -> Trajectory:
    """Trajectory with the measured poses of a log and the sensor's poses by odometry; LogError for
    fewer than two.
    """

    encoders = encoders_of(log)

    def by_odometry(at: Array) -> Array:
        time = np.union1d(log.time, at)
        gyro = None
        if odometry.gyro is not None:
            gyro = mean_yaw_rates(log, time + odometry.gyro.clock)
        path = odometry.path(time, encoders.at(time), gyro)
        return se2.compose(path.pose[np.searchsorted(time, at)], mounting.pose)

    return estimated_trajectory(log, by_odometry, odometry.geometry, clock_offset)


def estimated_trajectory(
    log: RunLog, estimate: Callable[[Array], Array], geometry: RobotGeometry, clock_offset: float
) -> Trajectory:
    """Trajectory with the measured poses of a log and the poses that `estimate` returns for encoder
    times (K,) [s].

    Raises LogError for fewer than two poses.
    """
    # the measured positions, at which encoders were read
    poses = measured_poses(log)
    placed = np.isfinite(poses.pose[:, 0])
    time = poses.time[placed]
    measured = poses.pose[placed]
    at = time + clock_offset
    covered = (at >= log.time[0]) & (at <= log.time[-1])
    if covered.sum() < 2:
        count = f"{int(covered.sum())} of {counted(len(time), 'measured pose')}"
        raise LogError(f"run {log.run!r}: encoders were read at {count}, needs at least 2")
    time = time[covered]
    at = at[covered]
    measured = measured[covered]

    # without measured headings, those of the estimate fitted to the positions before
    estimated = estimate(at)
    heading = measured[:, 2]
    if not np.isfinite(heading).any():
        place, estimated_place = (pose[:, 0] + 1j * pose[:, 1] for pose in (measured, estimated))
        heading = trailing_heading(at, place, estimated_place, estimated[:, 2])

    encoders = encoders_of(log)
    speed = np.abs(body_twist(encoders.omega, 0.0, geometry)[:, 0])
    way = np.append(0.0, np.cumsum(speed * np.diff(encoders.edges)))
    way = np.interp(at, encoders.edges, way)
    return Trajectory(log.run, time, way, measured, estimated, heading)
