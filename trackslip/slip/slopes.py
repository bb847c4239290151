"""Derivatives of the twists of a law by its parameters, by differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.base import SlipLaw


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
