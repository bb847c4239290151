"""Readings from the contact sensors of tracks: traction, load, slip and depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackslip.errors import TrackslipError

SENSED_WIDTH = 14
"""Number of values per contact that a sensor reports: found, force 3, distance, normal 3, tangent
3, velocity 3.
"""
_STILL = 1e-9  # a belt slower than this stands still [m/s]
_CRAWLING = 1e-3  # mean belt speed below which the slip over a period is undefined [m/s]
_COMPLETE = 0.005  # largest share of the load that contacts left out by a sensor may carry [-]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """Forces and motion of T tracks in the last physics step; for a batch with a leading axis (N,
    T).
    """

    traction: Floats
    """Force of the ground along the belt, positive forwards (..., T) [N]; times belt speed, it is
    the belt's power.
    """
    load: Floats
    """Sum of the normal forces (..., T) [N]."""
    sliding: Floats
    """Belt speed minus the track's speed over the ground, weighted by load (..., T) [m/s]; NaN in
    the air.
    """
    belt: Floats
    """Speed of the belt (..., T) [m/s]."""
    slip: Floats
    """1 - speed over ground / belt speed (..., T) [-]; NaN in the air or when the belt stands
    still.
    """
    touching: NDArray[np.bool_]
    """Mask (..., T) of the tracks that touch anything."""
    depth: Floats
    """Largest penetration depth (..., T) [m]."""
    missing: Floats
    """Largest possible share of the load (..., T) on contacts for which the sensor had no slot
    [-].
    """

    @classmethod
    def none(cls, *shape: int) -> Reading:
        """A reading of the given shape for tracks that are in the air with their belts at rest."""
        undefined = np.full(shape, np.nan)
        return cls(
            traction=np.zeros(shape),
            load=np.zeros(shape),
            sliding=undefined.copy(),
            belt=np.zeros(shape),
            slip=undefined,
            touching=np.zeros(shape, bool),
            depth=np.zeros(shape),
            missing=np.zeros(shape),
        )

    @classmethod
    def joined(cls, readings: Sequence[Reading]) -> Reading:
        """Join consecutive readings (N, steps, T) along the axis of steps."""
        joined = {}
        for name in vars(readings[0]):
            joined[name] = np.concatenate([getattr(each, name) for each in readings], axis=1)
        return cls(**joined)

    def mean(self) -> Reading:
        """Means (N, T) over the steps of a reading (N, steps, T), except maxima for depth and
        missing share.

        Mean slip is the sum of the belts' sliding over the sum of their travel in contact; NaN if
        they hardly moved.
        """
        steps = self.belt.shape[1]
        touched = np.logical_or.reduce(self.touching, axis=1)
        slid = np.where(self.touching, self.sliding, 0.0).sum(axis=1)
        driven = np.where(self.touching, self.belt, 0.0).sum(axis=1)
        sliding = np.full(slid.shape, np.nan)
        np.divide(slid, self.touching.sum(axis=1), out=sliding, where=touched)
        slip = np.full(slid.shape, np.nan)
        has_moved = np.abs(driven) > _CRAWLING * steps
        np.divide(slid, driven, out=slip, where=touched & has_moved)
        return Reading(
            traction=self.traction.mean(axis=1),
            load=self.load.mean(axis=1),
            sliding=sliding,
            belt=self.belt.mean(axis=1),
            slip=slip,
            touching=touched,
            depth=self.depth.max(axis=1),
            missing=self.missing.max(axis=1),
        )

    def __getitem__(self, rows: Any) -> Reading:
        """The reading for the simulations `rows`."""
        return Reading(**{name: values[rows] for name, values in vars(self).items()})

    def put(self, rows: Any, other: Reading) -> None:
        """Replace the reading for the simulations `rows`."""
        for name, values in vars(other).items():
            getattr(self, name)[rows] = values

    def complete(self, names: Sequence[str]) -> Reading:
        """Return this reading for tracks `names` (T,); raises TrackslipError if contacts with much
        load are missing.
        """
        if (self.missing > _COMPLETE).any():
            track = names[int(np.argmax(self.missing)) % len(names)]
            what = f"track {track} touches the terrain at more points than its sensor reports"
            raise TrackslipError(f"{what}: use a coarser height field")
        return self


def read_contacts(
    sensed: Floats, owner: NDArray[np.int_], lost: NDArray[np.int_], lateral: Floats, speeds: Floats
) -> Reading:
    """Reading (..., T) of tracks from all of their contacts.

    Args:
        sensed: reports of the contact sensors (SENSED_WIDTH, C), those of each track with the
            largest forces first.
        owner: index of each contact's track (C,) in the flattened (..., T), in ascending order.
        lost: number (..., T) of contacts with smaller forces, which the sensors don't report.
        lateral: leftward axes of the tracks (..., T, 3), in the world's frame.
        speeds: belt speeds (..., T) [m/s].
    """
    force = sensed[1:4]
    distance = sensed[4]
    normal = sensed[5:8]
    tangent = sensed[8:11]
    velocity = sensed[11:14]

    def total(values: Floats) -> Floats:
        """Sums (..., T) over contacts in their order, so that a track's sum is bitwise independent
        of other tracks.
        """
        sums = np.asarray(np.bincount(owner, values, minlength=speeds.size), float)
        return sums.reshape(speeds.shape)

    # direction of the belt's motion in the contact's frame: perpendicular to the normal and the
    # wheels' axes
    left = lateral.reshape(-1, 3)[owner].T
    first = _triple(left, normal, tangent)
    second = -(left * tangent).sum(axis=0)
    size = np.hypot(first, second)
    size[size == 0] = 1.0

    # means weighted by the load
    weight = force[0]
    load = total(weight)
    touching = load > 0
    over_ground = total(weight * (first * velocity[1] + second * velocity[2]) / size)
    mean_speed = np.full(load.shape, np.nan)
    np.divide(over_ground, load, out=mean_speed, where=touching)
    sliding = speeds - mean_speed
    traction = total((first * force[1] + second * force[2]) / size)
    slip = np.full(load.shape, np.nan)
    np.divide(sliding, speeds, out=slip, where=np.abs(speeds) > _STILL)

    # each track's last contact has its smallest force, which those left out don't exceed
    depth = np.zeros(speeds.size)
    np.maximum.at(depth, owner, -distance)
    smallest = np.zeros(speeds.size)
    smallest[owner] = weight
    left_out = lost * smallest.reshape(speeds.shape)
    missing = np.zeros(load.shape)
    np.divide(left_out, load + left_out, out=missing, where=left_out > 0)
    return Reading(
        traction=traction,
        load=load,
        sliding=sliding,
        belt=speeds,
        slip=slip,
        touching=touching,
        depth=depth.reshape(speeds.shape),
        missing=missing,
    )


def _triple(a: Floats, b: Floats, c: Floats) -> Floats:
    """Triple products (C,) of vectors (3, C): a, and the cross product of b and c."""
    x = a[0] * (b[1] * c[2] - b[2] * c[1])
    y = a[1] * (b[2] * c[0] - b[0] * c[2])
    z = a[2] * (b[0] * c[1] - b[1] * c[0])
    product: Floats = x + y + z
    return product
