"""Laws of constant instantaneous centres of rotation (ICRs) of the tracks, with or without slip
under load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry, track_speeds
from trackslip.laws.base import SlipLaw, require_between

MAX_COMPLIANCE: Final = 1.2
"""Largest slip per traction per unit load [-]."""
MAX_LOAD: Final = 0.8
"""Largest magnitude of the traction per unit load [-], at which a track moves even with
MAX_COMPLIANCE.
"""
_LIMIT_MARGIN: Final = 1.01  # for finite differences at a limit


class IcrLaw(SlipLaw):
    """Base class of laws with ICRs, whose sprocket speeds and twists are regular at every radius.

    Speeds and twists are computed without the slip ratio, which has a pole where a sprocket stands
    still.
    """

    half_gauge: float
    offsets: ClassVar[tuple[str, ...]] = ("offset",)
    """Names of the fields for D: a name for both tracks, or a name for each track."""
    radius_errors: ClassVar[tuple[str, ...]] = ("radius_error",)
    """Names of the fields for epsilon: a name for both tracks, or a name for each track."""

    def __post_init__(self) -> None:
        require_between(self, ("half_gauge",), 0, np.inf, "finite and > 0")
        allowed = f"finite and > -half_gauge = {-self.half_gauge}"
        require_between(self, self.offsets, -self.half_gauge, np.inf, allowed)
        require_between(self, self.radius_errors, -1, np.inf, "finite and > -1")

    @cached_property
    def _reach(self) -> Array:
        """b + D (..., 2) of the left and right track, or (..., 1) if equal for both [m]."""
        return self._of_tracks(self.offsets) + np.asarray(self.half_gauge, float)[..., None]

    @cached_property
    def _scale(self) -> Array:
        """1 + epsilon (..., 2) of the left and right track, or (..., 1) if equal for both [-]."""
        return 1 + self._of_tracks(self.radius_errors)

    def _of_tracks(self, names: tuple[str, ...]) -> Array:
        values = [np.asarray(getattr(self, name), float) for name in names]
        return np.stack(np.broadcast_arrays(*values), axis=-1)

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...) when driving forwards or turning in place."""
        direction = np.arctan(np.asarray(kappa, float))  # finite for infinite curvature
        return self.slip(np.stack([np.cos(direction), np.sin(direction)], axis=-1))

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2); infinite where a sprocket stands still."""
        commanded = self.sprocket_speeds(twist, RobotGeometry(self.half_gauge, sprocket_radius=1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1 - track_speeds(twist, self.half_gauge) / commanded


class _ConstantIcrs(IcrLaw):
    """Base class of laws in which track speeds V are linear in the twist, with D and epsilon of
    each track.

    (1 + epsilon) V = v -+ (b + D) w

    With the belt speeds c of both sides and the arms a = -+(b + D), c = v + a w, so w is the
    difference of the belt speeds over that of the arms, and v = c - a w of either side.
    """

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2)."""
        twist = np.asarray(twist, float)
        arms = TRACK_SIGNS * self._reach
        belts = twist[..., :1] + arms * twist[..., 1:]
        return belts / (geometry.sprocket_radius * self._scale)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        belts = geometry.sprocket_radius * self._scale * np.asarray(omega, float)
        left, right = np.moveaxis(belts, -1, 0)
        arms = TRACK_SIGNS * self._reach
        left_arm = arms[..., 0]
        right_arm = arms[..., 1]
        w = (right - left) / (right_arm - left_arm)
        v = right - right_arm * w
        return np.stack([v, w], axis=-1)


@dataclass(frozen=True)
class ConstantIcr(_ConstantIcrs):
    """The law of ICRs at a distance D outside both tracks, as Coulomb friction predicts for slow
    turns.

    i = 1 - (1 + epsilon) (1 -+ b kappa) / (1 -+ (b + D) kappa), which for epsilon = 0 is D / (R + b
    + D) on the outer track and -D / (R - b - D) on the inner track.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    records_icr: ClassVar[bool] = True


@dataclass(frozen=True)
class DiffDrive(_ConstantIcrs):
    """The law of a differential drive: an effective radius of each side's sprockets, and the
    distance between the ICRs.

    These are the three parameters of diff_drive_controller, of UMBmark (J. Borenstein and L. Feng,
    1996) and of G. Antonelli, S. Chiaverini and G. Fusco's calibration (2005).
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    radius_error_left: float
    """epsilon of the left sprocket [-]."""
    radius_error_right: float
    """epsilon of the right sprocket [-]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""

    radius_errors = ("radius_error_left", "radius_error_right")


@dataclass(frozen=True)
class IcrSides(_ConstantIcrs):
    """The law of constant ICRs that differ between left and right, for an off-centre mass or
    unequal tracks.

    Reversing the motion reverses all friction forces, so D and epsilon belong to a side of the
    robot, not of the turn.
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


@dataclass(frozen=True)
class IcrLoad(IcrLaw):
    """The law of constant ICRs and slip in proportion to the traction per unit load, as on ground
    that shears.

    With the twist (v', w') of constant ICRs and the traction per unit load (t, t_left) that the
    robot needs,

        v = v' - t sqrt((C v')^2 + (S w')^2)        w = w'        u = -t_left (C |v| + S |w|)

    Straight uphill the belts slip by C t; downhill the robot is faster than the belts by the same
    ratio. In turns the tracks slide sideways and thus also yield to other forces. If uphill is to
    the left, the robot drifts right: u < 0.

    For small tractions, C = 2 K / (mu L) with the ground's shear modulus K, its friction mu and the
    length L of the contact (Janosi and Hanamoto, 1961), and S = L / (2 mu) in turns that shear the
    ground to its limit.
    """

    offset: float
    """D: distance of the ICRs outside the centre lines of the tracks [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    compliance: float = 0.0
    """C: slip per traction per unit load [-]."""
    turn_compliance: float = 0.0
    """S: speed lost per yaw rate and traction per unit load [m]."""
    load: Array | tuple[float, float] = (0.0, 0.0)
    """(t, t_left): required traction per load on the tracks, positive uphill, one pair or a pair
    per motion [-].
    """
    records_icr: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(self, ("turn_compliance",), -np.inf, np.inf, "finite")
        for name, largest in (("compliance", MAX_COMPLIANCE), ("load", MAX_LOAD)):
            limit = largest * _LIMIT_MARGIN
            require_between(self, (name,), -limit, limit, f"between {-largest} and {largest}")

    def under(self, load: ArrayLike) -> IcrLoad:
        """The law for a robot with tractions per unit load `load`, a pair (2,) or pairs (..., 2)
        [-].
        """
        return replace(self, load=np.asarray(load, float))

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2)."""
        return self.unloaded_law.sprocket_speeds(self.unloaded(twist), geometry)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce."""
        free = self.unloaded_law.twist(omega, geometry)
        v = free[..., 0]
        w = free[..., 1]
        loss = np.hypot(self.compliance * v, self.turn_compliance * w)
        loaded_v = v - self._tractions[0] * loss
        return np.stack(np.broadcast_arrays(loaded_v, w), axis=-1)

    def unloaded(self, twist: ArrayLike) -> Array:
        """Twists (..., 2) without load at the sprocket speeds that produce twists `twist` (..., 2)
        under load.

        The square of v - v' = -t sqrt((C v')^2 + (S w)^2) is a quadratic equation for v', whose
        solution with this sign is

            v' = (v + sign(t) sqrt((t C v)^2 + k (t S w)^2)) / k        k = 1 - (t C)^2
        """
        twist = np.asarray(twist, float)
        v = twist[..., 0]
        w = twist[..., 1]
        along = self._tractions[0]
        k = 1 - np.square(along * self.compliance)
        root = np.hypot(along * self.compliance * v, np.sqrt(k) * along * self.turn_compliance * w)
        free_v = (v + np.sign(along) * root) / k
        return np.stack(np.broadcast_arrays(free_v, w), axis=-1)

    def sideslip(self, twist: ArrayLike) -> Array:
        """Speeds to the left (...) [m/s] at twists (..., 2)."""
        speed, yaw_rate = np.moveaxis(np.abs(np.asarray(twist, float)), -1, 0)
        yielding = self.compliance * speed + self.turn_compliance * yaw_rate
        return np.asarray(-self._tractions[1] * yielding)

    def yielding(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Velocities (..., 3) (forwards, leftwards, yaw) that load adds at sprocket speeds omega
        (..., 2) [rad/s].
        """
        twist = self.twist(omega, geometry)
        free = self.unloaded_law.twist(omega, geometry)
        forwards = twist[..., 0] - free[..., 0]
        return np.stack([forwards, self.sideslip(twist), np.zeros_like(forwards)], axis=-1)

    @property
    def _tractions(self) -> tuple[Array, Array]:
        """Tractions per unit load t and t_left, each (...) [-]."""
        load = np.asarray(self.load, float)
        return load[..., 0], load[..., 1]

    @property
    def unloaded_law(self) -> ConstantIcr:
        """The law of the robot without load."""
        return ConstantIcr(self.offset, self.half_gauge, self.radius_error)
