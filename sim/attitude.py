"""Attitudes of bodies, from their quaternions (..., 4): w, x, y, z."""

import numpy as np

from trackslip.kinematics import Array, columns


def rotation(quaternion: Array) -> Array:
    """Axes of the bodies in the world: forwards, to the left and up are the columns of matrices (..., 3, 3)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def heading(quaternion: Array) -> Array:
    """Headings (...), from -pi to pi [rad]."""
    w, x, y, z = columns(quaternion)
    return np.reshape(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), quaternion.shape[:-1])


def upright(quaternion: Array) -> Array:
    """Cosines (...) of the angles between the bodies' and the world's vertical."""
    _, x, y, _ = columns(quaternion)
    return np.reshape(1 - 2 * (x * x + y * y), quaternion.shape[:-1])


def roll(quaternion: Array) -> Array:
    """Angles (...) by which the bodies lean to their right [rad]."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    return np.asarray(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))


def pitch(quaternion: Array) -> Array:
    """Angles (...) by which the bodies point upwards [rad]."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    return np.asarray(np.arcsin(np.clip(2 * (x * z - w * y), -1.0, 1.0)))
