"""True motion of a drive: poses over time by a slip law, with random slip; and logs of encoder readings and poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from trackslip import se2
from trackslip.errors import Checked, checked, require_finite, require_non_negative, require_positive
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.logs.runlog import RunLog, Truth

_STEP = 0.005  # longest step of integration [s]


@dataclass(frozen=True)
class Motion:
    """True poses over time."""

    time: Array  # (F,) [s], ascending
    pose: Array  # (F, 3) [m, m, rad], phi unwrapped

    def at(self, time: Array) -> Array:
        """Poses (..., 3) at times (...) within the motion, on an arc of constant twist between neighbouring rows."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        share = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        motion = se2.log(se2.between(self.pose[k], self.pose[k + 1]))
        return se2.compose(self.pose[k], se2.exp(share[..., None] * motion))


@dataclass(frozen=True)
class SlipVariation(Checked):
    """Random departures of the motion from its slip law.

    White slip adds an independent error to each step, its variance growing with the distance driven: the mean of
    |V_l| and |V_r|, integrated. Slip that lasts is a relative error of each track's speed: an Ornstein-Uhlenbeck
    process.
    """

    along: float = checked(0.0, require_non_negative)
    """White slip forwards [m/sqrt(m)]."""
    across: float = checked(0.0, require_non_negative)
    """White slip sideways [m/sqrt(m)]."""
    turning: float = checked(0.0, require_non_negative)
    """White slip of the heading [rad/sqrt(m)]."""
    lasting: float = checked(0.0, require_non_negative)
    """Standard deviation of the slip that lasts [-]."""
    lasting_time: float = checked(3.0, require_positive)
    """Its correlation time [s]."""


WHITE = SlipVariation(along=0.002, across=0.002, turning=0.005)
"""White slip of the shipped robot on stone: 2 mm, 2 mm and 5 mrad per sqrt(m)."""
LASTING = SlipVariation(lasting=0.02)
"""Slip of 2 % that lasts 3 s."""


@dataclass(frozen=True)
class LawMotion(Checked):
    """A robot that moves by a slip law of its sprocket speeds."""

    law: SlipLaw
    geometry: RobotGeometry
    variation: SlipVariation = WHITE
    """Random part of the motion."""
    turning_centre: float = checked(0.0, require_finite)
    """x_icr: forward coordinate of the ICR; the lateral speed of the origin is -x_icr w [m]."""
    drift: float = checked(0.0, require_finite)
    """c: lateral speed outwards, -c v w [s]."""
    lag: float = checked(0.0, require_non_negative)
    """Time constant of the motion behind the belts [s]."""

    def drive(self, omega: Array, rate: float, rng: np.random.Generator) -> tuple[Motion, Array]:
        """The motion from the pose (0, 0, 0), and its twists (T, 3), at sprocket speeds `omega` (T, 2) [rad/s].

        Each speed holds for the period before its row, 1 / `rate` [s]; the first row is the start. The motion has rows
        at most 5 ms apart; the twists, forward, lateral and yaw [m/s, m/s, rad/s], are those at the rows of omega,
        without white slip.
        """
        substeps = max(1, int(np.ceil(1 / rate / _STEP - 1e-9)))
        step = 1 / rate / substeps
        speeds = np.repeat(omega[1:], substeps, axis=0)
        if self.variation.lasting > 0:
            speeds = speeds * (1 + self._lasting(len(speeds), step, rng))
        twist = np.zeros((len(speeds), 3))
        twist[:, ::2] = self._delayed(self.law.twist(speeds, self.geometry), step)
        twist[:, 1] = -(self.turning_centre + self.drift * twist[:, 0]) * twist[:, 2]
        steps = se2.exp(twist * step)
        way = self.geometry.sprocket_radius * np.abs(speeds).mean(axis=1, keepdims=True) * step
        white = np.array([self.variation.along, self.variation.across, self.variation.turning])
        if white.any():
            steps = steps + white * np.sqrt(way) * rng.standard_normal(steps.shape)
        time = np.arange(len(steps) + 1) * step
        at_rows = np.concatenate([np.zeros((1, 3)), twist[substeps - 1 :: substeps]])
        return Motion(time, se2.chain(np.zeros(3), steps)), at_rows

    def _lasting(self, count: int, step: float, rng: np.random.Generator) -> Array:
        """Relative errors (count, 2) of the tracks' speeds, stationary from the start [-]."""
        keep = np.exp(-step / self.variation.lasting_time)
        shocks = rng.standard_normal((count, 2)) * np.sqrt(1 - keep**2)
        shocks[0] /= np.sqrt(1 - keep**2)
        return self.variation.lasting * scipy.signal.lfilter([1.0], [1.0, -keep], shocks, axis=0)

    def _delayed(self, twist: Array, step: float) -> Array:
        """Twists (F, 2), means over each step, that lag behind the belts; the robot starts at rest."""
        if self.lag == 0:
            return twist
        keep = np.exp(-step / self.lag)
        mean = (1 - keep) * self.lag / step  # of the decay over a step
        missing = scipy.signal.lfilter([1.0], [1.0, -keep], np.diff(twist, axis=0, prepend=0.0), axis=0)
        return twist - mean * missing


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
