"""Short drives by a known law, and identifications from them."""

from __future__ import annotations

import numpy as np

from trackslip import se2
from trackslip.identification.drive_comparison import DriveComparison, compare_drives
from trackslip.identification.first_look import first_look
from trackslip.identification.preparation import drives_of
from trackslip.identification.result import Identification
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
LAWS = ("none", "icr", "icr_radius")
LAW = ConstantIcr(0.045, GEOMETRY.half_gauge, 0.006)


def wandered(*, name="drive", duration=30.0, noise=0.005, headings=True, outliers=0, straight=False, seed=0):
    """A log at 20 Hz with poses at 10 Hz, whose noise is `noise` [m] and three times as much in heading [rad]."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.05)
    at = time[:, None] + rng.uniform(0, 10, 2)
    sway = 0.0 if straight else np.sin(2.3 * at[:, 1]) + 0.6 * np.sin(0.7 * at[:, 0])
    twist = np.column_stack([0.12 + 0.08 * np.sin(0.9 * at[:, 0]), 0.5 * sway * np.ones(len(time))])
    omega = LAW.sprocket_speeds(twist, GEOMETRY)
    motion = np.insert(twist[1:] * 0.05, 1, 0.0, axis=1)
    pose = se2.chain(np.zeros(3), se2.exp(motion))
    pose += noise * np.array([1.0, 1.0, 3.0]) * rng.standard_normal(pose.shape)
    pose[10 : 10 + 20 * outliers : 20, :2] += 0.5
    if not headings:
        pose[:, 2] = np.nan
    return RunLog(name, time, omega, pose, valid=np.arange(len(time)) % 2 == 0)


def compared(*logs, names=LAWS) -> DriveComparison:
    """Laws fitted to drives."""
    return compare_drives(first_look(drives_of(logs)[0], GEOMETRY), GEOMETRY, names=names)


def identified_from(*logs, names=LAWS) -> Identification:
    """An identification of laws fitted to drives."""
    found = compared(*logs, names=names)
    return Identification(GEOMETRY, "drive", None, found, (), found.warnings, logs)
