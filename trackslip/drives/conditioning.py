"""Clean drives made from logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from trackslip.drives.drive import MOST_INTERVALS, Drive
from trackslip.drives.encoders import BENDS, encoders_of
from trackslip.drives.gyro import headings_by_gyro, turn_sums, with_usable_gyro
from trackslip.drives.poses import Poses, distinct_rows, measured_poses
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.logs.checks import unwrapped_headings
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.motion.steady import STANDING

FEW: Final = 5  # number of rows or windows that may occur by chance


def drives_of(logs: Sequence[RunLog]) -> tuple[list[Drive], list[Refused]]:
    """Prepare the usable drives and list the refused logs; raises LogError if no drive is
    usable.

    If there are too many encoder intervals in total, several are merged into one.
    """
    drives = list[Drive]()
    refused = list[Refused]()
    names = dict[bytes, str]()  # of the drives, by their content
    rows = max(sum(len(log.time) for log in logs), MOST_INTERVALS)
    for log in logs:
        try:
            drive = drive_of(log, len(log.time) * MOST_INTERVALS // rows)
            content = drive.omega.tobytes() + drive.pose.tobytes()
            if content in names:
                raise LogError(f"run {log.run!r}: a copy of run {names[content]!r}")
            names[content] = log.run
            drives.append(drive)
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if not drives:
        raise LogError(none_usable(refused) if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, most_intervals: int = MOST_INTERVALS) -> Drive:
    """Prepare the drive in a log; raises LogError for a robot at rest, for too few poses, and for a
    gyro in a wrong unit.

    Of poses more than about 40 times a second, every second or third and so on is kept, counted
    from the first. So a part of the log may keep others than the whole log.
    """
    # Encoders: mean speeds between readings.
    if not np.abs(log.omega[1:]).max() > STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    encoders = encoders_of(log)
    _refuse_zeros(log.run, "omega_l and omega_r", encoders.omega, "encoder was read")

    # Gyro: with the right axis and unit. On its own, it measures the headings.
    log, note = with_usable_gyro(log)
    gyro_alone = log.gyro is not None and not log.is_valid.any() and log.beyond is None
    if gyro_alone:
        poses = headings_by_gyro(log)
        gyro = None
    else:
        poses = measured_poses(log)
        gyro = turn_sums(log)

    # Poses: those that were measured, and no more than the path needs.
    _require_poses(log, poses)
    usual = _usual_interval(log, poses)
    time, pose = _thinned(poses, usual)

    # All of them, by their own clocks.
    encoders = encoders.merged(most_intervals)
    return Drive(
        name=log.run,
        edges=encoders.edges,
        omega=encoders.omega,
        time=time,
        pose=pose,
        interval=float(np.median(np.diff(time))) if len(time) > 1 else usual,
        gyro=None if gyro is None else np.column_stack([log.time, gyro]),
        command=_constant_command(log),
        beyond=log.beyond,
        repeated=poses.repeated,
        interpolated=poses.interpolated,
        has_whole_speeds=bool((log.omega == log.omega.round()).all()),
        notes=(note,) if note else (),
    )


def _require_poses(log: RunLog, poses: Poses) -> None:
    """Raise LogError for fewer than two poses, and for zeros where none was measured."""
    count = len(poses.time)
    others = 0 if log.beyond is None else len(log.beyond)
    if count < 2 and others < 2:
        raise LogError(
            f"run {log.run!r}: {counted(count, 'pose')} while it drives, needs at least 2"
        )
    pose = log.pose[distinct_rows(log)]
    columns = "x, y and phi" if np.isfinite(pose[:, 2]).any() else "x and y"
    _refuse_zeros(log.run, columns, np.nan_to_num(pose), "pose was measured")


def _refuse_zeros(run: str, columns: str, values: Array, measured: str) -> None:
    """Refuse columns with these values (n, k) if all of them repeatedly drop to 0, or rise from it,
    for a single row.
    """
    zero = (values == 0).all(axis=1)
    changes = np.diff(zero.astype(int)) != 0
    alone = int((changes[1:] & changes[:-1]).sum())  # rows that differ from both neighbours
    if alone > max(FEW, 0.1 * len(zero)):
        raise LogError(
            f"run {run!r}: columns {columns} go to 0 and back {alone:,} times: leave cells empty "
            f"where no {measured}"
        )


def _usual_interval(log: RunLog, poses: Poses) -> float:
    """Usual time between poses [s], or between those outside the encoder readings."""
    if len(poses.time) > 1 or log.beyond is None:
        return float(np.median(np.diff(poses.time)))
    return float(np.median(np.diff(log.beyond[:, 0])))


def _thinned(poses: Poses, usual: float) -> tuple[Array, Array]:
    """Times (K,) and poses (K, 3) about BENDS apart, with unwrapped headings, from poses `usual`
    apart [s].
    """
    stride = max(1, int(BENDS / usual + 0.1))
    time = poses.time[::stride]
    pose = poses.pose[::stride].copy()
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = unwrapped_headings(pose[headed, 2])
    return time, pose


def _constant_command(log: RunLog) -> tuple[float, ...] | None:
    """The commanded sprocket speeds [rad/s], if constant throughout."""
    if log.command is None or np.ptp(log.command, axis=0).any():
        return None
    return tuple(log.command[0].tolist())
