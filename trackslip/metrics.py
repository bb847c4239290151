"""Errors of tracking and of estimation, with units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array, wrap_angle
from trackslip.trajectory import Reference

TRANSIENT = 12.0
"""When the paper's arc begins and an initial error has died out [s]."""


def body_errors(pose: ArrayLike, desired: ArrayLike) -> Array:
    """Errors (e_x, e_y, e_phi) (..., 3) of poses (..., 3) in the body frame [m, m, rad], e_phi wrapped; Eq. 18."""
    pose, desired = np.asarray(pose, float), np.asarray(desired, float)
    dx, dy, dphi = np.moveaxis(desired - pose, -1, 0)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack([cos * dx + sin * dy, -sin * dx + cos * dy, wrap_angle(dphi)], axis=-1)


@dataclass(frozen=True)
class TrackingErrors:
    """How well a run followed its reference."""

    rms_position: float
    """[m]"""
    rms_position_after_12s: float
    """The same from 12 s on, when the transient is over; NaN for a shorter run [m]."""
    max_position: float
    """[m]"""
    final_position: float
    """[m]"""
    final_heading: float
    """Absolute [rad]."""


def tracking_errors(time: ArrayLike, pose: ArrayLike, reference: Reference) -> TrackingErrors:
    """Errors of the poses (T, 3) of a run at times (T,) [s] against `reference`."""
    time = np.asarray(time, float)
    errors = body_errors(pose, reference.pose(time))
    distance = np.hypot(errors[:, 0], errors[:, 1])
    late = distance[time >= TRANSIENT]
    return TrackingErrors(
        rms_position=rms(distance),
        rms_position_after_12s=rms(late) if late.size else float("nan"),
        max_position=float(distance.max()),
        final_position=float(distance[-1]),
        final_heading=float(abs(errors[-1, 2])),
    )


def rms(values: ArrayLike) -> float:
    """Root mean square over all elements."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))
