"""Pose sensors with realistic errors: noise, clock errors, jumps, gaps and mounting errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

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

_MAX_JITTER: Final = 0.2  # largest standard deviation of stamp errors [periods]
_MAX_STAMP_ERROR: Final = 0.45  # keeps stamps in order [periods]
_SCANS_AT_ONCE: Final = 250  # number of scans simulated together, each for a separate robot
# largest error, in any unit; a log with larger errors couldn't be read again
_LARGEST: Final = 1e6
_LONGEST_DELAY: Final = 3600.0  # [s]
_OUTLIER: Final = 0.5  # largest error of an outlier in x and y [m] and in heading [rad]


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
        allowed = f"at most {most:g} s, {_MAX_JITTER:g} of a period"
        require(self.jitter <= most, "jitter", self.jitter, allowed)

    def measure(self, motion: Motion, rng: np.random.Generator) -> tuple[Array, Array]:
        """Ascending time stamps (M,) [s] and poses (M, 3) [m, m, rad]; headings are NaN unless they
        are measured.

        The first pose is measured at a random time in the first period.
        """
        period = 1 / self.rate
        first = motion.time[0] + rng.uniform(0, period)
        time = np.arange(first, motion.time[-1], period)
        mounting = np.array([self.ahead, self.left, self.mounting])
        exact = se2.compose(motion.at(time), mounting)

        pose = self._wandered(exact, time, rng)
        noise = np.array([self.position_noise, self.position_noise, self.heading_noise])
        pose = pose + noise * rng.standard_normal(pose.shape)
        is_outlier = rng.random(len(time)) < self.outliers
        pose = pose + is_outlier[:, None] * _OUTLIER * rng.uniform(-1, 1, pose.shape)

        largest = _MAX_STAMP_ERROR / self.rate
        stamp_error = np.clip(self.jitter * rng.standard_normal(len(time)), -largest, largest)
        is_seen = ~self._in_gap(time, rng)
        if not self.heading:
            pose[:, 2] = np.nan
        return (time + self.delay + stamp_error)[is_seen], pose[is_seen]

    def _wandered(self, pose: Array, time: Array, rng: np.random.Generator) -> Array:
        """Poses (M, 3) at times (M,) with drift and lasting jumps, which are errors in the steps
        between poses.

        The error of a random walk grows with the root of the distance. Its size in each of two
        directions is chosen so that the final error is `drift` times the distance.
        """
        if len(pose) < 2 or not (self.drift or self.heading_drift or self.jumps):
            return pose
        steps = se2.steps(pose)
        distance = np.hypot(steps[:, :1], steps[:, 1:2])
        position_drift = self.drift * np.sqrt(distance.sum() / 2)  # [m/sqrt(m)]
        drift = [position_drift, position_drift, self.heading_drift]
        steps = steps + np.sqrt(distance) * drift * rng.standard_normal(steps.shape)

        at = np.searchsorted(time, rng.uniform(time[0], time[-1], self.jumps))
        direction = rng.uniform(-np.pi, np.pi, self.jumps)
        side = rng.choice([-1.0, 1.0], self.jumps)
        moved = self.jump_size * se2.direction(direction)
        jump = np.column_stack([moved, self.jump_turn * side])
        np.add.at(steps, np.clip(at - 1, 0, len(steps) - 1), jump)
        return se2.chain(pose[0], steps)

    def _in_gap(self, time: Array, rng: np.random.Generator) -> np.ndarray:
        """Mask (M,) of the times in a gap; there is one gap in each of several equal parts of the
        duration.
        """
        if not self.gaps:
            return np.zeros(len(time), bool)
        part = (time[-1] - time[0]) / self.gaps
        free = max(0.0, part - self.gap_duration)
        begin = time[0] + part * np.arange(self.gaps) + rng.uniform(0, free, self.gaps)
        end = begin + self.gap_duration
        is_in = (time[:, None] >= begin) & (time[:, None] < end)
        return np.asarray(is_in.any(axis=1))


POSE_SENSORS: Final[Mapping[str, PoseSensor]] = {
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
    first = motion.time[0] + rng.uniform(0, scanner.period)
    time = np.arange(first, motion.time[-1], scanner.period)
    pose = motion.at(time)
    parts = []
    for k in range(0, len(pose), _SCANS_AT_ONCE):
        standing = Fleet(robot, pose[k : k + _SCANS_AT_ONCE])
        true_ranges = ScannerFeed(scanner, standing).true_ranges()
        ranges = scanner.measure(true_ranges[None], [rng])[0]
        parts.append(ranges.astype(np.float32))
    return time, scanner.scan(np.concatenate(parts), robot.lrf_mount)
