"""The longitudinal control law shared by several controllers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array


def natural_frequency(twist: ArrayLike, stiffness: float) -> Array:
    """a = sqrt(w_d^2 + g v_d^2) [rad/s] (...) of reference twists (..., 2), g in [1/m^2]; Eqs. 28-30.

    Gains proportional to it make errors decay over a distance instead of over a time; they vanish at standstill.
    """
    v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
    return np.sqrt(w**2 + stiffness * v**2)


def speed_towards(desired: ArrayLike, errors: ArrayLike, gain: ArrayLike) -> Array:
    """v = v_d cos(e_phi) + k e_x [m/s] (...), from reference twists (..., 2), body errors (..., 3) and k [1/s]."""
    errors = np.asarray(errors, float)
    return np.asarray(desired, float)[..., 0] * np.cos(errors[..., 2]) + gain * errors[..., 0]


def speed_to_keep_up(desired: ArrayLike, errors: ArrayLike, gain: ArrayLike) -> Array:
    """v_d plus k times the error along the path [m/s] (...), or 0 if that is opposite to v_d; arguments as above.

    For laws that steer towards a point ahead. They are unstable when driven away from that point, so the robot waits
    for a reference behind it; and they have to keep driving to turn around, so the speed must not depend on the
    heading of the robot. To first order this equals `speed_towards`.
    """
    v_d = np.asarray(desired, float)[..., 0]
    e_x, e_y, e_phi = np.moveaxis(np.asarray(errors, float), -1, 0)
    direction = np.sign(v_d)
    return direction * np.maximum(direction * (v_d + gain * (np.cos(e_phi) * e_x + np.sin(e_phi) * e_y)), 0.0)
