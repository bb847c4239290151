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
    p = len(values)
    laws = _laws(family, beside, geometry)
    found = _table(laws, len(beside), geometry) if _by_direction(laws) else laws.twist(omega, geometry)
    both = np.concatenate([found[:1], (found[1 : p + 1] - found[p + 1 :]) / (2 * step[:, None, None])])
    both = np.moveaxis(both, 0, -1)
    if _by_direction(laws):
        both = _interpolated(both, omega, geometry)
    return both[..., 0], both[..., 1:]


def many_twists(family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry) -> Array:
    """Twists (n, M, 2) at sprocket speeds (M, 2) [rad/s] of the laws with values (n, p)."""
    laws = _laws(family, values, geometry)
    if _by_direction(laws):
        table = np.moveaxis(_table(laws, len(values), geometry), 0, -1)
        return np.moveaxis(_interpolated(table, omega, geometry), -1, 0)
    return np.broadcast_to(laws.twist(omega, geometry), (len(values), *omega.shape))


def _laws(family: LawFamily, values: Array, geometry: RobotGeometry) -> SlipLaw:
    return family.law(values[:, None, :], geometry)


def _by_direction(laws: SlipLaw) -> bool:
    """Whether the twist is a function of the commanded direction, times the speed, without a closed form."""
    return type(laws).twist is SlipLaw.twist and type(laws).slip is SlipLaw.slip


def _table(laws: SlipLaw, count: int, geometry: RobotGeometry) -> Array:
    """Twists (n, _KNOTS + 1, 2) of n laws at commanded motions (v, b w) of size 1 and directions from -pi to pi.

    The inverse of a table of the commanded motions that directions of the real one demand. Where a law jumps, as
    between left and right turns in place, or is not unique, it takes the direction reached first.
    """
    b = geometry.half_gauge
    direction = np.linspace(-np.pi, np.pi, _KNOTS + 1)
    unit = np.stack([np.cos(direction), np.sin(direction) / b], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        demanded = _plane(body_twist(laws.sprocket_speeds(unit, geometry), 0.0, geometry), b)
    demanded = np.nan_to_num(np.broadcast_to(demanded, (count, _KNOTS + 1)), nan=1e9, posinf=1e9, neginf=-1e9)
    found = np.empty((count, _KNOTS + 1, 2))
    for k, row in enumerate(demanded):
        reached = np.maximum.accumulate(np.unwrap(np.angle(row)))
        at = (direction - reached[0]) % (2 * np.pi) + reached[0]
        moved = np.interp(at, reached, direction)
        ratio = np.interp(at, reached, 1 / np.maximum(np.abs(row), 1e-9))
        found[k] = np.stack([ratio * np.cos(moved), ratio * np.sin(moved) / b], axis=-1)
    return found


def _interpolated(table: Array, omega: Array, geometry: RobotGeometry) -> Array:
    """Values (M, 2, n) of a table (_KNOTS + 1, 2, n) at sprocket speeds (M, 2) [rad/s], times the commanded size."""
    commanded = _plane(body_twist(omega, 0.0, geometry), geometry.half_gauge)
    at = (np.angle(commanded) + np.pi) * (_KNOTS / (2 * np.pi))
    knot = np.clip(at.astype(int), 0, _KNOTS - 1)
    share = (at - knot)[:, None, None]
    found = (1 - share) * table[knot] + share * table[knot + 1]
    return np.asarray(np.abs(commanded)[:, None, None] * found)


def _plane(twist: Array, half_gauge: float) -> np.ndarray:
    """v + i b w (...), complex [m/s], of twists (..., 2)."""
    return twist[..., 0] + 1j * half_gauge * twist[..., 1]
