"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Plate

_ENDS = np.array([-0.5, 0.5])  # of a side from its middle [its length]
_TINY = 1e-12  # keeps a corner on the LRF from dividing by zero [m]


@dataclass(frozen=True)
class View:
    """Where plates are along and across their own axes, seen from the LRF: one for each scan, or K, see `slid`."""

    plate: Plate
    along: Array  # (M,) coordinates of the centre [m]
    across: Array  # (M,)
    cos: Array  # (M,) of the heading
    sin: Array  # (M,)

    @classmethod
    def of(cls, plate: Plate, pose: Array) -> View:
        """Of plates at poses (M, 3) in the LRF's frame."""
        x, y = pose[:, 0], pose[:, 1]
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        return cls(plate, cos * x + sin * y, cos * y - sin * x, cos, sin)

    def slid(self, offset: Array, sideways: bool = False) -> View:
        """Of plates slid along themselves, or sideways, by `offset` (M, K) [m]: arrays (M, K), or (M, 1) if equal."""
        along, across = self.along[:, None], self.across[:, None]
        along, across = (along, across + offset) if sideways else (along + offset, across)
        return View(self.plate, along, across, self.cos[:, None], self.sin[:, None])

    def corners(self) -> Array:
        """Coordinates (2, 2, M, ...) of the outermost corners, right and left, less those of the centres [m]."""
        along, across, corners = _outermost(self.plate)
        return corners.take(3 * along.searchsorted(self.along) + across.searchsorted(self.across), axis=2)

    def silhouette(self, ahead: Array) -> Array:
        """The outermost corners, right and left, seen in the directions `ahead` (M, 2).

        Returns (4, 2, M): their bearings from `ahead` [rad], which thus do not wrap, and the derivatives of these with
        respect to the place along and across the plate's axes and the heading.
        """
        o_x, o_y = self.corners()
        x, y = o_x + self.along, o_y + (self.across + _TINY)
        seen = np.empty((4, *x.shape))
        self._bearings(x, y, ahead, seen[0])
        np.negative(y, out=seen[1])
        seen[2] = x
        np.add(o_x * x, o_y * y, out=seen[3])
        seen[1:] /= x * x + y * y
        return seen

    def bearings(self, ahead: Array) -> Array:
        """The bearings (2, M) or (2, M, K) alone."""
        o_x, o_y = self.corners()
        bearings = np.empty(o_x.shape)
        self._bearings(o_x + self.along, o_y + (self.across + _TINY), ahead, bearings)
        return bearings

    def _bearings(self, x: Array, y: Array, ahead: Array, out: Array) -> None:
        """Write the bearings (2, M, ...) of corners at (x, y), as many each, from `ahead` (M, 2)."""
        ahead_x, ahead_y = ahead.T.reshape(2, *self.cos.shape)
        cos, sin = self.cos * ahead_x + self.sin * ahead_y, self.sin * ahead_x - self.cos * ahead_y
        np.arctan2(x * sin + y * cos, x * cos - y * sin, out=out)


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that turn changes of (x, y, phi) into those along and across plates of `heading` (M,)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes


@functools.lru_cache(maxsize=64)
def _outermost(plate: Plate) -> tuple[Array, Array, Array]:
    """Ends (2,) of the long and of the short side, and coordinates (2, 2, 9) of the outermost corners, right and left.

    Both are less those of the centre [m]. The last axis tells whether the centre is behind, within or ahead of the LRF
    along and, fastest, across the plate: by more than half its length or thickness, or not. A plate with the LRF inside
    has no such corners, whatever the table says.
    """
    corners = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * (plate.length / 2, plate.thickness / 2)
    table = np.empty((2, 2, 9))
    for k in range(9):
        x, y = (k // 3 - 1) * plate.length, (k % 3 - 1) * plate.thickness
        c_x, c_y = x + corners[:, 0], y + corners[:, 1]
        bearing = np.arctan2(x * c_y - y * c_x, x * c_x + y * c_y)
        table[:, 0, k], table[:, 1, k] = corners[bearing.argmin()], corners[bearing.argmax()]
    return _ENDS * plate.length, _ENDS * plate.thickness, table
