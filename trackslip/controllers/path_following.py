"""Path following with a virtual target, which moves with the robot and only loosely with time.

D. Soetanto, L. Lapierre and A. Pascoal, "Adaptive, non-singular path-following control of dynamic
wheeled robots", CDC 2003; the return to the reference's timing as in P. Encarnação and A. Pascoal,
"Combined trajectory tracking and path following: an application to the coordinated control of
autonomous marine craft", CDC 2001.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import ControlLaw, Memory
from trackslip.errors import require
from trackslip.kinematics import Array, wrap_angle
from trackslip.se2 import between
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class _Target:
    """Virtual targets, one for each robot, each (...)."""

    time: Array  # tau, time at which the reference is at the target [s]
    rate: Array  # tau' [-]


@dataclass(frozen=True)
class PathFollowing(ControlLaw):
    """Law that steers onto the path beside the robot, not to the reference's present pose.

    Each robot has its own virtual target: the reference pose at a time tau. In the target's frame
    the robot is s ahead, y to the left and turned by theta. The target stays beside the robot
    through v_d tau' = v cos(theta) + k_s s; where the reference stands still, tau advances like
    time. The robot approaches the path at the angle delta = -sign(v) theta_a tanh(k_delta y) by
    turning at

        theta' = delta' - k |v| (theta - delta)
                 - gamma y v (sin(theta) - sin(delta)) / (theta - delta)

    Here delta' = d delta / dy y' with y' = v sin(theta) - w_d tau' s, the robot's yaw rate is w =
    theta' + w_d tau', and the quotient is cos(m) sin(h) / h of the mean m and of half the
    difference h of theta and delta. Near a straight line, errors decay with the distance x like
    exp(lambda x) with lambda^2 + (k + a) lambda + a k + gamma = 0, a = theta_a k_delta.

    The speed is v = rho v_d(tau) with rho = 1 + k_t (t - tau), limited to 1 +- `catch_up`, so a
    late robot speeds up but doesn't cut corners. Where the reference almost stands still, the law
    changes to tau' = rho, v = -k_t s.
    """

    along: float = 3.0
    """k_s, rate at which the distance between target and robot along the path decays [1/s]."""
    approach_angle: float = 0.8
    """theta_a, angle to the path at which a distant robot approaches [rad]."""
    approach: float = 4.0
    """k_delta, inverse of the distance from the path where the approach angle decreases [1/m]."""
    across: float = 5.0
    """gamma, gain on the distance from the path [1/m^2]."""
    heading: float = 5.0
    """k, gain on the deviation from the approach angle [1/m]."""
    timing: float = 0.6
    """k_t, rate at which a delay decays [1/s]."""
    catch_up: float = 0.3
    """Largest |rho - 1|, less than 1 [-]."""
    least_speed: float = 0.03
    """Reference speed at which the standstill law has a weight of one half [m/s]."""
    _memory: Memory[_Target] = field(default_factory=Memory, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require(
            self.approach_angle < np.pi / 2,
            "approach_angle",
            self.approach_angle,
            "less than pi/2 rad",
        )
        require(self.catch_up < 1, "catch_up", self.catch_up, "less than 1")

    def reset(self) -> None:
        """Discard the targets; the next call may be for a different number of robots."""
        self._memory.reset()

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3) of as many robots as since `reset`."""
        pose = np.asarray(pose, float)
        robots = pose.shape[:-1]
        tau = self._target_time(time, robots)
        s, y, theta = np.moveaxis(between(reference.pose(tau), pose), -1, 0)
        theta = wrap_angle(theta)
        v_d, w_d = np.moveaxis(reference.twist(tau), -1, 0)

        # Speed: v = rho v_d, and -k_t s where the reference stands still.
        rho = 1 + np.clip(self.timing * (time - tau), -self.catch_up, self.catch_up)
        standing = self.least_speed**2 / (v_d**2 + self.least_speed**2)  # the latter law's weight
        v = rho * v_d - standing * self.timing * s

        # Target: v_d tau' = v cos(theta) + k_s s. It waits while the pose is lost.
        safe_v_d = np.where(v_d == 0, 1.0, v_d)
        moving = (v * np.cos(theta) + self.along * s) / safe_v_d
        rate = np.fmax(standing * rho + (1 - standing) * moving, 0.0)
        self._memory.store(time, robots, _Target(tau, rate))

        # Approach angle, and its derivative by y.
        steepest = np.sign(v) * self.approach_angle
        delta = -steepest * np.tanh(self.approach * y)
        slope = -steepest * self.approach / np.cosh(self.approach * y) ** 2

        # Steering: w = theta' + w_d tau'.
        deviation = theta - delta
        middle = (theta + delta) / 2
        delta_rate = slope * (v * np.sin(theta) - w_d * rate * s)
        quotient = np.sinc(deviation / (2 * np.pi))  # sin(h) / h
        steering = delta_rate - self.across * y * v * np.cos(middle) * quotient
        w = w_d * rate + steering - self.heading * np.abs(v) * deviation
        return np.stack([v, w], axis=-1)

    def _target_time(self, time: float, robots: tuple[int, ...]) -> Array:
        """tau (...) [s] at `time` [s] for robots (...); `time` itself in the first call."""
        recalled = self._memory.recall(time, robots)
        if recalled is None:
            return np.full(robots, float(time))
        elapsed, target = recalled
        return target.time + elapsed * target.rate
