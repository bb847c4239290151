"""Constant ICRs of tracks that slip in proportion to the force that they exert."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import require_between
from trackslip.laws.icr import ConstantIcr, IcrLaw

MAX_COMPLIANCE = 1.2  # largest slip per traction over load [-]
MAX_LOAD = 0.8
"""Largest magnitude of traction over load [-]; with the largest compliance, a track still moves."""


@dataclass(frozen=True)
class IcrLoad(IcrLaw):
    """Constant ICRs, and slip in proportion to the traction per unit load, as on ground that shears.

    With the twist (v', w') of constant ICRs and the traction per unit load (t, t_left) that the robot needs,

        v = v' - t sqrt((C v')^2 + (S w')^2)        w = w'        u = -t_left (C |v| + S |w|)

    Straight uphill the belts slip by C t; downhill the robot outruns them as much. In turns the tracks slide sideways
    anyway, and yield to any other force as well. Where uphill is to the left, the robot drifts to the right: u < 0.

    For small tractions, C = 2 K / (mu L) with the ground's shear modulus K, its friction mu and the length L of the
    contact (Janosi and Hanamoto, 1961), and S = L / (2 mu) in turns that shear the ground to its limit.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    compliance: float = 0.0
    """C: slip per traction over load [-]."""
    turn_compliance: float = 0.0
    """S: speed lost per yaw rate and traction over load [m]."""
    load: Array | tuple[float, float] = (0.0, 0.0)
    """(t, t_left): traction that the robot needs over the load on its tracks, uphill; one, or one per motion [-]."""
    records_icr: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(self, ("turn_compliance",), -np.inf, np.inf, "finite")
        for name, most in (("compliance", MAX_COMPLIANCE), ("load", MAX_LOAD)):
            limit = most * 1.01  # for differences at the limit
            require_between(self, (name,), -limit, limit, f"between {-most} and {most}")

    def under(self, load: ArrayLike) -> IcrLoad:
        """The law of a robot that needs tractions per unit load `load`, one (2,) or (..., 2) [-]."""
        return replace(self, load=np.asarray(load, float))

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce a twist (..., 2)."""
        return self.unloaded_law.sprocket_speeds(self.unloaded(twist), geometry)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """The twist (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        free = self.unloaded_law.twist(omega, geometry)
        v, w = free[..., 0], free[..., 1]
        slower = v - self._tractions[0] * np.hypot(self.compliance * v, self.turn_compliance * w)
        return np.stack(np.broadcast_arrays(slower, w), axis=-1)

    def unloaded(self, twist: ArrayLike) -> Array:
        """The twist (..., 2) without load at the sprocket speeds that produce a twist (..., 2) under load."""
        twist = np.asarray(twist, float)
        v, w = twist[..., 0], twist[..., 1]
        along = self._tractions[0]
        stiff = 1 - np.square(along * self.compliance)
        lost = np.hypot(along * self.compliance * v, np.sqrt(stiff) * along * self.turn_compliance * w)
        return np.stack(np.broadcast_arrays((v + np.sign(along) * lost) / stiff, w), axis=-1)

    def sideslip(self, twist: ArrayLike) -> Array:
        """Speed to the left (...) [m/s] at twists (..., 2)."""
        v, w = np.moveaxis(np.abs(np.asarray(twist, float)), -1, 0)
        return np.asarray(-self._tractions[1] * (self.compliance * v + self.turn_compliance * w))

    def yielding(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Velocities (..., 3), forwards, to the left and of yaw, that load adds at sprocket speeds omega (..., 2)."""
        twist = self.twist(omega, geometry)
        slower = twist[..., 0] - self.unloaded_law.twist(omega, geometry)[..., 0]
        return np.stack([slower, self.sideslip(twist), np.zeros_like(slower)], axis=-1)

    @property
    def _tractions(self) -> tuple[Array, Array]:
        """t and t_left (...)."""
        load = np.asarray(self.load, float)
        return load[..., 0], load[..., 1]

    @property
    def unloaded_law(self) -> ConstantIcr:
        """The law of the robot without load."""
        return ConstantIcr(self.offset, self.half_gauge, self.radius_error)
