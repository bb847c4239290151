"""Pose sensors with realistic errors: noise, clock errors, jumps, gaps and mounting errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.fleet.fleet import Fleet
from sim.robot.robot import Robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner, require_share
from sim.wander.motion import Motion
from trackslip import se2
from trackslip.errors import Checked, checked, require, require_positive, require_within
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan

_MAX_JITTER = 0.2  # largest standard deviation of stamp errors [periods]
_MOST_EARLY = 0.45  # largest stamp error, which keeps stamps in order [periods]
_AT_ONCE = 250  # number of scans simulated together, each for a separate robot
_LARGEST = 1e6  # largest error, in any unit; a log with larger errors couldn't be read again
_LONGEST_DELAY = 3600.0  # [s]
_WRONG = 0.5  # largest error of an outlier in x and y [m] and in heading [rad]


@dataclass(frozen=True)
class PoseSensor(Checked):
    """A pose sensor with its errors."""

    rate: float = checked(20.0, require_positive)
    """Number of poses per second [Hz]."""
    position_noise: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Standard deviation of the noise in x and in y [m]."""
    heading_noise: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Standard deviation of the noise in the heading [rad]."""
    heading: bool = True
    """Whether the sensor measures headings, too."""
    delay: float = checked(0.0, require_within, -_LONGEST_DELAY, _LONGEST_DELAY, "s")
    """Delay of pose stamps relative to encoder stamps at the same instant, -tau [s]."""
    jitter: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Standard deviation of the errors in pose stamps [s]."""
    outliers: float = checked(0.0, require_share)
    """Share of poses with errors of up to 0.5 m in x and y and 0.5 rad [-]."""
    gaps: int = checked(0, require_within, 0.0, _LARGEST)
    """Number of gaps without poses."""
    gap_duration: float = checked(5.0, require_within, 0.0, _LARGEST)
    """Duration of each gap [s]."""
    jumps: int = checked(0, require_within, 0.0, _LARGEST)
    """Number of lasting jumps, each of which displaces all later poses and turns them about the
    point of the jump.
    """
    jump_size: float = checked(0.2, require_within, 0.0, _LARGEST)
    """Distance of each jump [m]."""
    jump_turn: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Angle by which each jump turns later poses, to a random side [rad]."""
    drift: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Position drift as in odometry, a random walk: final position error over the distance
    travelled [-].
    """
    heading_drift: float = checked(0.0, require_within, 0.0, _LARGEST)
    """Heading drift as in odometry, a random walk [rad/sqrt(m)]."""
    ahead: float = checked(0.0, require_within, -_LARGEST, _LARGEST)
    """Position of the sensor ahead of the robot's origin [m]."""
    left: float = checked(0.0, require_within, -_LARGEST, _LARGEST)
    """Position of the sensor to the left of the robot's origin [m]."""
    mounting: float = checked(0.0, require_within, -_LARGEST, _LARGEST)
    """Heading of the sensor relative to the robot's, counter-clockwise [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = _MAX_JITTER / self.rate
        require(
            self.jitter <= most,
            "jitter",
            self.jitter,
            f"at most {most:g} s, {_MAX_JITTER:g} of a period",
        )

    def measure(self, motion: Motion, rng: np.random.Generator) -> tuple[Array, Array]:
        """Ascending time stamps (M,) [s] and poses (M, 3) [m, m, rad]; headings are NaN unless they
        are measured.

        The first pose is measured at a random time in the first period.
        """
        first, last = motion.time[0], motion.time[-1]
        moment = np.arange(first + rng.uniform(0, 1 / self.rate), last, 1 / self.rate)
        sensor = np.array([self.ahead, self.left, self.mounting])
        pose = self._wandered(se2.compose(motion.at(moment), sensor), moment, rng)
        noise = np.array([self.position_noise, self.position_noise, self.heading_noise])
        pose = pose + noise * rng.standard_normal(pose.shape)
        wrong = rng.random(len(moment)) < self.outliers
        pose = pose + wrong[:, None] * _WRONG * rng.uniform(-1, 1, pose.shape)
        early = np.clip(
            self.jitter * rng.standard_normal(len(moment)),
            *(np.array([-1, 1]) * _MOST_EARLY / self.rate),
        )
        seen = ~self._in_gap(moment, rng)
        if not self.heading:
            pose[:, 2] = np.nan
        return (moment + self.delay + early)[seen], pose[seen]

    def _wandered(self, pose: Array, moment: Array, rng: np.random.Generator) -> Array:
        """Poses (M, 3) with drift and lasting jumps, which are errors in the steps between
        poses.
        """
        if len(pose) < 2 or not (self.drift or self.heading_drift or self.jumps):
            return pose
        steps = se2.steps(pose)
        way = np.hypot(steps[:, :1], steps[:, 1:2])
        along = self.drift * np.sqrt(way.sum() / 2)  # for each of two directions [m/sqrt(m)]
        walk = np.sqrt(way) * [along, along, self.heading_drift] * rng.standard_normal(steps.shape)
        steps = steps + walk
        at = np.searchsorted(moment, rng.uniform(moment[0], moment[-1], self.jumps))
        direction = rng.uniform(-np.pi, np.pi, self.jumps)
        turned = self.jump_turn * rng.choice([-1.0, 1.0], self.jumps)
        jump = np.column_stack([self.jump_size * se2.direction(direction), turned])
        np.add.at(steps, np.clip(at - 1, 0, len(steps) - 1), jump)
        return se2.chain(pose[0], steps)

    def _in_gap(self, moment: Array, rng: np.random.Generator) -> np.ndarray:
        """Mask (M,) of the times in a gap; there is one gap in each of several equal parts of the
        duration.
        """
        if not self.gaps:
            return np.zeros(len(moment), bool)
        part = (moment[-1] - moment[0]) / self.gaps
        free = max(0.0, part - self.gap_duration)
        begin = moment[0] + part * np.arange(self.gaps) + rng.uniform(0, free, self.gaps)
        return ((moment[:, None] >= begin) & (moment[:, None] < begin + self.gap_duration)).any(
            axis=1
        )


POSE_SENSORS: Mapping[str, PoseSensor] = {
    "scanner": PoseSensor(rate=20.0, position_noise=0.002, heading_noise=np.radians(0.25)),
    "mocap": PoseSensor(
        rate=50.0, position_noise=0.0005, heading_noise=np.radians(0.1), delay=0.02
    ),
    "slam": PoseSensor(
        rate=10.0, position_noise=0.02, heading_noise=np.radians(1.0), delay=0.1, jitter=0.005
    ),
    "gnss": PoseSensor(rate=5.0, position_noise=0.05, heading=False, delay=0.1),
    "odometry": PoseSensor(rate=20.0, drift=0.01, heading_drift=0.004),
}
"""Pose sensors by name: scanner in the field, motion capture, SLAM, GNSS (positions only), drifting
odometry.
"""


def plate_scans(
    scanner: LaserScanner, robot: Robot, motion: Motion, rng: np.random.Generator
) -> tuple[Array, Scan]:
    """Times (S,) [s] and scans (S, B) of a robot's plate in an empty field, from a stationary
    scanner.

    The first scan is at a random time in the first period.
    """
    time = np.arange(
        motion.time[0] + rng.uniform(0, scanner.period), motion.time[-1], scanner.period
    )
    pose, parts = motion.at(time), []
    for k in range(0, len(pose), _AT_ONCE):
        standing = Fleet(robot, pose[k : k + _AT_ONCE])
        true = ScannerFeed(scanner, standing).true_ranges()
        parts.append(scanner.measure(true[None], [rng])[0].astype(np.float32))
    return time, scanner.scan(np.concatenate(parts), robot.lrf_mount)
