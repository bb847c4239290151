"""How fast to drive: the longitudinal law that several controllers share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array


def natural_frequency(twist: ArrayLike, stiffness: float) -> Array:
    """a = sqrt(w_d^2 + g v_d^2) [rad/s] (...) of reference twists (..., 2), g in [1/m^2]; Eqs. 28-30.

    Gains in proportion to it let errors die out over a distance rather than over a time: none at standstill.
    """
    v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
    return np.sqrt(w**2 + stiffness * v**2)


def speed_towards(desired: ArrayLike, errors: ArrayLike, gain: ArrayLike) -> Array:
    """v = v_d cos(e_phi) + k e_x [m/s] (...), of reference twists (..., 2), body errors (..., 3) and k [1/s]."""
    errors = np.asarray(errors, float)
    return np.asarray(desired, float)[..., 0] * np.cos(errors[..., 2]) + gain * errors[..., 0]


def speed_to_keep_up(desired: ArrayLike, errors: ArrayLike, gain: ArrayLike) -> Array:
    """v_d + k times the error along the reference's path [m/s] (...), but 0 rather than against v_d; as above.

    For laws that steer by a point ahead. Driven away from that point they would be unstable, so the robot waits for a
    reference that is behind it; and they have to drive on to turn round, so the speed must not fall with the robot's
    own heading. To first order this is `speed_towards`.
    """
    v_d = np.asarray(desired, float)[..., 0]
    e_x, e_y, e_phi = np.moveaxis(np.asarray(errors, float), -1, 0)
    direction = np.sign(v_d)
    return direction * np.maximum(direction * (v_d + gain * (np.cos(e_phi) * e_x + np.sin(e_phi) * e_y)), 0.0)
