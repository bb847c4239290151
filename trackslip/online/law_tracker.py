"""Tracking of robots whose slip laws are known, which predict poses where scans show none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.pose_tracker import GROWTH, Tracker
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.online.compensation import Compensation

LAW_GROWTH: Final = 0.1
"""Error of dead reckoning by a law with known errors on another ground or robot than those it was
identified with, relative to the distance and turn since the last valid pose [-].
"""


class LawTracker(Tracker):
    """Tracker of N robots that drives on by the laws of their compensations where scans show no
    pose.

    From its last valid pose on, such a robot has the pose by its law, and the covariance of
    odometry by this law. Where the errors of the law are unknown, the covariance is that of the
    base class. With a valid pose in every scan, both classes do the same.
    """

    STATE = (*Tracker.STATE, "_blind", "_before")

    def __init__(
        self,
        start: Array,
        geometry: RobotGeometry,
        compensations: Sequence[tuple[Sequence[int], Compensation]],
    ) -> None:
        """Start from the known poses `start` (N, 3).

        Each of `compensations`, which have been reset, is that of some robots, given by their
        indices (R,); every robot has one.
        """
        super().__init__(start, geometry)
        self._parts = []
        for robots, compensation in compensations:
            rows = np.asarray(robots, int)
            part = _Part(rows, compensation, geometry, self._pose[rows])
            self._parts.append(part)
            self._growth[rows] = GROWTH if part.odometry is None else LAW_GROWTH
        # (N,) whether the last update had no valid pose
        self._blind = np.zeros(len(self._pose), bool)
        self._before = self._pose.copy()  # poses (N, 3) after the last update
        # sprocket speeds (N, 2) [rad/s] and durations [s] since the last update
        self._motions: list[tuple[Array, float]] = []

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, see Restorable."""
        known = [part.odometry for part in self._parts if part.odometry is not None]
        return super().get_state() | {"odometry": [odometry.get_state() for odometry in known]}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, see Restorable."""
        super().set_state(state)
        known = [part.odometry for part in self._parts if part.odometry is not None]
        for odometry, saved in zip(known, state["odometry"], strict=True):
            odometry.set_state(saved)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Restart the tracks of some robots, see Tracker."""
        super().restart(robots, start)
        self._blind[robots] = False
        self._before[robots] = start

    def predict(self, omega: Array, duration: float) -> Array:
        """Propagate the poses, see Tracker; those of robots without a valid pose by their laws."""
        self._motions.append((omega.copy(), duration))
        super().predict(omega, duration)
        self._drive_by_law(self._blind)
        return self._pose.copy()

    def update(self, estimate: PoseEstimate) -> PoseEstimate:
        """Continue the tracks with one estimate per robot, see Tracker."""
        tracked = super().update(estimate)
        blind = ~tracked.valid
        begins = blind & ~self._blind
        self._drive_by_law(begins)
        tracked.pose[begins] = self._pose[begins]

        for part in self._parts:
            is_blind = blind[part.robots]
            if part.odometry is not None and is_blind.any():
                covariance = self._reckoned(part, part.odometry, begins)
                tracked.covariance[part.robots[is_blind]] = covariance[is_blind]
        self._blind = blind
        self._before = self._pose.copy()
        self._motions.clear()
        return tracked

    def _drive_by_law(self, which: np.ndarray) -> None:
        """Replace the poses of some robots, a mask (N,), by those that the motions since the last
        update lead to by their laws.
        """
        for part in self._parts:
            is_driven = which[part.robots]
            if not is_driven.any():
                continue
            pose = self._before[part.robots]
            for omega, duration in self._motions:
                velocity = part.compensation.velocity(omega[part.robots], self.geometry)
                pose = se2.compose(pose, se2.exp(velocity * duration))
            self._pose[part.robots[is_driven]] = pose[is_driven]

    def _reckoned(self, part: _Part, odometry: SlipOdometry, begins: np.ndarray) -> Array:
        """Covariances (R, 3, 3) of the robots of a part after the motions since the last update, of
        which those in the mask `begins` (N,) had a valid pose before; only covariances of robots
        without a valid pose count.
        """
        rows = np.flatnonzero(begins[part.robots])
        robots = part.robots[rows]
        odometry.restart(rows, self._before[robots], self._last_covariance[robots])
        present = part.compensation.odometry(self.geometry)
        if present is not None:
            odometry.use(present.law, present.errors)
        for omega, duration in self._motions:
            odometry.update(omega[part.robots], duration)
        return odometry.covariance


class _Part:
    """Robots with the same compensation, and odometry by its law if the law's errors are known."""

    def __init__(
        self, robots: np.ndarray, compensation: Compensation, geometry: RobotGeometry, start: Array
    ) -> None:
        """Start the robots with indices `robots` (R,) at poses (R, 3)."""
        self.robots = robots
        self.compensation = compensation
        self.odometry = compensation.odometry(geometry)
        if self.odometry is not None:
            self.odometry.reset(start)
