"""Tracks with constant instantaneous centres of rotation (ICRs)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array, RobotGeometry
from trackslip.slip.base import SlipLaw, require_between


class _Icr(SlipLaw):
    """Commanded track speeds V linear in the twist, (1 + epsilon) V = v -+ (b + D) w, with D and epsilon of each track.

    The slip ratio has a pole where a sprocket stands still. Sprocket speeds and twists have none and are computed
    without the slip ratio.
    """

    half_gauge: float
    closed_form: ClassVar[bool] = True
    _suffixes: ClassVar[tuple[str, ...]] = ("",)  # of the parameters of each track

    def __post_init__(self) -> None:
        require_between(self, ("half_gauge",), 0, np.inf, "finite and > 0")
        for suffix in self._suffixes:
            allowed = f"finite and > -half_gauge = {-self.half_gauge}"
            require_between(self, (f"offset{suffix}",), -self.half_gauge, np.inf, allowed)
            require_between(self, (f"radius_error{suffix}",), -1, np.inf, "finite and > -1")

    @cached_property
    def _tracks(self) -> tuple[Array, Array]:
        """b + D and 1 + epsilon (..., 2) of the left and right track, or (..., 1) where both have the same."""
        raise NotImplementedError

    @cached_property
    def _arms(self) -> Array:
        """-+ (b + D) (..., 2) of the left and right track."""
        return SIDES * self._tracks[0]

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        direction = np.arctan(np.asarray(kappa, float))[..., None]  # finite for infinite curvature
        along, turning = np.cos(direction), np.sin(direction)
        _, scale = self._tracks
        real = along + SIDES * self.half_gauge * turning
        commanded = along + self._arms * turning
        with np.errstate(divide="ignore"):
            return 1 - scale * real / commanded

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce a twist (..., 2); regular at every radius."""
        twist = np.asarray(twist, float)
        return (twist[..., :1] + self._arms * twist[..., 1:]) / (geometry.sprocket_radius * self._tracks[1])

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce; regular at every radius."""
        reach, scale = self._tracks
        surface = geometry.sprocket_radius * scale * np.asarray(omega, float)
        w = (surface[..., 1] - surface[..., 0]) / (reach[..., 0] + reach[..., -1])
        return np.stack([surface[..., 1] - reach[..., -1] * w, w], axis=-1)


@dataclass(frozen=True)
class ConstantIcr(_Icr):
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

    @cached_property
    def _tracks(self) -> tuple[Array, Array]:
        return np.asarray(self.half_gauge + self.offset)[..., None], np.asarray(1 + self.radius_error)[..., None]


@dataclass(frozen=True)
class IcrSides(_Icr):
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

    _suffixes = ("_left", "_right")

    @cached_property
    def _tracks(self) -> tuple[Array, Array]:
        reach = np.stack(np.broadcast_arrays(self.offset_left, self.offset_right), axis=-1) + self.half_gauge
        scale = np.stack(np.broadcast_arrays(self.radius_error_left, self.radius_error_right), axis=-1) + 1
        return reach, scale
