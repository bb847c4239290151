"""Derivatives of the twists of laws by their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import LawFamily

_DIFFERENCE = 1e-6  # step of differences, relative to the scales of the parameters and to the twist


def parameter_slopes(law: SlipLaw, steps: Mapping[str, float], omega: Array, geometry: RobotGeometry) -> Array:
    """Derivatives (..., 2, p) of twists at sprocket speeds omega (..., 2) [rad/s], by central differences.

    `steps` are the sizes of the differences, by name of the p parameters, whose shapes (...) may be those of many laws.
    """
    values = {name: np.asarray(getattr(law, name), float) for name in steps}
    shape = np.broadcast_shapes(omega.shape[:-1], *(value.shape for value in values.values()))
    p, ones = len(steps), (1,) * len(shape)
    size = np.array(list(steps.values())).reshape(p, *ones)
    beside = np.concatenate([np.eye(p), -np.eye(p)]).reshape(2 * p, p, *ones)
    pushed = {name: value + beside[:, k] * size[k] for k, (name, value) in enumerate(values.items())}
    twist = replace(law, **pushed).twist(omega, geometry)  # type: ignore[type-var]
    ahead, behind = np.broadcast_to(twist, (2 * p, *shape, 2)).reshape(2, p, *shape, 2)
    return np.moveaxis((ahead - behind) / (2 * size[..., None]), 0, -1)


def twist_slopes(
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
    ahead, behind = (family.law(each[..., None, :], geometry) for each in _pushed(inside, step))
    if law.closed_form:
        change = ahead.twist(omega, geometry) - behind.twist(omega, geometry)  # (p, m, n, 2)
        slopes = np.moveaxis(change / (2 * step[:, None, None, None]), 0, -1)
    else:
        twist = law.twist(omega, geometry) if twist is None else twist
        slopes = _implicit_slopes(family, inside, step, twist, geometry)
        jumps, _ = law.turns_in_place(omega, geometry)
        if jumps.any():
            high_end, low_end = (each.turns_in_place(omega, geometry)[1] for each in (ahead, behind))
            change = (high_end - low_end) / (2 * step[:, None, None] * geometry.half_gauge)  # (p, m, n) of w
            slopes[jumps] = 0.0
            slopes[jumps, 1, :] = np.moveaxis(change, 0, -1)[jumps]
    return np.where(np.isfinite(slopes), slopes, 0.0)


def _pushed(values: Array, step: Array) -> Array:
    """Values (2, p, m, p), one parameter a step above and below those (m, p) of m laws."""
    return values + np.diag(step)[:, None, :] * np.array([1.0, -1.0])[:, None, None, None]


def _implicit_slopes(family: LawFamily, values: Array, step: Array, twist: Array, geometry: RobotGeometry) -> Array:
    """The same (m, n, 2, p) by the implicit function theorem, with omega(twist, values) = omega.

    It takes one evaluation of the sprocket speeds, where a twist without closed form takes many.
    """
    parameters = len(step)
    size = _DIFFERENCE * np.maximum(np.abs(twist[..., 0]), geometry.half_gauge * np.abs(twist[..., 1]))  # (m, n)
    pushes = np.stack([size, size / geometry.half_gauge])
    laws = np.tile(values, (parameters + 3, 1, 1))  # as they are, a parameter pushed, a component of the twist pushed
    twists = np.tile(twist, (parameters + 3, 1, 1, 1))
    for k in range(parameters):
        laws[1 + k, :, k] += step[k]
    for k in range(2):
        twists[1 + parameters + k, ..., k] += pushes[k]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        here, *beside = family.law(laws[:, :, None, :], geometry).sprocket_speeds(twists, geometry)
        by_values = np.stack([(each - here) / one for each, one in zip(beside, step, strict=False)], axis=-1)
        (a, c), (b, d) = (
            np.moveaxis((each - here) / push[..., None], -1, 0)
            for each, push in zip(beside[parameters:], pushes, strict=True)
        )
        x, y = by_values[..., 0, :], by_values[..., 1, :]
        scaled = np.stack([d[..., None] * x - b[..., None] * y, a[..., None] * y - c[..., None] * x], axis=-2)
        return -scaled / (a * d - b * c)[..., None, None]
