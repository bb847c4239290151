"""What the contacts of a track say: traction, load, slip, depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SENSED_WIDTH = 14
"""Numbers that a contact sensor gives per contact: found, force 3, distance, normal 3, tangent 3, velocity 3."""
_STILL = 1e-9  # a belt slower than this stands [m/s]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """Forces and motion of T tracks in the last physics step; a batch has a leading axis (N, T)."""

    traction: Floats
    """Force of the ground along the belt, positive forwards (..., T) [N]. Times the belt's speed, it is its power."""
    load: Floats
    """Sum of the normal forces (..., T) [N]."""
    sliding: Floats
    """Speed of the belt minus the track's over the ground, averaged over the load (..., T) [m/s]; NaN in the air."""
    slip: Floats
    """1 - speed over ground / speed of the belt (..., T) [-]; NaN where nothing touches or the belt stands."""
    touching: NDArray[np.bool_]
    """Whether the track touches anything (..., T)."""
    depth: Floats
    """Largest penetration (..., T) [m]."""


def read_track(
    sensed: Floats, lateral: Floats, speed: Floats
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_], Floats]:
    """Traction, load, sliding, touching and depth (...,) of one track.

    Args:
        sensed: contacts (..., C, SENSED_WIDTH) of the track.
        lateral: the track's axis to the left in the world (..., 3).
        speed: speed of its belt (...) [m/s].
    """
    found, force, distance = sensed[..., 0] > 0, sensed[..., 1:4], sensed[..., 4]
    normal, tangent, velocity = sensed[..., 5:8], sensed[..., 8:11], sensed[..., 11:14]
    # the belt's way over a contact: square to the normal and to the wheels' axes
    ahead = np.cross(lateral[..., None, :], normal)
    size = np.linalg.norm(ahead, axis=-1)
    first = (ahead * tangent).sum(axis=-1)
    second = (ahead * np.cross(normal, tangent)).sum(axis=-1)
    scale = 1 / np.where(size > 0, size, 1.0)
    along_force = (first * force[..., 1] + second * force[..., 2]) * scale
    along_velocity = (first * velocity[..., 1] + second * velocity[..., 2]) * scale
    weight = np.where(found, np.maximum(force[..., 0], 0.0), 0.0)
    load = weight.sum(axis=-1)
    with np.errstate(invalid="ignore"):
        ground_speed = (weight * along_velocity).sum(axis=-1) / np.where(load > 0, load, np.nan)
    depth = np.where(found, np.maximum(-distance, 0.0), 0.0).max(axis=-1)
    return along_force.sum(axis=-1), load, speed - ground_speed, load > 0, depth


def slip_of(sliding: Floats, speed: Floats) -> Floats:
    """Slip (...) of belts of `speed` (...) that slide over the ground at `sliding` (...) [m/s]."""
    moving = np.abs(speed) > _STILL
    return np.divide(sliding, speed, out=np.full(np.shape(sliding), np.nan), where=moving)
