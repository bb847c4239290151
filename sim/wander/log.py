"""Logs of drives: encoder readings and poses on separate clocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sim.wander.motion import Motion
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog, Truth


def joined_log(encoders: RunLog, stamps: Array, poses: Array) -> RunLog:
    """Join encoder readings and poses (M, 3), stamped (M,) [s], into a log with a row for each.

    `encoders` has a row for each of their readings. A row that is only a pose's has the sprocket speeds of the next
    reading, which is the mean over the interval that contains it. Poses stamped before the first or after the last
    reading are left out. The truth is that of the robot at the encoders' time.
    """
    read = encoders.time
    within = (stamps >= read[0]) & (stamps <= read[-1])
    stamps, poses = stamps[within], poses[within]
    time = np.union1d(read, stamps)
    after = np.searchsorted(read, time)
    held = np.searchsorted(read, time, side="right") - 1
    pose = np.full((len(time), 3), np.nan)
    valid = np.zeros(len(time), bool)
    seen = np.searchsorted(time, stamps)
    pose[seen], valid[seen] = poses, True
    return RunLog(
        run=encoders.run,
        time=time,
        omega=encoders.omega[after],
        pose=pose,
        command=None if encoders.command is None else encoders.command[held],
        valid=valid,
        truth=None if encoders.truth is None else _truth_at(encoders.truth, read, time, after),
        metadata=encoders.metadata,
    )


def encoder_log(run: str, rate: float, omega: Array, motion: Motion, twist: Array, metadata: dict[str, Any]) -> RunLog:
    """Log of encoder readings: sprocket speeds `omega` (T, 2) [rad/s] at `rate` [Hz], with true poses.

    Each speed is commanded in the row before.
    """
    time = np.arange(len(omega)) / rate
    pose = motion.at(time)
    command = np.concatenate([omega[1:], omega[-1:]])
    return RunLog(run, time, omega, pose, command, truth=Truth(pose, twist), metadata=metadata)


def quantised(log: RunLog, counts: int) -> RunLog:
    """The log with sprocket angles rounded to whole encoder counts, `counts` per revolution."""
    count = 2 * np.pi / counts
    turned = log.omega[1:] * np.diff(log.time)[:, None]
    angle = np.floor(np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)]) / count) * count
    omega = np.concatenate([log.omega[:1], np.diff(angle, axis=0) / np.diff(log.time)[:, None]])
    return replace(log, omega=omega)


def _truth_at(truth: Truth, read: Array, time: Array, after: np.ndarray) -> Truth:
    """Interpolate the truth from times `read` (T,) to `time` (U,); `after` (U,) are the next rows of the former."""

    def between(values: Array) -> Array:
        flat = values.reshape(len(read), -1)
        return np.stack([np.interp(time, read, column) for column in flat.T], -1).reshape(-1, *values.shape[1:])

    smooth = {name: getattr(truth, name) for name in ("twist", "traction", "torque", "lean", "contact")}
    means = {name: getattr(truth, name) for name in ("power", "saturated")}
    return Truth(
        pose=Motion(read, truth.pose).at(time),
        **{name: between(values) for name, values in smooth.items() if values is not None},
        **{name: values[after] for name, values in means.items() if values is not None},
    )
