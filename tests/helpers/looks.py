"""First looks at plain drives."""

from __future__ import annotations

import numpy as np
from plain_drives import HUSKY, Drive, Robot, drive_of, log_of, measured

from trackslip.identification.first_look import Look, first_look
from trackslip.identification.fitted import Gain
from trackslip.identification.preparation import drives_of
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

DRIVE = drive_of()
TIME, POSE = measured(DRIVE)
KINDS = {"poses": [], "positions": [2], "headings": [0, 1]}
"""Columns of poses that are missing."""


def look(*logs: RunLog, robot: Robot = HUSKY) -> Look:
    """The look at logs."""
    drives, refused = drives_of(logs)
    assert not refused
    return first_look(drives, robot.geometry)


def look_at(drive: Drive = DRIVE, time: Array = TIME, pose: Array = POSE, robot: Robot = HUSKY) -> Look:
    """The look at encoders and poses."""
    return look(log_of(drive, time, pose), robot=robot)


def without(pose: Array, kind: str) -> Array:
    """Poses of a kind."""
    pose = pose.copy()
    pose[:, KINDS[kind]] = np.nan
    return pose


def holds(gain: Gain, truth: float) -> bool:
    """True if the 99.7 % interval of a gain, one and a half times its own, holds the truth."""
    return abs(gain.value - truth) <= 1.5 * gain.error
