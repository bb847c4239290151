"""No slip, and slip that does not depend on the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array, RobotGeometry, body_twist, twist_of_tracks
from trackslip.laws.base import SlipLaw, by_side, require_slips


@dataclass(frozen=True)
class NoSlip(SlipLaw):
    """Ideal tracks: no slip at any radius."""

    def __call__(self, kappa: ArrayLike) -> Array:
        """Zeros (..., 2)."""
        return np.zeros((*np.shape(kappa), 2))

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce; Eqs. 2 and 5."""
        return body_twist(omega, 0.0, geometry)


@dataclass(frozen=True)
class Constant(SlipLaw):
    """The same slip at every radius, with a jump at the straight path, where it is the mean of both tracks."""

    slip_outer: float
    """Slip of the outer track [-]."""
    slip_inner: float
    """Slip of the inner track [-]."""

    def __post_init__(self) -> None:
        require_slips(self, "slip_outer", "slip_inner")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        return by_side(kappa, np.asarray(self.slip_inner), np.asarray(self.slip_outer))

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce.

        Where neither a left nor a right turn has these sprocket speeds, the robot goes straight or turns in place, with
        slips in between.
        """
        belt = geometry.sprocket_radius * np.asarray(omega, float)
        inner, outer = (1 - np.asarray(slip)[..., None] for slip in (self.slip_inner, self.slip_outer))
        left, right = (belt * np.concatenate(pair, axis=-1) for pair in ((inner, outer), (outer, inner)))
        is_left, is_right = _outwards(left) > 0, _outwards(right) < 0
        to_left = is_left & (~is_right | (_outwards(belt) > 0))
        product = belt[..., :1] * belt[..., 1:]
        side = np.where(product < 0, -1.0, 1.0)
        both = belt[..., :1] + side * belt[..., 1:]
        between = (
            (inner + outer) * product / np.where(both == 0, np.inf, both) * np.concatenate([side, side**2], axis=-1)
        )
        speeds = np.where(to_left[..., None], left, np.where(is_right[..., None], right, between))
        return twist_of_tracks(speeds, geometry.half_gauge)


def _outwards(speeds: Array) -> Array:
    """Numbers (...) that are positive where track speeds (..., 2) turn to the left, negative where to the right."""
    turning = np.abs(speeds[..., 1]) - np.abs(speeds[..., 0])
    return np.where(speeds[..., 0] + speeds[..., 1] == 0, speeds[..., 1], turning)
