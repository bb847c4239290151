"""Kinematics of a tracked robot with slip: Eqs. 2-7 and 15 of the paper.

On the last axis, tracks are ordered (left, right), a twist is (v, w) and a pose (x, y, phi). Other
axes are arbitrary.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require_within
from trackslip.se2 import Array as Array
from trackslip.se2 import advance as advance
from trackslip.se2 import wrap_angle as wrap_angle

TRACK_SIGNS: Final = np.array([-1.0, 1.0])
"""Signs (2,) in the track speeds v + TRACK_SIGNS * b * w: the left track is slower if w > 0."""
GEARS: Final = (1e-4, 1e4)
"""Allowed range of turns of an encoder per turn of the sprocket [-]."""
# allowed range of a robot's dimensions; other values are mistakes in the units [m]
_DIMENSIONS: Final = (1e-3, 100.0)


@dataclass(frozen=True)
class RobotGeometry:
    """The robot's dimensions in the kinematics."""

    half_gauge: float
    """b: half the distance between the centre lines of the tracks [m]."""
    sprocket_radius: float
    """r: effective radius of the driving sprockets [m]."""

    def __post_init__(self) -> None:
        require_within("half_gauge", self.half_gauge, *_DIMENSIONS, "m")
        require_within("sprocket_radius", self.sprocket_radius, *_DIMENSIONS, "m")


def track_speeds(twist: ArrayLike, half_gauge: float) -> Array:
    """Speeds (V_l, V_r) (..., 2) of the track centres over the ground [m/s] at twists (..., 2)."""
    twist = np.asarray(twist, float)
    return np.asarray(twist[..., :1] + TRACK_SIGNS * half_gauge * twist[..., 1:])


def twist_of_tracks(speeds: ArrayLike, half_gauge: float) -> Array:
    """Body twists (..., 2) from real track speeds (V_l, V_r) (..., 2) [m/s]; Eq. 5."""
    speeds = np.asarray(speeds, float)
    left = speeds[..., 0]
    right = speeds[..., 1]
    twist = np.empty(speeds.shape)
    twist[..., 0] = (right + left) / 2
    twist[..., 1] = (right - left) / (2 * half_gauge)
    return twist


def body_twist(omega: ArrayLike, slip: ArrayLike, geometry: RobotGeometry) -> Array:
    """Body twists (..., 2) from sprocket speeds omega (..., 2) [rad/s] and slips (..., 2); Eqs. 2
    and 5.
    """
    belts = geometry.sprocket_radius * np.asarray(omega, float)
    speeds = belts * (1 - np.asarray(slip, float))
    return twist_of_tracks(speeds, geometry.half_gauge)


def sprocket_speeds(twist: ArrayLike, slip: ArrayLike, geometry: RobotGeometry) -> Array:
    """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2) at slips (..., 2) other than 1;
    Eq. 15.
    """
    speeds = track_speeds(twist, geometry.half_gauge)
    return speeds / (geometry.sprocket_radius * (1 - np.asarray(slip, float)))


def track_slip(omega: ArrayLike, twist: ArrayLike, geometry: RobotGeometry) -> Array:
    """Slips (..., 2), i = 1 - V / (r omega), at sprocket speeds omega (..., 2) [rad/s] and twists
    (..., 2); Eqs. 2-3.

    The slip of a track whose sprocket is at rest is undefined, NaN.
    """
    belts = geometry.sprocket_radius * np.asarray(omega, float)
    real = track_speeds(twist, geometry.half_gauge)
    is_driven = belts != 0
    with np.errstate(over="ignore"):
        ratio = real / np.where(is_driven, belts, 1.0)
    return np.where(is_driven, 1 - ratio, np.nan)


def curvature(twist: ArrayLike) -> Array:
    """Path curvatures kappa = w / v (...) [1/m] of twists (..., 2): +-infinity when turning in
    place, 0 at rest.
    """
    twist = np.asarray(twist, float)
    v = twist[..., 0]
    w = twist[..., 1]
    if v.all():
        return np.asarray(w / v)
    stays = v == 0
    in_place = np.where(w == 0, 0.0, np.copysign(np.inf, w))
    return np.where(stays, in_place, w / np.where(stays, 1.0, v))


def limit_sprocket_speeds(omega: ArrayLike, limit: float) -> Array:
    """Scale both sprocket speeds (..., 2) so that neither exceeds `limit` [rad/s] and the curvature
    is preserved.
    """
    omega = np.asarray(omega, float)
    fastest = np.abs(omega).max(axis=-1, keepdims=True)
    return np.asarray(omega * (limit / np.maximum(fastest, limit)))
