"""Derivatives of the twists of laws with respect to their parameters."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import LawFamily

_DIFFERENCE = 1e-6  # step, relative to the scales of the parameters


def twist_derivatives(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> Array:
    """Derivatives (m, n, 2, p) of the twists at sprocket speeds omega (n, 2) [rad/s] by the values (m, p) of m laws.

    They are central differences, for values at a limit just inside it, and 0 where no twist produces these speeds.
    """
    if not family.names:
        return np.empty((len(values), len(omega), 2, 0))
    low, high, scale = family.limits(geometry.half_gauge)
    step = _DIFFERENCE * scale
    inside = np.clip(values, low + step, high - step)
    pushes = np.diag(step)[:, None, None, :]  # a parameter at a time, for all laws: (p, 1, 1, p)
    ahead, behind = (
        family.law(inside[:, None, :] + sign * pushes, geometry).twist(omega, geometry) for sign in (1, -1)
    )
    derivatives = np.moveaxis(ahead - behind, 0, -1) / (2 * step)
    return np.where(np.isfinite(derivatives), derivatives, 0.0)
