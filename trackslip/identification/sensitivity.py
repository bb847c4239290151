"""How the twists that a law predicts change with its parameters."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters and to the twist


def twist_slopes(
    family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry, twist: Array | None = None
) -> Array:
    """Derivatives (m, n, 2, p) of the twists at sprocket speeds omega (n, 2) by the values (m, p) of m laws.

    For values at a limit, they are taken just inside it. They are 0 where a law jumps. Known twists (m, n, 2) need not
    be computed again.
    """
    low, high, scale = family.limits(geometry.half_gauge)
    step = _DIFFERENCE * scale
    inside = np.clip(values, low + step, high - step)
    law = family.law(inside[:, None, :], geometry)
    if type(law).twist is not SlipLaw.twist:
        slopes = _by_differences(family, inside, step, omega, geometry)
    else:
        twist = law.twist(omega, geometry) if twist is None else twist
        slopes = _by_sprocket_speeds(family, inside, step, twist, geometry)
    return np.where(np.isfinite(slopes), slopes, 0.0)


def _by_differences(family: LawFamily, values: Array, step: Array, omega: Array, geometry: RobotGeometry) -> Array:
    slopes = np.empty((len(values), len(omega), 2, values.shape[1]))
    for k, only in enumerate(np.diag(step)):
        ahead, behind = (
            family.law((values + side * only)[:, None, :], geometry).twist(omega, geometry) for side in (1, -1)
        )
        slopes[..., k] = (ahead - behind) / (2 * step[k])
    return slopes


def _by_sprocket_speeds(family: LawFamily, values: Array, step: Array, twist: Array, geometry: RobotGeometry) -> Array:
    """By the theorem of implicit functions, as twists are found in many steps, but sprocket speeds in one.

    The twists solve omega(twist, values) = omega.
    """
    law = family.law(values[:, None, :], geometry)
    by_values = np.empty((*twist.shape, values.shape[1]))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        here = law.sprocket_speeds(twist, geometry)
        for k, only in enumerate(np.diag(step)):
            beside = family.law((values + only)[:, None, :], geometry)
            by_values[..., k] = (beside.sprocket_speeds(twist, geometry) - here) / step[k]
        size = _DIFFERENCE * np.maximum(np.abs(twist[..., :1]), geometry.half_gauge * np.abs(twist[..., 1:]))
        (a, c), (b, d) = (
            np.moveaxis((law.sprocket_speeds(twist + push * unit, geometry) - here) / push, -1, 0)
            for push, unit in ((size, np.array([1, 0])), (size / geometry.half_gauge, np.array([0, 1])))
        )
        inverse = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        return -inverse @ by_values / (a * d - b * c)[..., None, None]
