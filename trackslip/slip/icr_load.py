"""Constant ICRs of tracks that slip in proportion to what they pull."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array, RobotGeometry
from trackslip.slip.base import SlipLaw, require_between

MAX_COMPLIANCE = 1.2
"""Largest slip per traction over load [-]."""
MAX_LOAD = 0.8
"""Largest magnitude of traction over load [-]; with the largest compliance, a track still moves."""


@dataclass(frozen=True)
class IcrLoad(SlipLaw):
    """Constant ICRs, and slip in proportion to the traction per unit load, as on ground that shears.

    With the belts' nominal speeds V = r omega and the traction per unit load t that the robot needs,

        (1 + epsilon) (V - C t |V|) = v -+ (b + D) w

    A belt that runs forwards and pulls the robot uphill slips by C t; one that runs backwards is dragged along, and
    slips as much the other way. For small tractions, C = 2 K / (mu L) with the ground's shear modulus K, its friction
    mu and the length L of the contact (Janosi and Hanamoto, 1961).
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    compliance: float = 0.0
    """C: slip per traction over load [-]."""
    load: float | Array = 0.0
    """t: traction that the robot needs over the load on its tracks, positive uphill; one, or one per motion [-]."""

    def __post_init__(self) -> None:
        require_between(self, ("half_gauge",), 0, np.inf, "finite and > 0")
        outside = f"finite and > -half_gauge = {-self.half_gauge}"
        require_between(self, ("offset",), -self.half_gauge, np.inf, outside)
        require_between(self, ("radius_error",), -1, np.inf, "finite and > -1")
        most = MAX_COMPLIANCE * 1.01  # for differences at the limit
        require_between(self, ("compliance",), -most, most, f"between {-MAX_COMPLIANCE} and {MAX_COMPLIANCE}")
        most = MAX_LOAD * 1.01
        require_between(self, ("load",), -most, most, f"between {-MAX_LOAD} and {MAX_LOAD}")

    def under(self, load: ArrayLike) -> IcrLoad:
        """The law of a robot that needs tractions per unit load `load`, one or (...) [-]."""
        return replace(self, load=np.asarray(load, float))

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...), driving forwards or turning in place."""
        direction = np.arctan(np.asarray(kappa, float))  # finite for infinite curvature
        return self.slip(np.stack([np.cos(direction), np.sin(direction)], axis=-1))

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2)."""
        twist = np.asarray(twist, float)
        real = twist[..., :1] + SIDES * self.half_gauge * twist[..., 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1 - real / self._belts(twist)

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce a twist (..., 2); regular at every radius."""
        return self._belts(np.asarray(twist, float)) / geometry.sprocket_radius

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce; regular at every radius."""
        scale = geometry.sprocket_radius * _column(1 + np.asarray(self.radius_error))
        gripped = scale * self.gripped(omega)
        reach = np.asarray(self.half_gauge + np.asarray(self.offset))
        left, right = gripped[..., 0], gripped[..., 1]
        return np.stack([(right + left) / 2, (right - left) / (2 * reach)], axis=-1)

    def gripped(self, omega: ArrayLike) -> Array:
        """Sprocket speeds (..., 2) without what slips under load, for sprocket speeds (..., 2) [rad/s]."""
        omega = np.asarray(omega, float)
        return np.asarray(omega - self._slip_by_load * np.abs(omega))

    @property
    def _slip_by_load(self) -> Array:
        """C t (..., 1)."""
        return _column(np.asarray(self.compliance) * np.asarray(self.load))

    def _belts(self, twist: Array) -> Array:
        """Nominal speeds V (..., 2) of the belts at twists (..., 2)."""
        reach = _column(self.half_gauge + np.asarray(self.offset))
        gripped = (twist[..., :1] + SIDES * reach * twist[..., 1:]) / _column(1 + np.asarray(self.radius_error))
        return np.asarray(gripped / (1 - self._slip_by_load * np.sign(gripped)))


def _column(values: Any) -> Array:
    return np.asarray(values, float)[..., None]
