"""Steady twists and turns of a tracked robot on Coulomb ground or on ground that shears."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require, require_non_negative, require_positive
from trackslip.kinematics import TRACK_SIGNS, Array
from trackslip.skid_theory.contact import Contact, Load, balance, least_power

_INERTIA_ITERATIONS: Final = 6
_TURN_ITERATIONS: Final = 60
_TURN_TOLERANCE: Final = 1e-7  # relative tolerance for v and w
_UNLOADED: Final = Load()


def steady_twist(
    surface_speeds: ArrayLike,
    contact: Contact,
    gravity: float = np.inf,
    shear: float = 0.0,
    load: Load = _UNLOADED,
) -> Array:
    """Twists (..., 3), v, lateral u and w, at surface speeds of the tracks (..., 2) [m/s].

    With a finite `gravity` [m/s^2] the ground also provides the centripetal force, which shifts
    load to the outer track; both follow from fixed-point iteration. By default inertia is
    neglected, and slip does not depend on speed. `shear` is the modulus K of ground that shears
    [m], or 0 for Coulomb ground. Where uphill is to the side of a turning robot, the twist is
    momentary. Raises InvalidValueError for speeds that are not finite or too fast for a turn, and
    for a load that the ground does not carry.
    """
    speeds = np.asarray(surface_speeds, float)
    require(np.isfinite(speeds).all(), "surface_speeds", surface_speeds, "finite")
    require_positive("gravity", 1.0 if gravity == np.inf else gravity)
    require_non_negative("shear", shear)
    _require_carried(load, contact)
    shape = speeds.shape[:-1]
    speeds = speeds.reshape(-1, 2)
    twist = np.zeros((len(speeds), 3))
    is_moving = np.abs(speeds).max(axis=1) > 0
    iterations = 1 if gravity == np.inf else _INERTIA_ITERATIONS
    if is_moving.any():
        for _ in range(iterations):
            acceleration = _acceleration(twist[is_moving], contact) / gravity
            twist[is_moving] = _balanced(speeds[is_moving], contact, acceleration, shear, load)
    return twist.reshape(*shape, 3)


@dataclass(frozen=True)
class SteadyTurns:
    """M steady turns to the left, with one radius each."""

    radius: Array  # (M,) driven radius [m]
    belts: Array  # (M, 2) belt speeds divided by the yaw rate [m]
    half_gauge: float  # half the distance between the tracks [m]

    @property
    def slip(self) -> Array:
        """Slips (M, 2) of the (left, right) tracks, i = 1 - V / r omega [-]."""
        over_ground = self.radius[:, None] + self.half_gauge * TRACK_SIGNS  # V / w
        return 1 - over_ground / self.belts

    @property
    def icr(self) -> Array:
        """Distances (M, 2) of the (left, right) tracks' ICRs to the left of the centre line [m]."""
        return self.radius[:, None] - self.belts

    @property
    def offset(self) -> Array:
        """Mean distances D (M,) of the ICRs outside the tracks [m]."""
        return (self.belts[:, 1] - self.belts[:, 0]) / 2 - self.half_gauge

    @property
    def loss(self) -> Array:
        """Share (M,) of the belts' mean speed that is lost in the turn [-]."""
        return 1 - self.radius / self.belts.mean(axis=1)


def steady_turns(
    radius: ArrayLike, contact: Contact, shear: float = 0.0, load: Load = _UNLOADED
) -> SteadyTurns:
    """Compute turns to the left with driven radii (M,) [m].

    The other arguments are those of `steady_twist`. At the yaw rate 1 rad/s the speed is the
    radius; from turns without slip, the belts' mean is scaled until that speed results, and their
    difference until that yaw rate does. Raises InvalidValueError for a load that the ground does
    not carry, and for a radius that no belt speeds achieve.
    """
    radius = np.asarray(radius, float)
    half_gauge = float(np.abs(contact.y).mean())
    belts = radius[:, None] + half_gauge * TRACK_SIGNS
    for _ in range(_TURN_ITERATIONS):
        v, _, w = steady_twist(belts, contact, shear=shear, load=load).T
        if not ((v > 0) & (w > 0)).all():
            break
        mean = belts.mean(axis=1)
        half_difference = (belts[:, 1] - belts[:, 0]) / 2
        speed_factor = radius / v
        yaw_factor = 1 / w
        scaled_mean = speed_factor * mean
        scaled_difference = yaw_factor * half_difference
        belts = scaled_mean[:, None] + scaled_difference[:, None] * TRACK_SIGNS
        error = max(np.abs(speed_factor - 1).max(), np.abs(yaw_factor - 1).max())
        if error < _TURN_TOLERANCE:
            return SteadyTurns(radius, belts, half_gauge)
    raise InvalidValueError(
        "radius", radius.tolist(), "radii that the robot can drive under its load"
    )


def _require_carried(load: Load, contact: Contact) -> None:
    """Raise InvalidValueError unless friction carries the load and no point of a track lifts."""
    value = f"slope {load.slope:.3g} rad, pull {load.pull:.3g} of the weight"
    along, across = load.downhill + np.array([load.drawbar, 0.0])
    utilisation = np.hypot(along / contact.along, across / contact.across)
    require(utilisation < 1, "load", value, "less than the friction limit")
    loads = contact.loads(load.downhill, load.hitch_height * load.drawbar)
    lifts_a_point = loads.min() < 0
    require(not lifts_a_point, "load", value, "less: it lifts part of a track")


def _acceleration(twist: Array, contact: Contact) -> Array:
    """Accelerations (M, 2) of the centre of mass along and across in steady turns [m/s^2].

    The velocity (v - w left, u + w forwards) of the centre of mass turns at the rate w.
    """
    v, u, w = twist.T
    forwards, left, _ = contact.centre_of_mass
    along = -w * (u + w * forwards)
    across = w * (v - w * left)
    return np.stack([along, across], axis=1)


def _balanced(
    speeds: Array, contact: Contact, acceleration: Array, shear: float, load: Load
) -> Array:
    """Twists (M, 3) at which the ground balances the load and accelerates the robot.

    `speeds` (M, 2) are those of the tracks [m/s], accelerations (M, 2) are in units of gravity.
    """
    # forces and moments that the ground has to exert, per normal force
    forwards, left, _ = contact.centre_of_mass
    carried = acceleration / np.cos(load.slope) + load.downhill
    moment = forwards * carried[:, 1] - left * carried[:, 0]
    required = np.column_stack([carried, moment]) + np.array([load.drawbar, 0.0, 0.0])
    utilisation = np.hypot(required[:, 0] / contact.along, required[:, 1] / contact.across)
    is_held = utilisation < 1
    if not is_held.all():
        too_fast = speeds[np.argmin(is_held)].tolist()
        allowed = "slower, or straighter: friction doesn't hold the robot on its turn"
        raise InvalidValueError("surface_speeds", too_fast, allowed)

    # twists at belt speeds of order one, then scaled: forces depend only on directions of sliding
    loads = contact.loads(carried, load.hitch_height * load.drawbar)
    scale = np.abs(speeds).max(axis=1, keepdims=True)
    relative = speeds / scale
    belt = np.where(contact.y > 0, relative[:, :1], relative[:, 1:])  # (M, K)
    twist = least_power(belt, contact, loads, required)
    if shear > 0:
        twist = balance(belt, contact, loads, required, shear, twist)
    return twist * scale
