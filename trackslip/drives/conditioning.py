"""Clean drives made from logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from trackslip.drives.drive import Drive
from trackslip.drives.encoders import counts_few_ticks, interval_means, merged
from trackslip.drives.poses import changing, measured_poses
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.logs.checks import unwrapped
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.motion.steady import STANDING

FEW: Final = 5  # number of rows or windows that may occur by chance
# most encoder intervals in total, to limit memory; surplus intervals are merged
_MAX_ROWS: Final = 200_000


def drives_of(logs: Sequence[RunLog]) -> tuple[list[Drive], list[Refused]]:
    """Prepare the usable drives and list the refused logs; raises LogError if no drive is
    usable.
    """
    drives, refused, names = [], list[Refused](), dict[bytes, str]()
    rows = max(sum(len(log.time) for log in logs), _MAX_ROWS)
    for log in logs:
        try:
            drive = drive_of(log, len(log.time) * _MAX_ROWS // rows)
            if (
                twin := names.setdefault(drive.omega.tobytes() + drive.pose.tobytes(), log.run)
            ) != log.run:
                raise LogError(f"run {log.run!r}: a copy of run {twin!r}")
            drives.append(drive)
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if not drives:
        raise LogError(none_usable(refused) if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, max_rows: int = _MAX_ROWS) -> Drive:
    """Prepare the drive in a log; raises LogError for a robot at rest or too few poses."""
    if not log.is_valid.any() and log.gyro is not None and log.beyond is None:
        log = replace(log, pose=_turned_by(log.gyro, log), valid=None, gyro=None)
    valid = np.flatnonzero(log.is_valid)
    rows = valid[changing(log, valid)]
    if len(rows) < 2 and (log.beyond is None or len(log.beyond) < 2):
        raise LogError(
            f"run {log.run!r}: {counted(len(rows), 'pose')} while it drives, needs at least 2"
        )
    if not np.abs(log.omega[1:]).max() > STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    headed = np.isfinite(log.pose[rows, 2]).any()
    zero = (np.nan_to_num(log.pose[rows]) == 0).all(axis=1)
    _refuse_zeros(log.run, "x, y and phi" if headed else "x and y", zero, "pose was measured")
    time, pose = measured_poses(log.time[rows], log.pose[rows])
    measured = len(time)
    usual = float(
        np.median(np.diff(time if len(time) > 1 or log.beyond is None else log.beyond[:, 0]))
    )
    every = slice(None, None, max(1, int(0.05 / usual + 0.1)))  # paths hardly bend within 0.05 s
    time, pose = time[every], pose[every].copy()
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = unwrapped(pose[headed, 2])
    ticks = counts_few_ticks(log.time, log.omega)
    means = interval_means(log.time, log.omega, ticks)
    _refuse_zeros(log.run, "omega_l and omega_r", (means == 0).all(axis=1), "encoder was read")
    edges, omega = merged(log.time, means, max_rows)
    interval = float(np.median(np.diff(time))) if len(time) > 1 else usual
    command = (
        None
        if log.command is None or np.ptp(log.command, axis=0).any()
        else tuple(log.command[0].tolist())
    )
    gyro = None if log.gyro_sums is None else np.column_stack([log.time, log.gyro_sums])
    return Drive(
        log.run,
        edges,
        omega,
        time,
        pose,
        interval,
        gyro,
        command,
        beyond=log.beyond,
        repeated=len(valid) - len(rows),
        interpolated=len(rows) - measured,
        held=bool((means != log.omega[1:]).any()) and not ticks,
        whole=bool((log.omega == log.omega.round()).all()),
    )


def _turned_by(gyro: Array, log: RunLog) -> Array:
    """Poses (T, 3) with headings from a gyro (T,) [rad/s] and NaN positions; the bias comes from
    sprocket turns.
    """
    columns = np.column_stack([log.omega @ [-1, 1], np.ones(len(log.time))])
    read = np.isfinite(gyro)
    fit = np.linalg.lstsq(columns[read], gyro[read])[0]
    rate = np.where(read, gyro - fit[1], columns[:, 0] * fit[0])
    heading = np.append(0.0, np.cumsum(rate[1:] * np.diff(log.time)))
    return np.column_stack([np.full((len(heading), 2), np.nan), heading])


def _refuse_zeros(run: str, columns: str, zero: np.ndarray, measured: str) -> None:
    """Refuse columns that repeatedly drop to 0 for a single row; `zero` (n,) is true where the
    columns are 0.
    """
    alone = int(((zero[1:-1] != zero[:-2]) & (zero[1:-1] != zero[2:])).sum())
    if alone > max(FEW, 0.1 * len(zero)):
        raise LogError(
            f"run {run!r}: columns {columns} go to 0 and back {alone:,} times: leave cells empty "
            f"where no {measured}"
        )
