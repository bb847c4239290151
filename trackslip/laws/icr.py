"""Tracks with constant instantaneous centres of rotation (ICRs)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array, RobotGeometry, track_speeds
from trackslip.laws.base import SlipLaw, require_between


class IcrLaw(SlipLaw):
    """Base of the laws with ICRs, whose sprocket speeds and twists are regular at every radius.

    They are computed without the slip ratio, which has a pole where a sprocket stands still.
    """

    half_gauge: float
    offsets: ClassVar[tuple[str, ...]] = ("offset",)
    """Names of the D of both tracks, or of each."""
    radius_errors: ClassVar[tuple[str, ...]] = ("radius_error",)
    """Names of the epsilon of both tracks, or of each."""

    def __post_init__(self) -> None:
        require_between(self, ("half_gauge",), 0, np.inf, "finite and > 0")
        allowed = f"finite and > -half_gauge = {-self.half_gauge}"
        require_between(self, self.offsets, -self.half_gauge, np.inf, allowed)
        require_between(self, self.radius_errors, -1, np.inf, "finite and > -1")

    @cached_property
    def _reach(self) -> Array:
        """b + D (..., 2) of the left and right track, or (..., 1) where both have the same [m]."""
        return self._of_tracks(self.offsets) + np.asarray(self.half_gauge, float)[..., None]

    @cached_property
    def _scale(self) -> Array:
        """1 + epsilon (..., 2) of the left and right track, or (..., 1) where both have the same."""
        return 1 + self._of_tracks(self.radius_errors)

    def _of_tracks(self, names: tuple[str, ...]) -> Array:
        return np.stack(np.broadcast_arrays(*(np.asarray(getattr(self, name), float) for name in names)), axis=-1)

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...), driving forwards or turning in place."""
        direction = np.arctan(np.asarray(kappa, float))  # finite for infinite curvature
        return self.slip(np.stack([np.cos(direction), np.sin(direction)], axis=-1))

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2), infinite where a sprocket stands still."""
        commanded = self.sprocket_speeds(twist, RobotGeometry(self.half_gauge, sprocket_radius=1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1 - track_speeds(twist, self.half_gauge) / commanded


class _ConstantIcrs(IcrLaw):
    """Commanded track speeds V are linear in the twist, with D and epsilon of each track.

    (1 + epsilon) V = v -+ (b + D) w
    """

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce a twist (..., 2)."""
        twist = np.asarray(twist, float)
        return (twist[..., :1] + SIDES * self._reach * twist[..., 1:]) / (geometry.sprocket_radius * self._scale)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        arms = SIDES * self._reach
        left, right = np.moveaxis(geometry.sprocket_radius * self._scale * np.asarray(omega, float), -1, 0)
        w = (right - left) / (arms[..., 1] - arms[..., 0])
        return np.stack([right - arms[..., 1] * w, w], axis=-1)


@dataclass(frozen=True)
class ConstantIcr(_ConstantIcrs):
    """Both ICRs at a distance D outside their tracks, as Coulomb friction predicts for slow turns.

    i = 1 - (1 + epsilon) (1 -+ b kappa) / (1 -+ (b + D) kappa): for epsilon = 0, D / (R + b + D) outside and
    -D / (R - b - D) inside.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    records_icr: ClassVar[bool] = True


@dataclass(frozen=True)
class IcrSides(_ConstantIcrs):
    """Constant ICRs that differ between left and right, for an off-centre mass or unequal tracks.

    Reversing the motion reverses all friction forces, so D and epsilon belong to a side of the robot, not of the turn.
    """

    offset_left: float
    """D of the left track [m]."""
    offset_right: float
    """D of the right track [m]."""
    radius_error_left: float
    """epsilon of the left sprocket [-]."""
    radius_error_right: float
    """epsilon of the right sprocket [-]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""

    offsets = ("offset_left", "offset_right")
    radius_errors = ("radius_error_left", "radius_error_right")
