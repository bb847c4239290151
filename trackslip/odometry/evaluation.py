"""Errors of a law's odometry on logged drives: relative errors over stretches, alignment, and files
for other tools.

The relative error over a stretch is the estimated minus the measured motion from the start to the
end of the stretch, in the frame of the start; see Kuemmerle et al., "On measuring the accuracy of
SLAM algorithms" (2009), and Geiger et al., "Are we ready for autonomous driving? The KITTI vision
benchmark suite" (2012).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.drives.encoders import encoders_of
from trackslip.drives.gyro import (
    mean_yaw_rates,
    measures_alone,
    with_headings_by_gyro,
    with_usable_gyro,
)
from trackslip.drives.poses import measured_poses
from trackslip.errors import InvalidValueError, LogError, OutputError, counted
from trackslip.identification.prediction import PredictionErrors, trailing_heading
from trackslip.kinematics import Array, RobotGeometry, body_twist, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import STANDING
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.se2 import Mounting, rotate
from trackslip.viewable import ShortRepr, Viewable

LENGTHS: Final = (1.0, 2.0, 5.0, 10.0)
"""Lengths of the stretches for relative errors [m and s]."""
# largest relative deviation from the requested length of a stretch, as in evo [-]
_TOLERANCE: Final = 0.1
_ROUNDING: Final = 1e-6  # rounding of time stamps [s]


@dataclass(frozen=True, repr=False)
class Trajectory(ShortRepr):
    """Measured and estimated poses of a sensor at the same times in a drive."""

    name: str  # name of the drive
    time: Array  # (K,) stamps of the measured poses [s]
    distance: Array  # (K,) distance driven up to each pose [m]
    measured: Array  # (K, 3) measured poses [m, m, rad]; headings are NaN where not measured
    estimated: Array  # (K, 3) estimated poses [m, m, rad], from an arbitrary start
    # (K,) headings at starts of stretches, measured or from earlier positions [rad]; NaN if unknown
    heading: Array
    # (K,) bool: true for poses at which stretches start; of those at rest, which would all start
    # the same stretch, only the first
    starts: np.ndarray

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.measured[:, 2]).any())

    @property
    def placed(self) -> Array:
        """Estimated poses (K, 3), aligned at the first pose with a heading or, without headings, at
        all positions. Without positions, the first pose is at the origin.
        """
        if not self.has_heading:
            return best_fit(self.estimated, self.measured)
        first = int(np.isfinite(self.measured[:, 2]).argmax())
        if not np.isfinite(self.measured[:, 0]).any():
            return from_pose(self.estimated, np.nan_to_num(self.measured), first)
        return from_pose(self.estimated, self.measured, first)


def errors_after_metres(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches of `length` [m], to within a tenth, that start at each
    pose.
    """
    start, end = stretches(drive.distance, length, _TOLERANCE * length)
    return errors_between(drive, start, end)


def errors_after_seconds(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches of `length` [s], to within half an interval, that
    start at each pose.
    """
    interval = float(np.median(np.diff(drive.time))) if len(drive.time) > 1 else 0.0
    tolerance = min(_TOLERANCE * length, interval / 2 + _ROUNDING)
    start, end = stretches(drive.time, length, tolerance)
    return errors_between(drive, start, end)


def stretches(axis: Array, length: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (n,) of stretches of about `length` on an ascending axis (K,), with the best
    end for each start.

    Of equally good ends, as at rest, the first is used. Starts without an end within the tolerance
    are left out.
    """
    if len(axis) < 2:
        none = np.zeros(0, int)
        return none, none

    # the places on both sides of each wanted end; of equal places before it, the first
    wanted = axis + length
    after = np.clip(np.searchsorted(axis, wanted), 1, len(axis) - 1)
    before = np.searchsorted(axis, axis[after - 1])
    missed_before = np.abs(axis[before] - axis - length)
    missed_after = np.abs(axis[after] - axis - length)

    start = np.arange(len(axis))
    end = np.where(missed_before <= missed_after, before, after)
    is_near = np.minimum(missed_before, missed_after) <= tolerance
    kept = is_near & (end > start)
    return start[kept], end[kept]


def errors_between(drive: Trajectory, start: np.ndarray, end: np.ndarray) -> Array:
    """Errors (3, n) over stretches between poses `start` (n,) and `end` (n,), of those that start
    with a known heading, and not with a pose at rest like the one before.

    The rows are the distance driven [m], the distance between the estimated and the measured end
    [m], and the absolute error of the turn [rad]; errors are NaN where no position, or no turn, was
    measured.
    """
    is_start = np.isfinite(drive.heading[start]) & drive.starts[start]
    start = start[is_start]
    end = end[is_start]

    # the estimated motion, turned so that it starts with the measured heading
    turn = drive.heading[start] - drive.estimated[start, 2]
    step = drive.estimated[end] - drive.estimated[start]
    estimated = np.column_stack([rotate(turn, step[:, :2]), step[:, 2]])
    measured = drive.measured[end] - drive.measured[start]

    error = estimated - measured
    distance = drive.distance[end] - drive.distance[start]
    position_error = np.hypot(error[:, 0], error[:, 1])
    heading_error = np.abs(wrap_angle(error[:, 2]))
    return np.stack([distance, position_error, heading_error])


def moved(pose: Array, turn: float, pivot: Array, target: Array) -> Array:
    """Turn poses (K, 3) by `turn` [rad] about the point `pivot` (2,), which moves to `target`
    (2,).
    """
    position = target + rotate(turn, pose[:, :2] - pivot)
    return np.column_stack([position, pose[:, 2] + turn])


def best_fit(pose: Array, measured: Array) -> Array:
    """Move poses (K, 3) so that their positions are closest to the measured positions (K, 3), in
    least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns"
    (1991), without scale. In the plane, with the positions p_k and the measured positions q_k as
    complex numbers relative to their means, the turn by the angle of sum_k conj(p_k) q_k minimises
    the sum of |q_k - exp(i turn) p_k|^2.
    """
    centre = pose[:, :2].mean(axis=0)
    target = measured[:, :2].mean(axis=0)
    p = (pose[:, :2] - centre) @ [1, 1j]
    q = (measured[:, :2] - target) @ [1, 1j]
    turn = float(np.angle(np.vdot(p, q)))
    return moved(pose, turn, centre, target)


def from_pose(pose: Array, measured: Array, row: int = 0) -> Array:
    """Move poses (K, 3) so that the pose in `row` equals the measured pose in `row` of (K, 3),
    including heading.
    """
    turn = float(measured[row, 2] - pose[row, 2])
    return moved(pose, turn, pivot=pose[row, :2], target=measured[row, :2])


@checks_arguments
def write_tum(path: str | Path, time: ArrayLike, pose: ArrayLike) -> None:
    """Write poses (K, 3) [m, m, rad] at times (K,) [s] in the TUM format for tools such as evo.

    The poses lie in the plane z = 0. NaN positions and headings, which were not measured, are
    written as 0.

    Raises:
        InvalidValueError: if the numbers of times and poses differ.
        OutputError: if the file cannot be written.
    """
    time = np.asarray(time, float)
    pose = np.asarray(pose, float)
    if time.ndim != 1 or pose.shape != (len(time), 3):
        allowed = f"of shape {(*time.shape, 3)}, as there are that many times"
        raise InvalidValueError("pose", pose.shape, allowed)

    # the columns: t, x, y, z, and a quaternion x, y, z, w for the rotation about z
    x, y, heading = np.where(np.isnan(pose), 0.0, pose).T
    half_heading = heading / 2
    zero = np.zeros(len(time))
    columns = [time, x, y, zero, zero, zero, np.sin(half_heading), np.cos(half_heading)]
    lines = [
        " ".join(f"{value:.9f}" for value in row) + "\n"
        for row in np.column_stack(columns).tolist()
    ]
    text = "".join(lines)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


@dataclass(frozen=True)
class OdometryErrors(Viewable):
    """Odometry errors of a law."""

    after_metres: Mapping[float, PredictionErrors]
    """Errors by the distance driven [m]."""
    after_seconds: Mapping[float, PredictionErrors]
    """Errors by the time elapsed [s]."""
    trajectories: tuple[Trajectory, ...]
    """The compared trajectories."""
    notes: tuple[str, ...] = ()
    """Parts of the drives that could not be evaluated, one line each."""

    def __repr__(self) -> str:
        drives = counted(len(self.trajectories), "drive")
        by_length = self.after_metres or self.after_seconds
        if not by_length:
            return f"<OdometryErrors in {drives}>"
        unit = "m" if self.after_metres else "s"
        length, errors = max(by_length.items())
        parts = []
        if errors.position is not None:
            parts.append(f"{errors.position.median:.3g} m")
        if errors.heading is not None:
            parts.append(f"{math.degrees(errors.heading.median):.3g}°")
        medians = " and ".join(parts)
        return f"<OdometryErrors in {drives}: median {medians} after {length:g} {unit}>"


@checks_arguments
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
    positions of the last 10 s. If a gyro measures alone, its headings count as measured.

    Args:
        logs: one or several drives.
        odometry: odometry of the robot; its pose and covariance have no effect. With a `gyro`, it
            uses the logs' gyro.
        mounting: mounting of the sensor that measured the poses; at the turning centre by default.
        clock_offset: encoder clock minus pose clock [s].

    Raises:
        LogError: if no drive has at least two measured poses during its encoder readings, or a gyro
            measures alone and the odometry uses it, too.
    """
    trajectories = []
    notes = []
    drives = [logs] if isinstance(logs, RunLog) else logs
    for log in drives:
        try:
            if odometry.gyro is not None:
                if measures_alone(log):
                    raise LogError(
                        f"run {log.run!r}: only its gyro measures headings, and the odometry uses "
                        "it, too: give odometry without gyro"
                    )
                log, note = with_usable_gyro(log)
                notes += [note] if note else []
            log = with_headings_by_gyro(log)
            drive = trajectory_of(log, odometry, mounting or Mounting(), clock_offset)
        except LogError as error:
            notes.append(str(error))
        else:
            trajectories.append(drive)
    return errors_of(trajectories, notes)


def errors_of(trajectories: Sequence[Trajectory], notes: Sequence[str] = ()) -> OdometryErrors:
    """Summarise errors of trajectories, as in `odometry_errors`; raises LogError if there are no
    trajectories.
    """
    if not trajectories:
        raise LogError(notes[0] if notes else "no drives")
    after_metres, notes_on_metres = _by_length(trajectories, errors_after_metres, "m")
    after_seconds, notes_on_seconds = _by_length(trajectories, errors_after_seconds, "s")
    return OdometryErrors(
        after_metres=after_metres,
        after_seconds=after_seconds,
        trajectories=tuple(trajectories),
        notes=(*notes, *notes_on_metres, *notes_on_seconds),
    )


def _by_length(
    trajectories: Sequence[Trajectory],
    errors_after: Callable[[Trajectory, float], Array],
    unit: str,
) -> tuple[dict[float, PredictionErrors], list[str]]:
    """Errors of all trajectories by the length of stretches, and a note on missing lengths."""
    errors = {}
    missing = []
    for length in LENGTHS:
        of_drives = [errors_after(drive, length) for drive in trajectories]
        distance, position, heading = np.concatenate(of_drives, axis=1)
        if distance.size:
            errors[length] = PredictionErrors.of(distance, position, heading)
        else:
            missing.append(f"{length:g}")
    if not missing:
        return errors, []
    lengths = ", ".join(missing)
    return errors, [f"no two poses are {lengths} {unit} apart, so relative errors end before"]


def trajectory_of(
    log: RunLog, odometry: SlipOdometry, mounting: Mounting, clock_offset: float
) -> Trajectory:
    """Trajectory with the measured poses of a log and the sensor's poses by odometry; LogError for
    fewer than two.
    """

    encoders = encoders_of(log).smooth()

    def by_odometry(at: Array) -> Array:
        # rows at the times of readings and of poses; a reading is a mean since the row before it
        time = np.union1d(encoders.edges, at)
        gyro = None
        if odometry.gyro is not None:
            gyro = mean_yaw_rates(log, time + odometry.gyro.clock)
        path = odometry.path(time, encoders.at(time), gyro)
        rows = np.searchsorted(time, at)
        return se2.compose(path.pose[rows], mounting.pose)

    return estimated_trajectory(log, by_odometry, odometry.geometry, clock_offset)


def estimated_trajectory(
    log: RunLog, estimate: Callable[[Array], Array], geometry: RobotGeometry, clock_offset: float
) -> Trajectory:
    """Trajectory with the measured poses of a log and the poses that `estimate` returns for encoder
    times (K,) [s].

    Raises LogError for fewer than two poses.
    """
    # measured positions or, where there are none, headings
    poses = measured_poses(log)
    is_placed = np.isfinite(poses.pose[:, 0])
    used = is_placed if is_placed.any() else np.isfinite(poses.pose[:, 2])
    time = poses.time[used]
    measured = poses.pose[used]

    # those in the time of the encoders
    encoder_time = time + clock_offset
    is_covered = (encoder_time >= log.time[0]) & (encoder_time <= log.time[-1])
    covered = int(is_covered.sum())
    if covered < 2:
        count = f"{covered} of {counted(len(time), 'measured pose')}"
        raise LogError(f"run {log.run!r}: encoders were read at {count}, needs at least 2")
    time = time[is_covered]
    encoder_time = encoder_time[is_covered]
    measured = measured[is_covered]
    estimated = estimate(encoder_time)

    # where no heading is measured, positions before a pose show its heading
    heading = measured[:, 2]
    if not np.isfinite(heading).any():
        place = measured[:, 0] + 1j * measured[:, 1]
        estimated_place = estimated[:, 0] + 1j * estimated[:, 1]
        heading = trailing_heading(encoder_time, place, estimated_place, estimated[:, 2])

    # how far the sprockets have turned, whatever their signs, and the middle of tracks without slip
    encoders = encoders_of(log).smooth()
    step = np.diff(encoders.edges)
    fastest = np.abs(encoders.omega).max(axis=1)
    turned = np.append(0.0, np.cumsum(fastest * step))
    middle = np.abs(body_twist(encoders.omega, 0.0, geometry)[:, 0])
    driven = np.append(0.0, np.cumsum(middle * step))
    moves = np.diff(np.interp(encoder_time, encoders.edges, turned)) > STANDING
    return Trajectory(
        name=log.run,
        time=time,
        distance=np.interp(encoder_time, encoders.edges, driven),
        measured=measured,
        estimated=estimated,
        heading=heading,
        starts=np.append(True, moves),
    )
