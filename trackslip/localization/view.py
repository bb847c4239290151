"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array
from trackslip.localization.scan import Plate

Points = NDArray[np.complex128]
"""Points or directions of the scan plane, x + iy."""

_ENDS = np.array([-0.5, 0.5])  # of a side from its middle [its length]
_TINY = 1e-12  # keeps a corner on the LRF from dividing by zero [m]


@dataclass(frozen=True)
class View:
    """Places of plates along and across their axes, seen from the LRF: one for each scan, or K (see `slid`)."""

    plate: Plate
    place: Points  # (M,) the centre, along + i across [m]
    axis: Points  # (M,) direction of the long axis in the LRF's frame

    @classmethod
    def of(cls, plate: Plate, pose: Array) -> View:
        """The view of plates at poses (M, 3) in the LRF's frame."""
        centre, axis = np.empty((2, len(pose)), complex)
        centre.real, centre.imag = pose[:, 0], pose[:, 1]
        np.cos(pose[:, 2], out=axis.real)
        np.sin(pose[:, 2], out=axis.imag)
        return cls(plate, centre * axis.conj(), axis)

    def slid(self, offset: Array) -> View:
        """The view of plates slid along themselves by `offset` (M, K) [m]: arrays (M, K), or (M, 1) if equal."""
        return View(self.plate, self.place[:, None] + offset, self.axis[:, None])

    def corners(self) -> Points:
        """The outermost corners (2, M, ...), right and left, along + i across from the centres [m]."""
        along, across, corners = _outermost(self.plate)
        place = 3 * along.searchsorted(self.place.real) + across.searchsorted(self.place.imag)
        return corners.take(place, axis=1)

    def silhouette(self, ahead: Points) -> Array:
        """The outermost corners, right and left, seen in the directions `ahead` (M,).

        Returns (4, 2, M): their bearings from `ahead` [rad], which thus do not wrap, and the derivatives of these with
        respect to the place along and across the plate's axes and the heading.
        """
        from_centre = self.corners()
        corners = from_centre + self.place
        seen = np.empty((4, *corners.shape))
        self._bearings(corners, ahead, seen[0])
        inverse = np.reciprocal(corners)  # a bearing is the imaginary part of the corner's logarithm
        seen[1], seen[2] = inverse.imag, inverse.real
        inverse *= from_centre
        seen[3] = inverse.real
        return seen

    def bearings(self, ahead: Points) -> Array:
        """The bearings (2, M) or (2, M, K) alone."""
        corners = self.corners() + self.place
        bearings = np.empty(corners.shape)
        self._bearings(corners, ahead, bearings)
        return bearings

    def _bearings(self, corners: Points, ahead: Points, out: Array) -> None:
        """Write the bearings (2, M, ...) of corners, along + i across, from `ahead` (M,)."""
        turned = corners * (self.axis * ahead.conj().reshape(self.axis.shape))
        np.arctan2(turned.imag, turned.real, out=out)


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that turn changes of (x, y, phi) into those along and across plates of `heading` (M,)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes


@functools.lru_cache(maxsize=64)
def _outermost(plate: Plate) -> tuple[Array, Array, Points]:
    """Ends (2,) of the long and of the short side, and the outermost corners (2, 9), right and left, along + i across.

    Both are seen from the centre [m]. The last axis tells whether the centre is behind, within or ahead of the LRF
    along and, fastest, across the plate: by more than half its length or thickness, or not. A plate with the LRF inside
    has no such corners, whatever the table says.
    """
    corners = np.array([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j])
    corners.real, corners.imag = corners.real * (plate.length / 2), corners.imag * (plate.thickness / 2)
    table = np.empty((2, 9), complex)
    for k in range(9):
        centre = complex((k // 3 - 1) * plate.length, (k % 3 - 1) * plate.thickness)
        bearing = np.angle((centre + corners) * np.conj(centre))
        table[:, k] = corners[bearing.argmin()], corners[bearing.argmax()]
    return _ENDS * plate.length, _ENDS * plate.thickness, table + 1j * _TINY
