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


def read_contacts(sensed: Floats, lateral: Floats, speeds: Floats) -> Reading:
    """Reading (..., T) of tracks from what their sensors report.

    Args:
        sensed: contacts (..., T, C, SENSED_WIDTH) of the tracks.
        lateral: axes (..., T, 3) of the tracks to the left, in the world.
        speeds: speeds of the belts (..., T) [m/s].
    """
    columns = np.moveaxis(sensed, -1, 0)
    found, force, distance = columns[0] > 0, columns[1:4], columns[4]
    normal, tangent, velocity = columns[5:8], columns[8:11], columns[11:14]
    # over a contact the belt moves square to the normal and to the wheels' axes; its direction in the contact's frame:
    left = np.moveaxis(lateral[..., None, :], -1, 0)
    first, second = _triple(left, normal, tangent), -(left * tangent).sum(axis=0)
    size = np.hypot(first, second)
    size[size == 0] = 1.0
    weight = np.where(found, force[0], 0.0)
    load = _sum(weight)
    touching = load > 0
    over_ground = _sum(weight * (first * velocity[1] + second * velocity[2]) / size)
    sliding = speeds - np.divide(over_ground, load, out=np.full(load.shape, np.nan), where=touching)
    traction = _sum((first * force[1] + second * force[2]) / size)
    depth = np.maximum(-distance, 0.0).max(axis=-1)
    return Reading(traction, load, sliding, _slip(sliding, speeds), touching, depth)


def _triple(a: Floats, b: Floats, c: Floats) -> Floats:
    """Triple products a . (b x c) of vectors (3, ...)."""
    product: Floats = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return product


def _sum(values: Floats) -> Floats:
    """Sums over the last axis, one after another, so that empty slots at the end don't change a bit."""
    total: Floats = np.add.accumulate(values, axis=-1)[..., -1]
    return total


def _slip(sliding: Floats, speed: Floats) -> Floats:
    """Slip (...) of belts of `speed` (...) that slide over the ground at `sliding` (...) [m/s]."""
    moving = np.abs(speed) > _STILL
    return np.divide(sliding, speed, out=np.full(np.shape(sliding), np.nan), where=moving)
