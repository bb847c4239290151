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


STILL = SlipVariation()
WHITE = SlipVariation(along=0.002, across=0.002, turning=0.005)


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

        # slip that lasts: a first-order process, stationary from the start
        if self.variation.lasting > 0:
            keep = np.exp(-step / self.variation.lasting_time)
            scale = np.sqrt(1 - keep**2)
            shocks = rng.standard_normal(speeds.shape) * scale
            shocks[0] /= scale
            lasting = scipy.signal.lfilter([1.0], [1.0, -keep], shocks, axis=0)
            speeds = speeds * (1 + self.variation.lasting * lasting)

        twist = np.zeros((len(speeds), 3))
        twist[:, ::2] = self._delayed(self.law.twist(speeds, self.geometry), step)
        sideways = self.turning_centre + self.drift * twist[:, 0]
        twist[:, 1] = -sideways * twist[:, 2]

        # white slip: its variance grows with the distance that the tracks run
        mean_speed = np.abs(speeds).mean(axis=1, keepdims=True)
        distance = self.geometry.sprocket_radius * mean_speed * step
        white = np.array([self.variation.along, self.variation.across, self.variation.turning])
        steps = se2.exp(twist * step)
        if white.any():
            steps = steps + white * np.sqrt(distance) * rng.standard_normal(steps.shape)

        time = np.arange(len(steps) + 1) * step
        motion = Motion(time, se2.chain(np.zeros(3), steps))
        at_rows = np.concatenate([np.zeros((1, 3)), twist[substeps - 1 :: substeps]])
        return motion, at_rows

    def _delayed(self, twist: Array, step: float) -> Array:
        """Means (F, 2) over each step of twists that lag behind those of the belts; the robot
        starts at rest.
        """
        if self.lag == 0:
            return twist
        keep = np.exp(-step / self.lag)
        changes = np.diff(twist, axis=0, prepend=0.0)
        missing = scipy.signal.lfilter([1.0], [1.0, -keep], changes, axis=0)
        mean_over_step = (1 - keep) * self.lag / step
        return twist - mean_over_step * missing


def driven_by_law(
    name, law, omega, rate, rng, start=(0.0, 0.0, 0.0), counts=None
) -> tuple[RunLog, Motion]:
    """The log and motion of a LawMotion from `start`; encoders read `omega` (T, 2), or so many
    counts a revolution.
    """
    moved, twist = law.drive(omega, rate, rng)
    motion = Motion(moved.time, se2.compose(np.array(start), moved.pose))
    time = np.arange(len(omega)) / rate
    command = np.concatenate([omega[1:], omega[-1:]])
    pose = motion.at(time)
    if counts is not None:
        count = 2 * np.pi / counts  # [rad]
        turned = np.cumsum(omega[1:] / rate, axis=0)
        angle = np.concatenate([np.zeros((1, 2)), turned])
        counted = np.floor(angle / count) * count
        omega = np.concatenate([omega[:1], np.diff(counted, axis=0) * rate])
    return RunLog(name, time, omega, pose, command, truth=Truth(pose, twist)), motion
