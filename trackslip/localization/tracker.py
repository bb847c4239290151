"""Poses of single scans -> one track: half turns resolved, wild poses refused, gaps bridged by the encoders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, advance, body_twist
from trackslip.localization.base import PoseEstimate


@dataclass(frozen=True)
class Gate:
    """How far a pose may lie from its prediction to be believed. It widens with the way driven blind."""

    position: float = 0.10
    """[m]"""
    heading: float = np.radians(20.0)
    """[rad], at most 90 degrees, where a plate can't be told from its opposite."""
    growth: float = 0.3
    """Error of dead reckoning, as a fraction of the way and turn since the last valid pose [-]."""


class Tracker:
    """Follows N robots from scan to scan.

    The heading of a plate is known up to half a turn; the one nearest to the prediction is taken. The prediction is the
    last pose carried on by the encoders without slip, which over one scan is off by less than a millimetre.
    """

    def __init__(self, start: Array, geometry: RobotGeometry, gate: Gate | None = None) -> None:
        """`start` is the known pose of each robot, (N, 3) in the world."""
        self._pose = np.array(start, float)
        self._geometry = geometry
        self._gate = gate or Gate()
        self._blind = np.zeros((len(self._pose), 2))  # way [m] and turn [rad] since the last valid pose
        self._covariance = np.zeros((len(self._pose), 3, 3))

    def predict(self, omega: Array, duration: float) -> Array:
        """Carry the poses on by sprocket speeds (N, 2) [rad/s] held for `duration` [s]; the new poses (N, 3)."""
        twist = body_twist(omega, 0.0, self._geometry)
        self._pose = advance(self._pose, twist, duration)
        moved = np.abs(twist) * duration
        self._blind += moved
        spread = self._gate.growth * moved
        self._covariance[:, [0, 1], [0, 1]] += spread[:, :1] ** 2
        self._covariance[:, 2, 2] += spread[:, 1] ** 2
        return self._pose.copy()

    def update(self, estimate: PoseEstimate) -> PoseEstimate:
        """The estimate of N poses, one a robot, put in track; where refused, the prediction, marked not valid."""
        difference = estimate.pose - self._pose
        half_turns = np.round(difference[:, 2] / np.pi)
        pose = estimate.pose.copy()
        pose[:, 2] -= half_turns * np.pi
        growth = self._gate.growth * self._blind
        far = np.hypot(difference[:, 0], difference[:, 1]) > self._gate.position + growth[:, 0]
        turned = np.abs(pose[:, 2] - self._pose[:, 2]) > self._gate.heading + growth[:, 1]
        valid = estimate.valid & ~far & ~turned
        self._pose[valid] = pose[valid]
        self._blind[valid] = 0.0
        self._covariance[valid] = estimate.covariance[valid]
        return PoseEstimate(self._pose.copy(), self._covariance.copy(), valid)
