"""Laws that steer towards a point ahead: pure pursuit, plain and regulated, and Stanley's law.

R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992;
S. Macenski, S. Singh, F. Martín and J. Ginés, "Regulated pure pursuit for robot path tracking",
Autonomous Robots 47, 2023; G. M. Hoffmann, C. J. Tomlin, M. Montemerlo and S. Thrun, "Autonomous
automobile trajectory tracking for off-road driving: controller design, experimental validation and
racing", ACC 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import OncePerReference, Scheduled
from trackslip.controllers.feedback import ErrorFeedback, Errors
from trackslip.errors import require, require_at_most
from trackslip.kinematics import Array, advance, wrap_angle
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

_SAMPLING_PERIOD: Final = 0.01  # approximate period at which a reference's speed is sampled [s]


@dataclass(frozen=True)
class PurePursuit(Scheduled):
    """Law that drives the arc through a goal on the path, beyond the reference pose.

    The goal is `look_ahead` further along the path. The curvature of the arc is 2 y / d^2 for a
    goal at (x, y) in the body frame, at distance d. Without errors the arc has the path's
    curvature. On a straight line the closed loop is that of Eq. 31 with g = 2 / look_ahead^2 and xi
    = 1 / sqrt(2). The robot waits rather than drive against the direction of the reference.
    """

    turns_on_the_spot = False  # the yaw rate is the speed times a curvature

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
    """Pure pursuit that looks further ahead at speed, and slows down in bends and before stops.

    This is the controller from Nav2, with the same parameter names. Here the desired speed is the
    speed that keeps up with the reference, and is not reduced near obstacles.
    """

    turns_on_the_spot = False  # the yaw rate is the speed times a curvature

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
    """Distance to a cusp, stop or end of the path below which the speed falls in proportion [m]."""
    min_approach_linear_velocity: float = 0.05
    """Lowest speed to which the approach to a cusp, stop or end reduces the desired speed [m/s]."""
    _path: OncePerReference[PathAhead] = field(
        default_factory=OncePerReference, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_at_most("min_lookahead_dist", self.min_lookahead_dist, self.max_lookahead_dist, "m")

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3)."""
        v_d, _ = reference.twist(time)
        distance = self.lookahead_time * abs(v_d)
        distance = min(max(distance, self.min_lookahead_dist), self.max_lookahead_dist)
        path = self._path(PathAhead, reference)
        v, curvature, remaining = path.pursued(time, pose, distance, self.speed_gain)

        # slower in bends
        sharpness = np.abs(curvature) * self.regulated_linear_scaling_min_radius
        in_bend = np.abs(v) / np.maximum(sharpness, 1.0)
        limit = np.maximum(in_bend, self.regulated_linear_scaling_min_speed)

        # slower before cusps, stops and the end
        nearness = np.clip(remaining / self.approach_velocity_scaling_dist, 0.0, 1.0)
        approach = np.maximum(limit * nearness, self.min_approach_linear_velocity)
        limit = np.minimum(limit, approach)

        v = np.clip(v, -limit, limit)
        return np.stack([v, v * curvature], axis=-1)


class PathAhead:
    """The path of a reference, split where the reference reverses or stops."""

    def __init__(self, reference: Reference) -> None:
        """Sample the speeds of a reference in C cells of equal duration."""
        self._reference = reference
        cells = max(1, round(reference.duration / _SAMPLING_PERIOD))
        self._times = np.linspace(0.0, reference.duration, cells + 1)  # (C + 1,) edges of the cells
        middles = (self._times[1:] + self._times[:-1]) / 2
        speeds = reference.twist(middles)[:, 0]
        steps = speeds * np.diff(self._times)
        self._distance = np.concatenate([[0.0], np.cumsum(steps)])  # (C + 1,) driven until an edge
        self._direction = np.sign(speeds)  # (C,)
        changes = np.flatnonzero(np.diff(self._direction)) + 1
        breaks = np.concatenate([changes, [cells]])
        next_break = np.searchsorted(breaks, np.arange(cells), side="right")
        self._break = breaks[next_break]  # (C,) edge at which the next break is

    def pursued(
        self, time: float, pose: ArrayLike, look_ahead: float, gain: Callable[[Array], Array]
    ) -> tuple[Array, Array, Array]:
        """Speeds [m/s], curvatures of arcs to a goal [1/m] and remaining distances [m], each (...).

        They belong to poses (..., 3). The goal is `look_ahead` [m] beyond the reference pose at
        `time` [s]. A remaining distance ends at the next cusp, stop or end of the path. `gain` is
        the speed law's gain as a function of the reference twist.
        """
        desired = self._reference.twist(time)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, self._reference.pose(time)), -1, 0)
        errors = (e_x, e_y, e_phi)
        v = speed_to_keep_up(desired, errors, gain(desired))

        goal, to_break = self.point(time, look_ahead)
        x, y, _ = np.moveaxis(body_errors(pose, goal), -1, 0)
        # A robot far ahead of the reference may be close to the goal, where it must not spin.
        least = (look_ahead / 2) ** 2
        curvature = 2 * y / np.maximum(x**2 + y**2, least)

        remaining = to_break + np.sign(desired[0]) * error_along_path(errors)
        return v, curvature, remaining

    def point(self, time: float, distance: float) -> tuple[Array, float]:
        """The pose (3,) `distance` [m] beyond that at `time` [s], and the way to the break.

        The break is the next cusp, stop or end of the path, which continues along its tangent [m].
        """
        now = float(np.clip(time, 0.0, self._reference.duration))
        cell = int(np.searchsorted(self._times, now, side="right")) - 1
        cell = min(cell, len(self._direction) - 1)
        direction = self._direction[cell]  # 0 at a stop

        # distances from here to the edges of cells until the next break
        edges = slice(cell, self._break[cell] + 1)
        driven = np.interp(now, self._times, self._distance)
        ahead = direction * (self._distance[edges] - driven)
        to_break = float(ahead[-1])

        then = now
        if direction:
            then = max(now, float(np.interp(distance, ahead, self._times[edges])))
        beyond_break = direction * max(0.0, distance - to_break)
        goal = advance(self._reference.pose(then), [beyond_break, 0.0], 1.0)
        return goal, to_break


@dataclass(frozen=True)
class Stanley(Scheduled, ErrorFeedback):
    """Law that steers a virtual axle onto the path of the reference's axle.

    The axle is `wheelbase` ahead of the robot, in reverse behind it. The steering angle is delta =
    psi + atan(k e / (k_s + |v|)), where psi is the direction of the axle's path relative to the
    robot, e_phi + atan(wheelbase kappa_d) for a reference of curvature kappa_d, and e the distance
    of that path to the left of the axle. There is thus no steady-state error on arcs. The yaw rate
    is |v| tan(delta) / wheelbase. A steered axle cannot back up to a reference that drives
    forwards, so the robot waits for a reference behind it.
    """

    turns_on_the_spot = False  # the yaw rate is the speed times a curvature

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
        v_d, w_d = desired
        e_x, e_y, e_phi = errors
        direction = -1.0 if v_d < 0 else 1.0
        v = speed_to_keep_up(desired, errors, self.speed_gain(desired))

        # e: the error of the axle across its path
        axle_x = direction * e_x + self.wheelbase * (np.cos(e_phi) - 1)
        axle_y = direction * e_y + self.wheelbase * np.sin(e_phi)
        psi = wrap_angle(e_phi + np.arctan2(self.wheelbase * w_d, np.abs(v_d)))
        crosstrack = np.cos(psi) * axle_y - np.sin(psi) * axle_x

        delta = psi + np.arctan(self.gain * crosstrack / (self.softening + np.abs(v)))
        delta = np.clip(delta, -self.steering_limit, self.steering_limit)
        w = np.abs(v) * np.tan(delta) / self.wheelbase
        return v, w


def speed_to_keep_up(desired: Array, errors: Errors, gain: Array) -> Array:
    """Speeds (...) [m/s]: v_d plus k [1/s] times the error along the path, but not against v_d.

    `desired` is the reference twist (2,), `errors` are each (...), and `gain` is k. Laws that steer
    towards a point ahead use this speed. Such laws are unstable when the robot drives away from
    that point, so the robot waits for a reference behind it. With such laws the robot turns round
    only while driving, so the speed must not depend on the heading. To first order the speed equals
    v_d cos(e_phi) + k e_x.
    """
    v_d, _ = desired
    direction = np.sign(v_d)
    wanted = v_d + gain * error_along_path(errors)
    return direction * np.maximum(direction * wanted, 0.0)


def error_along_path(errors: Errors) -> Array:
    """Errors (...) [m] along the reference's heading: positive if the robot is behind."""
    e_x, e_y, e_phi = errors
    return np.asarray(np.cos(e_phi) * e_x + np.sin(e_phi) * e_y)
