"""Logs of robots with a known law, as tables that people write, without a simulator; first looks at
them and laws.

The law of `Robot` is exact: v_side = v -/+ (half_gauge + offset) w = radius (1 + radius_error +/-
unequal) omega.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pyarrow as pa

from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.drives.first_look import Look, first_look
from trackslip.identification.drive_comparison import compare_drives
from trackslip.identification.result import Identification
from trackslip.intervals import Gain
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import runs_from_table

GEOMETRY = RobotGeometry(0.168, 0.06)
LAW = ConstantIcr(0.045, GEOMETRY.half_gauge, 0.006)
ENCODER_STEP = 0.02
"""Time between rows with encoders [s]."""
_SETTLING = 0.4  # time constant with which the robot takes up new speeds [s]


@dataclass(frozen=True)
class Robot:
    half_gauge: float = 0.285
    radius: float = 0.165
    offset: float = 0.2
    radius_error: float = -0.03
    unequal: float = 0.0

    @property
    def geometry(self) -> RobotGeometry:
        return RobotGeometry(self.half_gauge, self.radius)

    @property
    def turn_gain(self) -> float:
        return self.half_gauge * (1 + self.radius_error) / (self.half_gauge + self.offset)


HUSKY = Robot()


@dataclass(frozen=True)
class Drive:
    """Motion of a robot at rows ENCODER_STEP apart."""

    time: Array  # (T,) [s]
    omega: Array  # (T, 2) mean speeds of the wheels since the row before [rad/s]
    pose: Array  # (T, 3) true [m, m, rad]

    def with_wheels(self, omega: Array) -> Self:
        return replace(self, omega=omega)


def drive_of(
    robot: Robot = HUSKY,
    duration: float = 120.0,
    seed: int = 0,
    speed: float = 0.8,
    yaw_rate: float = 0.8,
    commands: tuple[Array, Array] | None = None,
    hold: float = 4.0,
    slip: float = 0.0,
    law: SlipLaw | None = None,
) -> Drive:
    """A drive by commands (n,) of v [m/s] and w [rad/s], each held for some time [s]; random ones
    if not given.

    `slip` is the relative standard deviation of speed and yaw rate from what the law says, new
    every second. By another `law`, the same wheels move the robot otherwise.
    """
    rng = np.random.default_rng(seed)
    count = int(duration / hold) + 1
    if commands is None:
        v = rng.uniform(-0.4, 1.0, count) * speed
        w = rng.uniform(-1.0, 1.0, count) * yaw_rate
        v[rng.random(count) < 0.2] = 0.0  # turns on the spot
        commands = v, w
    time = ENCODER_STEP * np.arange(round(duration / ENCODER_STEP) + 1)
    command = np.minimum((time / hold).astype(int), len(commands[0]) - 1)  # of each row
    wanted = np.stack(commands)[:, command]
    v, w = _late(wanted, ENCODER_STEP / _SETTLING)
    omega = _wheels(robot, v, w)
    if law is not None:
        v, w = law.twist(omega, robot.geometry).T
    if slip:
        every = np.arange(0.0, duration + 2.0)

        def slipped(values: Array) -> Array:
            deviation = np.interp(time, every, rng.normal(size=len(every)))
            return (1 + slip * deviation) * values

        v = slipped(v)
        w = slipped(w)
    return Drive(time, omega, _path(v, w))


def _wheels(robot: Robot, v: Array | float, w: Array) -> Array:
    """Speeds (T, 2) of the wheels at which the law gives these speeds and yaw rates [rad/s]."""
    half_width = robot.half_gauge + robot.offset
    belts = np.column_stack([v - half_width * w, v + half_width * w])
    radius = robot.radius * (1 + robot.radius_error + np.array([1, -1]) * robot.unequal)
    return belts / radius


def weaving(
    robot: Robot = HUSKY, duration: float = 120.0, speed: float = 0.6, seed: int = 0
) -> Drive:
    """A drive at one speed whose yaw rate follows the wheels late, and which something turns now
    and then.
    """
    rng = np.random.default_rng(seed)
    time = ENCODER_STEP * np.arange(round(duration / ENCODER_STEP) + 1)
    turns = rng.uniform(-0.6, 0.6, int(duration / 3) + 1)
    w = turns[(time / 3).astype(int)]
    omega = _wheels(robot, speed, w)
    turning = _late(w, ENCODER_STEP / 0.3)
    every = np.arange(0.0, duration + 4.0, 2.0)
    pushes = rng.normal(size=len(every))
    turning += 0.05 * np.interp(time, every, pushes)
    return Drive(time, omega, _path(np.full(len(time), speed), turning))


def _late(wanted: Array, share: float) -> Array:
    """Values (..., T) that follow those wanted from 0, by a share of the rest in each step."""
    values = np.zeros_like(wanted)
    for k in range(1, wanted.shape[-1]):
        values[..., k] = values[..., k - 1] + share * (wanted[..., k] - values[..., k - 1])
    return values


def _path(v: Array, w: Array) -> Array:
    """Poses (T, 3) from the origin at speeds (T,) [m/s] and yaw rates (T,) [rad/s], each of the
    step before it.
    """
    heading = np.append(0.0, np.cumsum(w[1:] * ENCODER_STEP))
    mean_heading = 0.5j * (heading[1:] + heading[:-1])
    steps = v[1:] * ENCODER_STEP * np.exp(mean_heading)  # x + iy
    place = np.append(0.0, np.cumsum(steps))
    return np.column_stack([place.real, place.imag, heading])


def measured(
    drive: Drive,
    pose_step: float = 0.1,
    position_noise: float = 0.005,
    heading_noise: float = 0.005,
    seed: int = 1,
) -> tuple[Array, Array]:
    """Times (K,) and poses (K, 3) as a tracker measures them."""
    rows = slice(None, None, round(pose_step / ENCODER_STEP))
    pose = drive.pose[rows]
    noise = np.random.default_rng(seed).normal(size=pose.shape)
    return drive.time[rows], pose + noise * [position_noise, position_noise, heading_noise]


def table_of(drive: Drive, time: Array, pose: Array, run: str = "a") -> pa.Table:
    """Encoders and poses as rows of one table sorted by time; cells are empty where nothing was
    measured.
    """
    every = np.union1d(drive.time, time)
    columns = np.full((len(every), 5), np.nan)
    columns[np.searchsorted(every, drive.time), :2] = drive.omega
    columns[np.searchsorted(every, time), 2:] = pose
    names = ("omega_l", "omega_r", "x", "y", "phi")
    cells = {}
    for name, values in zip(names, columns.T, strict=True):
        cells[name] = pa.array(values, from_pandas=True)
    return pa.table({"run": [run] * len(every), "t": every} | cells)


def log_of(drive: Drive, time: Array, pose: Array, run: str = "a") -> RunLog:
    (log,) = runs_from_table(table_of(drive, time, pose, run), "a table").runs
    return log


def wandered(*, name="drive", duration=30.0, headings=True, outliers=0, seed=0):
    """A log at 20 Hz with poses at 10 Hz, whose noise is 5 mm and 15 mrad."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.05)
    at = time[:, None] + rng.uniform(0, 10, 2)
    slow = at[:, 0]
    fast = at[:, 1]
    v = 0.12 + 0.08 * np.sin(0.9 * slow)
    w = 0.5 * (np.sin(2.3 * fast) + 0.6 * np.sin(0.7 * slow))
    twist = np.column_stack([v, w])
    omega = LAW.sprocket_speeds(twist, GEOMETRY)
    motion = np.insert(twist[1:] * 0.05, 1, 0.0, axis=1)
    pose = se2.chain(np.zeros(3), se2.exp(motion))
    pose += [0.005, 0.005, 0.015] * rng.standard_normal(pose.shape)
    pose[10 : 10 + 20 * outliers : 20, :2] += 0.5
    if not headings:
        pose[:, 2] = np.nan
    valid = np.arange(len(time)) % 2 == 0
    return RunLog(name, time, omega, pose, valid=valid)


def identified_from(*logs, names=("none", "icr", "icr_radius")) -> Identification:
    drives, _ = drives_of(logs)
    found = compare_drives(first_look(drives, GEOMETRY), GEOMETRY, names=names)
    return Identification(GEOMETRY, "drive", None, found, (), found.warnings, logs)


DRIVE = drive_of()
TIME, POSE = measured(DRIVE)
KINDS = {"poses": [], "positions": [2], "headings": [0, 1]}
"""Columns of poses that are missing."""


def look(*logs: RunLog, robot: Robot = HUSKY) -> Look:
    drives, refused = drives_of(logs)
    assert not refused
    return first_look(drives, robot.geometry)


def look_at(
    drive: Drive = DRIVE, time: Array = TIME, pose: Array = POSE, robot: Robot = HUSKY
) -> Look:
    return look(log_of(drive, time, pose), robot=robot)


def without(pose: Array, kind: str) -> Array:
    pose = pose.copy()
    pose[:, KINDS[kind]] = np.nan
    return pose


def holds(gain: Gain, truth: float) -> bool:
    """True if the 99.7 % interval of a gain, one and a half times its own, holds the truth."""
    return abs(gain.value - truth) <= 1.5 * gain.error
