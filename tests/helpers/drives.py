"""Simulated logs of drives with known laws and errors."""

from dataclasses import replace

import numpy as np
from law_motion import STILL as STILL
from law_motion import WHITE, LawMotion, SlipVariation, driven_by_law

from sim.wander.motion import Driver, joined_log, track_commands
from sim.wander.pose_sensor import PoseSensor
from trackslip.drives.conditioning import drives_of
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.law_fit import DriveFit, fit_drives
from trackslip.identification.path import DriveModel
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
ICR = ConstantIcr(0.045, 0.168, 0.0066)
SLAM = PoseSensor(rate=10.0, position_noise=0.02, heading_noise=np.radians(1.0))
EXACT = PoseSensor(rate=10.0)
_ENCODERS = 50.0  # [Hz]


def drive_log(
    seed: int,
    duration: float = 60.0,
    source: PoseSensor = SLAM,
    variation: SlipVariation = WHITE,
    law: SlipLaw = ICR,
    driving: str | Array = "random",
    **motion: float,
) -> RunLog:
    """A log of `duration` [s]; `driving` is a name or track speeds (T, 2) [m/s] at 50 Hz, `motion`
    is of LawMotion.
    """
    rng = np.random.default_rng(seed)
    if isinstance(driving, str):
        speeds = track_commands(driving, duration, _ENCODERS, Driver(), rng)
    else:
        speeds = driving
    omega = speeds / GEOMETRY.sprocket_radius
    moves = LawMotion(law, GEOMETRY, variation, **motion)
    log, true = driven_by_law(f"drive {seed}", moves, omega, _ENCODERS, rng)
    return joined_log(log, *source.measure(true, rng))


def constant_speeds(left: float, right: float, duration: float = 30.0) -> Array:
    """Track speeds (T, 2) [m/s] at 50 Hz that don't change, after a start from rest."""
    time = np.arange(int(duration * _ENCODERS) + 1) / _ENCODERS
    ramp = np.minimum(time, 1.0)
    return ramp[:, None] * np.array([left, right])


def without_poses(log: RunLog, rows: np.ndarray) -> RunLog:
    pose = np.where(rows[:, None], np.nan, log.pose)
    return replace(log, valid=log.is_valid & ~rows, pose=pose)


def model(name: str = REFERENCE) -> DriveModel:
    return DriveModel(FAMILIES[name], GEOMETRY)


def fitted(name: str, *logs: RunLog, **options) -> DriveFit:
    drives, _ = drives_of(logs)
    return fit_drives(name, drives, GEOMETRY, **options)
