"""Laws that steer towards a point ahead: pure pursuit, plain and regulated, and the law of the
robot Stanley.

R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992;
S. Macenski, S. Singh, F. Martín and J. Ginés, "Regulated pure pursuit for robot path tracking",
Autonomous Robots 47, 2023; G. M. Hoffmann, C. J. Tomlin, M. Montemerlo and S. Thrun, "Autonomous
automobile trajectory tracking for off-road driving: controller design, experimental validation and
racing", ACC 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import OncePerReference, Scheduled
from trackslip.controllers.feedback import ErrorFeedback, Errors
from trackslip.errors import require, require_at_most
from trackslip.kinematics import Array, advance, wrap_angle
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

STEP = 0.01
"""Approximate sampling period for the speed of a reference [s]."""


@dataclass(frozen=True)
class PurePursuit(Scheduled):
    """Law that drives the arc through a goal on the path, `look_ahead` further along than the
    reference pose.

    The curvature of the arc is 2 y / d^2 for a goal at (x, y) in the body frame, at distance d.
    Without errors the arc has the path's curvature. On a straight line the closed loop is that of
    Eq. 31 with g = 2 / look_ahead^2 and xi = 1 / sqrt(2). The robot waits rather than drive against
    the direction of the reference.
    """

    look_ahead: float = 0.3
    """Distance of the goal along the path [m]."""
    _path: OncePerReference[PathAhead] = field(
        default_factory=OncePerReference, init=False, repr=False, compare=False
    )

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3)."""
        path = self._path(PathAhead, reference)
        v, curvature, _ = path.pursued(time, pose, self.look_ahead, self.speed_gain)
        return np.stack([v, v * curvature], axis=-1)


@dataclass(frozen=True)
class RegulatedPurePursuit(Scheduled):
    """Pure pursuit that looks further ahead at high speed and slows down in sharp bends and before
    cusps and stops.

    This is the controller from Nav2, with the same parameter names. Here the desired speed is the
    speed that keeps up with the reference, and is not reduced near obstacles.
    """

    lookahead_time: float = 1.5
    """Distance of the goal along the path divided by the reference speed [s]."""
    min_lookahead_dist: float = 0.15
    """Smallest distance of the goal along the path [m]."""
    max_lookahead_dist: float = 0.6
    """Largest distance of the goal along the path [m]."""
    regulated_linear_scaling_min_radius: float = 0.4
    """Arc radius below which the speed falls in proportion to the radius [m]."""
    regulated_linear_scaling_min_speed: float = 0.05
    """Lowest speed to which bends reduce the desired speed [m/s]."""
    approach_velocity_scaling_dist: float = 0.05
    """Distance to a cusp, stop or end of the path below which the speed falls in proportion to the
    distance [m].
    """
    min_approach_linear_velocity: float = 0.05
    """Lowest speed to which the approach to a cusp, a stop or the end of the path reduces the
    desired speed [m/s].
    """
    _path: OncePerReference[PathAhead] = field(
        default_factory=OncePerReference, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_at_most("min_lookahead_dist", self.min_lookahead_dist, self.max_lookahead_dist, "m")

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3)."""
        distance = self.lookahead_time * abs(reference.twist(time)[0])
        distance = min(max(distance, self.min_lookahead_dist), self.max_lookahead_dist)
        path = self._path(PathAhead, reference)
        v, curvature, remaining = path.pursued(time, pose, distance, self.speed_gain)
        sharp = np.maximum(np.abs(curvature) * self.regulated_linear_scaling_min_radius, 1.0)
        near = np.clip(remaining / self.approach_velocity_scaling_dist, 0.0, 1.0)
        slow = np.maximum(np.abs(v) / sharp, self.regulated_linear_scaling_min_speed)
        slow = np.minimum(slow, np.maximum(slow * near, self.min_approach_linear_velocity))
        v = np.clip(v, -slow, slow)
        return np.stack([v, v * curvature], axis=-1)


class PathAhead:
    """The path of a reference, split where the reference reverses or stops."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        cells = max(1, round(reference.duration / STEP))
        self._times = np.linspace(0.0, reference.duration, cells + 1)  # (C + 1,)
        speeds = reference.twist((self._times[1:] + self._times[:-1]) / 2)[:, 0]
        # (C + 1,)
        self._distance = np.concatenate([[0.0], np.cumsum(speeds * np.diff(self._times))])
        self._direction = np.sign(speeds)  # (C,)
        cuts = np.concatenate([np.flatnonzero(np.diff(self._direction)) + 1, [cells]])
        self._cut = cuts[np.searchsorted(cuts, np.arange(cells), side="right")]  # (C,)

    def pursued(
        self, time: float, pose: ArrayLike, look_ahead: float, gain: Callable[[Array], Array]
    ) -> tuple[Array, Array, Array]:
        """Speeds [m/s], curvatures of arcs to a goal [1/m] and remaining distances [m], each (...),
        at poses (..., 3).

        The goal is `look_ahead` [m] beyond the reference pose at `time` [s]. A remaining distance
        ends at the next cusp, stop or end of the path. `gain` is the speed law's gain as a function
        of the reference twist.
        """
        desired = self._reference.twist(time)
        goal, left = self.point(time, look_ahead)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, self._reference.pose(time)), -1, 0)
        v = speed_to_keep_up(desired, (e_x, e_y, e_phi), gain(desired))
        x, y, _ = np.moveaxis(body_errors(pose, goal), -1, 0)
        # A robot far ahead of the reference may be close to the goal, where it must not spin.
        curvature = 2 * y / np.maximum(x**2 + y**2, (look_ahead / 2) ** 2)
        return (
            v,
            curvature,
            left + np.sign(desired[0]) * (np.cos(e_phi) * e_x + np.sin(e_phi) * e_y),
        )

    def point(self, time: float, distance: float) -> tuple[Array, float]:
        """The pose (3,) `distance` [m] further along the path than at `time` [s], and the distance
        to the next break.

        Both distances are in m. A break is a cusp, a stop or the end of the path, followed by the
        path's tangent.
        """
        now = float(np.clip(time, 0.0, self._reference.duration))
        cell = min(
            int(np.searchsorted(self._times, now, side="right")) - 1, len(self._direction) - 1
        )
        direction, cut = self._direction[cell], self._cut[cell]
        way = direction * (
            self._distance[cell : cut + 1] - np.interp(now, self._times, self._distance)
        )
        then = max(now, np.interp(distance, way, self._times[cell : cut + 1])) if direction else now
        missing = direction * max(0.0, distance - way[-1])
        return advance(self._reference.pose(then), [missing, 0.0], 1.0), float(way[-1])


@dataclass(frozen=True)
class Stanley(Scheduled, ErrorFeedback):
    """Law that steers a virtual axle, `wheelbase` ahead of the robot (behind it in reverse), onto
    the axle's path.

    The steering angle is delta = psi + atan(k e / (k_s + |v|)), where psi is the direction of the
    axle's path relative to the robot, e_phi + atan(wheelbase kappa_d) for a reference of curvature
    kappa_d, and e the distance of that path to the left of the axle. There is thus no steady-state
    error on arcs. The yaw rate is |v| tan(delta) / wheelbase. A steered axle cannot back up to a
    reference that drives forwards, so the robot waits for a reference behind it.
    """

    wheelbase: float = 0.2
    """Distance of the virtual axle from the centre of the robot [m]."""
    gain: float = 1.0
    """k, gain on the axle's distance from its path [1/s]."""
    softening: float = 0.1
    """k_s, which limits the steering angle at low speed [m/s]."""
    steering_limit: float = np.pi / 3
    """Maximum |delta| [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(
            self.steering_limit < np.pi / 2,
            "steering_limit",
            self.steering_limit,
            "less than pi/2 rad",
        )

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        direction = -1.0 if v_d < 0 else 1.0
        v = speed_to_keep_up(desired, errors, self.speed_gain(desired))
        axle_x = direction * e_x + self.wheelbase * (np.cos(e_phi) - 1)
        axle_y = direction * e_y + self.wheelbase * np.sin(e_phi)
        psi = wrap_angle(e_phi + np.arctan2(self.wheelbase * w_d, np.abs(v_d)))
        crosstrack = np.cos(psi) * axle_y - np.sin(psi) * axle_x
        delta = psi + np.arctan(self.gain * crosstrack / (self.softening + np.abs(v)))
        delta = np.clip(delta, -self.steering_limit, self.steering_limit)
        return v, np.abs(v) * np.tan(delta) / self.wheelbase


def speed_to_keep_up(desired: Array, errors: Errors, gain: Array) -> Array:
    """Speeds (...) [m/s]: v_d plus k [1/s] times the error along the path, or 0 if the sum is
    opposite to v_d.

    `desired` is the reference twist (2,), `errors` are each (...), and `gain` is k. Laws that steer
    towards a point ahead use this speed. Such laws are unstable when the robot drives away from
    that point, so the robot waits for a reference behind it. With such laws the robot turns round
    only while driving, so the speed must not depend on the heading. To first order the speed equals
    v_d cos(e_phi) + k e_x.
    """
    e_x, e_y, e_phi = errors
    direction = np.sign(desired[0])
    return direction * np.maximum(
        direction * (desired[0] + gain * (np.cos(e_phi) * e_x + np.sin(e_phi) * e_y)), 0.0
    )
