"""Controllers linearised about the body-frame error."""

import numpy as np

from trackslip.controllers.base import Controller
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


def pose_with_error(desired: Array, error: Array) -> Array:
    """The poses (..., 3) whose body-frame errors about `desired` (..., 3) are `error` (..., 3)."""
    ahead, left, turn = np.moveaxis(error, -1, 0)
    phi = desired[..., 2] - turn
    cos = np.cos(phi)
    sin = np.sin(phi)
    x = desired[..., 0] - (cos * ahead - sin * left)
    y = desired[..., 1] - (sin * ahead + cos * left)
    return np.stack([x, y, phi], axis=-1)


def error_gains(
    controller: Controller, time: float, reference: Reference, h: float = 1e-6
) -> Array:
    """Derivative (2, 3) of the twist by the body-frame error, at no error, by central
    differences.
    """
    desired = reference.pose(time)

    def twist_with(error: Array) -> Array:
        controller.reset()
        return controller.twist(time, pose_with_error(desired, error), reference)

    columns = []
    for direction in np.eye(3):
        ahead = twist_with(1.0 * h * direction)
        behind = twist_with(-1.0 * h * direction)
        columns.append((ahead - behind) / (2 * h))
    return np.stack(columns, axis=-1)


def closed_loop(gains: Array, twist: Array) -> Array:
    """Matrix (3, 3) of the error's linearised motion (Eq. 20) under gains (2, 3), at a reference
    twist (2,).
    """
    v, w = twist
    motion = np.array([[0, w, 0], [-w, 0, v], [0, 0, 0]])
    motion[0] -= gains[0]
    motion[2] -= gains[1]
    return motion
