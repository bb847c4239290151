"""Twists that laws predict from sprocket speeds, and their derivatives by the parameters."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters
_KNOTS = 4096  # directions of motion in a table


def twists(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Twists (M, 2) at sprocket speeds (M, 2) [rad/s], and derivatives (M, 2, p) by the values (p,)."""
    if not family.names:
        return many_twists(family, values[None], omega, geometry)[0], np.zeros((*omega.shape, 0))
    low, high, scale = family.limits(geometry.half_gauge)
    step = _DIFFERENCE * scale
    inside = np.clip(values, low + step, high - step)
    beside = np.concatenate([values[None], inside + np.diag(step), inside - np.diag(step)])
    found = many_twists(family, beside, omega, geometry)
    p = len(values)
    slope = np.moveaxis(found[1 : p + 1] - found[p + 1 :], 0, -1) / (2 * step)
    return found[0], slope


def many_twists(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> Array:
    """Twists (n, M, 2) at sprocket speeds (M, 2) [rad/s] of the laws with values (n, p)."""
    laws = family.law(values[:, None, :], geometry)
    if type(laws).twist is SlipLaw.twist and type(laws).slip is SlipLaw.slip:
        return _by_table(laws, len(values), omega, geometry)
    return np.broadcast_to(laws.twist(omega, geometry), (len(values), *omega.shape))


def _by_table(laws: SlipLaw, count: int, omega: Array, geometry: RobotGeometry) -> Array:
    """Twists (n, M, 2) of n laws by inverting a table of the sprocket speeds that they demand.

    Slip depends on curvature alone, so that the direction of (v, b w) decides on the direction of the commanded motion and
    on the ratio of their sizes. Where a law jumps, as between left and right turns in place, or is not unique, the table
    takes the direction reached first.
    """
    b = geometry.half_gauge
    direction = np.linspace(-np.pi, np.pi, _KNOTS + 1)
    unit = np.stack([np.cos(direction), np.sin(direction) / b], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        demanded = _plane(body_twist(laws.sprocket_speeds(unit, geometry), 0.0, geometry), b)
    demanded = np.broadcast_to(demanded, (count, _KNOTS + 1))
    commanded = _plane(body_twist(omega, 0.0, geometry), b)
    size, angle = np.abs(commanded), np.angle(commanded)
    found = np.empty((count, len(omega), 2))
    for k, row in enumerate(np.nan_to_num(demanded, nan=1e9, posinf=1e9, neginf=-1e9)):
        reached = np.maximum.accumulate(np.unwrap(np.angle(row)))
        at = (angle - reached[0]) % (2 * np.pi) + reached[0]
        moved = np.interp(at, reached, direction)
        ratio = size * np.interp(at, reached, 1 / np.maximum(np.abs(row), 1e-9))
        found[k] = np.stack([ratio * np.cos(moved), ratio * np.sin(moved) / b], axis=-1)
    return found


def _plane(twist: Array, half_gauge: float) -> np.ndarray:
    """v + i b w (...), complex [m/s], of twists (..., 2)."""
    return twist[..., 0] + 1j * half_gauge * twist[..., 1]
