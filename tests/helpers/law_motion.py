"""Robots that move exactly by a slip law, but for slip that varies at random, and their logs."""

from dataclasses import dataclass

import numpy as np
import scipy

from sim.wander.motion import Motion
from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.logs.runlog import RunLog, Truth

_STEP = 0.005  # longest step of integration [s]


@dataclass(frozen=True)
class SlipVariation:
    """White slip forwards, sideways [m/sqrt(m)] and of the heading [rad/sqrt(m)], over the mean of
    the tracks' ways; and the standard deviation [-] and correlation time [s] of slip that lasts,
    relative to each track's speed.
    """

    along: float = 0.0
    across: float = 0.0
    turning: float = 0.0
    lasting: float = 0.0
    lasting_time: float = 3.0


STILL, WHITE = SlipVariation(), SlipVariation(along=0.002, across=0.002, turning=0.005)


@dataclass(frozen=True)
class LawMotion:
    """A robot whose turning centre is ahead of its origin [m], and which drifts outwards by c v w
    and lags [s].
    """

    law: SlipLaw
    geometry: RobotGeometry
    variation: SlipVariation = WHITE
    turning_centre: float = 0.0
    drift: float = 0.0
    lag: float = 0.0

    def drive(self, omega: Array, rate: float, rng: np.random.Generator) -> tuple[Motion, Array]:
        """The motion from the origin at sprocket speeds `omega` (T, 2) [rad/s], each that of the
        period 1 / `rate` [s] before its row; and twists (T, 3) at these rows, without white slip.
        """
        substeps = max(1, int(np.ceil(1 / rate / _STEP - 1e-9)))
        step = 1 / rate / substeps
        speeds = np.repeat(omega[1:], substeps, axis=0)
        if self.variation.lasting > 0:
            keep = np.exp(-step / self.variation.lasting_time)
            shocks = rng.standard_normal(speeds.shape) * np.sqrt(1 - keep**2)
            shocks[0] /= np.sqrt(1 - keep**2)  # stationary from the start
            lasting = scipy.signal.lfilter([1.0], [1.0, -keep], shocks, axis=0)
            speeds = speeds * (1 + self.variation.lasting * lasting)
        twist = np.zeros((len(speeds), 3))
        twist[:, ::2] = self._delayed(self.law.twist(speeds, self.geometry), step)
        twist[:, 1] = -(self.turning_centre + self.drift * twist[:, 0]) * twist[:, 2]
        way = self.geometry.sprocket_radius * np.abs(speeds).mean(axis=1, keepdims=True) * step
        white = np.array([self.variation.along, self.variation.across, self.variation.turning])
        steps = se2.exp(twist * step)
        if white.any():
            steps = steps + white * np.sqrt(way) * rng.standard_normal(steps.shape)
        at_rows = np.concatenate([np.zeros((1, 3)), twist[substeps - 1 :: substeps]])
        return Motion(np.arange(len(steps) + 1) * step, se2.chain(np.zeros(3), steps)), at_rows

    def _delayed(self, twist: Array, step: float) -> Array:
        """Means (F, 2) over each step of twists that lag behind those of the belts; the robot
        starts at rest.
        """
        if self.lag == 0:
            return twist
        keep = np.exp(-step / self.lag)
        missing = scipy.signal.lfilter(
            [1.0], [1.0, -keep], np.diff(twist, axis=0, prepend=0.0), axis=0
        )
        return twist - (1 - keep) * self.lag / step * missing


def driven_by_law(
    name, law, omega, rate, rng, start=(0.0, 0.0, 0.0), counts=None
) -> tuple[RunLog, Motion]:
    """The log and motion of a LawMotion from `start`; encoders read `omega` (T, 2), or so many
    counts a revolution.
    """
    moved, twist = law.drive(omega, rate, rng)
    motion = Motion(moved.time, se2.compose(np.array(start), moved.pose))
    time, command = np.arange(len(omega)) / rate, np.concatenate([omega[1:], omega[-1:]])
    pose = motion.at(time)
    if counts is not None:
        count, turned = 2 * np.pi / counts, np.cumsum(omega[1:] / rate, axis=0)
        angle = np.floor(np.concatenate([np.zeros((1, 2)), turned]) / count) * count
        omega = np.concatenate([omega[:1], np.diff(angle, axis=0) * rate])
    return RunLog(name, time, omega, pose, command, truth=Truth(pose, twist)), motion
