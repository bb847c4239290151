"""Twists that a family of laws predicts from sprocket speeds, and their derivatives by the parameters."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters
_KNOTS = 2048  # directions of the sprocket speeds in a table


def twists(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Twists (M, 2) at sprocket speeds (M, 2) [rad/s], and derivatives (M, 2, p) by the values (p,)."""
    if not family.names:
        return family.law(values, geometry).twist(omega, geometry), np.zeros((*omega.shape, 0))
    low, high, scale = family.limits(geometry.half_gauge)
    step = _DIFFERENCE * scale
    inside = np.clip(values, low + step, high - step)
    beside = np.concatenate([values[None], inside + np.diag(step), inside - np.diag(step)])
    laws = family.law(beside[:, None, :], geometry)
    if type(laws).twist is SlipLaw.twist and type(laws).slip is SlipLaw.slip:
        found = _by_table(laws, omega, geometry)
    else:
        found = laws.twist(omega, geometry)
    p = len(values)
    slope = np.moveaxis(found[1 : p + 1] - found[p + 1 :], 0, -1) / (2 * step)
    return found[0], slope


def _by_table(laws: SlipLaw, omega: Array, geometry: RobotGeometry) -> Array:
    """Twists (n, M, 2) of n laws whose twist is proportional to the sprocket speeds, interpolated by direction.

    The direction of (omega_l, omega_r) alone decides on the curvature, and a table of it is much shorter than a log.
    """
    direction = np.linspace(-np.pi, np.pi, _KNOTS + 1)
    table = laws.twist(np.stack([np.cos(direction), np.sin(direction)], axis=-1), geometry)  # (n, knots, 2)
    at = (np.arctan2(omega[:, 1], omega[:, 0]) + np.pi) * (_KNOTS / (2 * np.pi))
    knot = np.minimum(at.astype(int), _KNOTS - 1)
    share = (at - knot)[:, None]
    size = np.hypot(*omega.T)[:, None]
    return size * ((1 - share) * table[:, knot] + share * table[:, knot + 1])
