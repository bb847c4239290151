"""Derivatives of the twists of laws with respect to their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters and to the twist


def parameter_derivatives(law: SlipLaw, steps: Mapping[str, float], omega: Array, geometry: RobotGeometry) -> Array:
    """Derivatives (..., 2, p) of twists at sprocket speeds omega (..., 2) [rad/s], by central differences.

    `steps` are the sizes of the differences, by name of the p parameters, whose shapes (...) may be those of many laws.
    """

    def pushed(name: str, step: float) -> Array:
        return replace(law, **{name: getattr(law, name) + step}).twist(omega, geometry)  # type: ignore[type-var]

    derivatives = [(pushed(name, step) - pushed(name, -step)) / (2 * step) for name, step in steps.items()]
    return np.stack(derivatives, axis=-1)


def twist_derivatives(
    family: LawFamily, values: Array, omega: Array, geometry: RobotGeometry, twist: Array | None = None
) -> Array:
    """Derivatives (m, n, 2, p) of the twists at sprocket speeds omega (n, 2) [rad/s] by the values (m, p) of m laws.

    For values at a limit, they are taken just inside it. They are 0 where no twist produces these speeds. `twist`
    (m, n, 2) saves computing the twists again.
    """
    if not family.names:
        return np.empty((len(values), len(omega), 2, 0))
    low, high, scale = family.limits(geometry.half_gauge)
    step = _DIFFERENCE * scale
    inside = np.clip(values, low + step, high - step)
    law = family.law(inside[:, None, :], geometry)
    pushes = np.diag(step)[:, None, None, :]  # a parameter at a time, for all laws: (p, 1, 1, p)
    ahead, behind = (family.law(inside[:, None, :] + sign * pushes, geometry) for sign in (1, -1))
    if law.closed_form:
        change = ahead.twist(omega, geometry) - behind.twist(omega, geometry)  # (p, m, n, 2)
        derivatives = np.moveaxis(change, 0, -1) / (2 * step)
    else:
        twist = law.twist(omega, geometry) if twist is None else twist
        derivatives = _implicit_derivatives(law, ahead, step, twist, geometry)
        jumps, _ = law.turns_in_place(omega, geometry)
        if jumps.any():
            high_end, low_end = (each.turns_in_place(omega, geometry)[1] for each in (ahead, behind))
            change = np.moveaxis(high_end - low_end, 0, -1) / (2 * step * geometry.half_gauge)  # (m, n, p) of w
            derivatives[jumps] = 0.0
            derivatives[jumps, 1, :] = change[jumps]
    return np.where(np.isfinite(derivatives), derivatives, 0.0)


def _implicit_derivatives(law: SlipLaw, ahead: SlipLaw, step: Array, twist: Array, geometry: RobotGeometry) -> Array:
    """Derivatives (m, n, 2, p) by the implicit function theorem, as the sprocket speeds at the twists don't change.

    `ahead` is the law with each of its p parameters a step (p,) larger. It takes one evaluation of the sprocket speeds
    per difference, where a twist without closed form takes many.
    """
    size = _DIFFERENCE * np.maximum(np.abs(twist[..., :1]), geometry.half_gauge * np.abs(twist[..., 1:]))  # (m, n, 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        here = law.sprocket_speeds(twist, geometry)
        by_values = np.moveaxis(ahead.sprocket_speeds(twist, geometry) - here, 0, -1) / step
        pushes = [size * unit for unit in ([1.0, 0.0], [0.0, 1.0 / geometry.half_gauge])]
        by_v, by_w = (
            (law.sprocket_speeds(twist + push, geometry) - here) / push.max(axis=-1, keepdims=True) for push in pushes
        )
        (a, c), (b, d) = (np.moveaxis(each, -1, 0)[..., None] for each in (by_v, by_w))
        x, y = by_values[..., 0, :], by_values[..., 1, :]
        return -np.stack([d * x - b * y, a * y - c * x], axis=-2) / (a * d - b * c)[..., None, :]
