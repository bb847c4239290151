"""Controllers linearised about the body-frame error."""

import numpy as np

from trackslip.controllers.base import Controller
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


def pose_with_error(desired: Array, error: Array) -> Array:
    """The poses (..., 3) whose body-frame errors about `desired` (..., 3) are `error` (..., 3)."""
    phi = desired[..., 2] - error[..., 2]
    cos, sin = np.cos(phi), np.sin(phi)
    offset = [cos * error[..., 0] - sin * error[..., 1], sin * error[..., 0] + cos * error[..., 1]]
    return np.stack([desired[..., 0] - offset[0], desired[..., 1] - offset[1], phi], axis=-1)


def error_gains(
    controller: Controller, time: float, reference: Reference, h: float = 1e-6
) -> Array:
    """Derivative (2, 3) of the twist by the body-frame error, at no error, by central
    differences.
    """
    columns = []
    for direction in np.eye(3):
        both = []
        for sign in (1.0, -1.0):
            controller.reset()
            both.append(
                controller.twist(
                    time, pose_with_error(reference.pose(time), sign * h * direction), reference
                )
            )
        columns.append((both[0] - both[1]) / (2 * h))
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
