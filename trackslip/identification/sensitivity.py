"""How the twists that a law predicts change with its parameters."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters and to the twist


def twist_slopes(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> Array:
    """Derivatives (m, n, 2, p) of the twists at sprocket speeds omega (n, 2) by the values (m, p) of m laws.

    The twists solve omega(twist, values) = omega, so by the theorem of implicit functions they follow from those of the
    sprocket speeds, which laws give directly, whereas each twist is found in many steps. They are not finite where a law
    jumps.
    """
    _, high, scale = family.limits(geometry.half_gauge)
    law = family.law(values[:, None, :], geometry)
    twist = law.twist(omega, geometry)
    here = law.sprocket_speeds(twist, geometry)
    by_values = np.empty((*here.shape, values.shape[1]))
    steps = np.where(values + _DIFFERENCE * scale > high, -_DIFFERENCE, _DIFFERENCE) * scale  # (m, p)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for k, only in enumerate(np.eye(values.shape[1])):
            beside = family.law((values + steps * only)[:, None, :], geometry)
            by_values[..., k] = (beside.sprocket_speeds(twist, geometry) - here) / steps[:, k, None, None]
        size = _DIFFERENCE * np.maximum(np.abs(twist[..., :1]), geometry.half_gauge * np.abs(twist[..., 1:]))
        (a, c), (b, d) = (
            np.moveaxis((law.sprocket_speeds(twist + push * unit, geometry) - here) / push, -1, 0)
            for push, unit in ((size, np.array([1, 0])), (size / geometry.half_gauge, np.array([0, 1])))
        )
        inverse = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        return -inverse @ by_values / (a * d - b * c)[..., None, None]
