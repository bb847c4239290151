"""Tracking errors and motor effort of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.trajectory.base import Reference
from trackslip.viewable import Viewable

# time by which an initial error has decayed, and at which the paper's arc begins [s]
TRANSIENT: Final = 12.0
LOST: Final = 0.5  # distance from the reference above which a run counts as failed [m]
_MIN_YAW_RATE: Final = 1e-6  # yaw rate above which a reference turns [rad/s]
_TOP_SPEED_ROUNDING: Final = 1e-9  # relative rounding of a set point at the top speed [-]


def body_errors(pose: ArrayLike, desired: ArrayLike) -> Array:
    """Errors (e_x, e_y, e_phi) (..., 3) of poses (..., 3) in the body frame [m, m, rad], e_phi
    wrapped; Eq. 18.
    """
    errors = se2.between(pose, desired)
    errors[..., 2] = wrap_angle(errors[..., 2])
    return errors


@dataclass(frozen=True)
class TrackingErrors(Viewable):
    """Tracking errors of a run. Position errors are distances to the reference pose at the same
    time.
    """

    rms_position: float
    """Root mean square of the position error [m]."""
    rms_position_after_12s: float
    """Root mean square of the position error after the transient, from 12 s on [m]; NaN for a
    shorter run.
    """
    rms_position_arc: float
    """Root mean square of the position error in reference turns, as in the paper's arc [m]; NaN
    without turns.
    """
    rms_heading: float
    """Root mean square of the heading error [rad]."""
    cross_track: float
    """Root mean square of the position error across the reference's heading [m]."""
    max_position: float
    """Largest position error [m]."""
    final_position: float
    """Position error at the end of the run [m]."""
    final_heading: float
    """Absolute heading error at the end of the run [rad]."""
    success: bool
    """Whether the position error never exceeded LOST."""


@dataclass(frozen=True)
class Expense:
    """Effort of the motors in a run."""

    effort: float
    """Time integral of the mean square of both sprockets' set points [rad^2/s]."""
    roughness: float
    """Root mean square of the set points' rate of change [rad/s^2]."""
    saturation_s: float
    """Time during which a motor is at its limit or a sprocket's set point at its top speed [s]."""


@checks_arguments
def tracking_errors(time: ArrayLike, pose: ArrayLike, reference: Reference) -> TrackingErrors:
    """Compute the errors of poses (T, 3) at times (T,) [s] with respect to `reference`."""
    time = np.asarray(time, float)
    pose = np.asarray(pose, float)
    desired = reference.pose(time)
    yaw_rate = reference.twist(time)[:, 1]

    # position errors in the world, as distances and across the reference's heading
    error = pose - desired
    distance = np.hypot(error[:, 0], error[:, 1])
    across = se2.rotate(-desired[:, 2], error[:, :2])[:, 1]
    heading = wrap_angle(error[:, 2])

    is_settled = time >= TRANSIENT
    is_turning = np.abs(yaw_rate) > _MIN_YAW_RATE
    return TrackingErrors(
        rms_position=rms(distance),
        rms_position_after_12s=rms(distance[is_settled]),
        rms_position_arc=rms(distance[is_turning]),
        rms_heading=rms(heading),
        cross_track=rms(across),
        max_position=float(distance.max()),
        final_position=float(distance[-1]),
        final_heading=float(abs(heading[-1])),
        success=bool(distance.max() <= LOST),
    )


@checks_arguments
def expense(log: RunLog, top_speed: float) -> Expense:
    """Compute the motor effort in a simulated run with sprocket speeds limited to `top_speed`
    [rad/s].

    Raises ValueError if the run has no commands, or no true data about its motors.
    """
    if log.command is None or log.truth is None or log.truth.saturated is None:
        raise ValueError(f"run {log.run!r}: has no commands, or no truth about its motors")
    step = np.diff(log.time)
    set_points = log.command[:-1]  # (T - 1, 2), each kept until the next row
    mean_square = np.mean(set_points**2, axis=1)
    change = np.diff(set_points, axis=0)

    # share of each step in which a motor is at its limit, or all of it at the top speed
    is_at_top = at_top_speed(set_points, top_speed)
    motor_share = log.truth.saturated[1:].max(axis=1)
    saturated_share = np.maximum(motor_share, is_at_top)
    return Expense(
        effort=float(np.sum(mean_square * step)),
        roughness=rms(change / step[:-1, None]),
        saturation_s=float(np.sum(saturated_share * step)),
    )


def at_top_speed(set_points: ArrayLike, top_speed: float) -> np.ndarray:
    """Mask (...) of set points (..., 2) of which one is at the top speed [rad/s]."""
    fastest = np.abs(np.asarray(set_points, float)).max(axis=-1)
    return np.asarray(fastest > top_speed * (1 - _TOP_SPEED_ROUNDING))


def rms(values: ArrayLike) -> float:
    """Root mean square of all elements; NaN for an empty array."""
    values = np.asarray(values, float)
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
