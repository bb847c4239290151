"""Steady twists of a tracked robot, on Coulomb ground or on ground that shears."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require_non_negative, require_positive
from trackslip.kinematics import Array
from trackslip.skid_theory.contact import Contact, Load
from trackslip.skid_theory.coulomb import minimise
from trackslip.skid_theory.shear import balance

_INERTIA_ITERATIONS = 6
_UNLOADED = Load()


def steady_twist(
    surface_speeds: ArrayLike,
    contact: Contact,
    gravity: float = np.inf,
    shear: float = 0.0,
    load: Load = _UNLOADED,
) -> Array:
    """Twists (..., 3), (v, lateral u, w) [m/s, m/s, rad/s], for track surface speeds (left, right) (..., 2) [m/s].

    With a finite `gravity` [m/s^2] the ground also provides the centripetal force, which shifts load to the outer
    track; both are found by fixed-point iteration. By default inertia is neglected and slip does not depend on speed.
    `shear` is the modulus K of ground that shears, 0 for Coulomb ground [m]. Where uphill is to the side of a turning
    robot, the twist is that of the moment.

    Raises:
        InvalidValueError: for speeds that are not finite, and a load that the ground does not carry.
    """
    speeds = np.asarray(surface_speeds, float)
    if not np.isfinite(speeds).all():
        raise InvalidValueError("surface_speeds", surface_speeds, "finite")
    require_positive("gravity", 1.0 if gravity == np.inf else gravity)
    require_non_negative("shear", shear)
    require_carried(load, contact)
    shape = speeds.shape[:-1]
    speeds = speeds.reshape(-1, 2)
    twist = np.zeros((len(speeds), 3))
    moving = np.abs(speeds).max(axis=1) > 0
    if moving.any():
        for _ in range(1 if gravity == np.inf else _INERTIA_ITERATIONS):
            acceleration = _acceleration(twist[moving], contact) / gravity
            twist[moving] = _balance(speeds[moving], contact, acceleration, shear, load)
    return twist.reshape(*shape, 3)


def require_carried(load: Load, contact: Contact) -> None:
    """Raise InvalidValueError unless friction carries a load, and the load leaves every point of the tracks loaded."""
    along, across = load.downhill + np.array([load.drawbar, 0.0])
    needed = float(np.hypot(along / contact.along, across / contact.across))
    shown = f"slope {load.slope:.3g} rad, pull {load.pull:.3g} of the weight"
    if not needed < 1:
        raise InvalidValueError("load", shown, "less than the friction limit")
    if contact.loads(load.downhill, load.hitch_height * load.drawbar).min() < 0:
        raise InvalidValueError("load", shown, "less: it lifts part of a track")


def _acceleration(twist: Array, contact: Contact) -> Array:
    """Acceleration of the centre of mass in a steady turn, along and across the robot, (M, 2) [m/s^2]."""
    v, u, w = twist.T
    forwards, left, _ = contact.centre_of_mass
    return np.stack([-w * (u + w * forwards), w * (v - w * left)], axis=1)


def _balance(speeds: Array, contact: Contact, acceleration: Array, shear: float, load: Load) -> Array:
    """Twists (M, 3) at which the forces of the ground produce accelerations (M, 2), in units of gravity."""
    scale = np.abs(speeds).max(axis=1)
    forwards, left, _ = contact.centre_of_mass
    carried = acceleration / np.cos(load.slope) + load.downhill
    moment = forwards * carried[:, 1] - left * carried[:, 0]
    required = np.column_stack([carried, moment]) + np.array([load.drawbar, 0.0, 0.0])
    loads, relative = contact.loads(carried, load.hitch_height * load.drawbar), speeds / scale[:, None]
    twist = minimise(relative, contact, loads, required)
    if shear > 0:
        twist = balance(relative, contact, loads, required, shear, twist)
    return twist * scale[:, None]
