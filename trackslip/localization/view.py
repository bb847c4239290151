"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array
from trackslip.localization.scan import Plate

Points = NDArray[np.complex128]
"""Points or directions of the scan plane, x + iy."""

EDGE_ON = np.radians(2.0)
"""Viewing angle below which a scan determines no pose: errors of the heading are three to five times as large as the
likelihood's curvature says, because few beams graze the long face and the mirror image is nearly as likely [rad]."""
_TINY = 1e-12  # keeps a corner on the LRF from dividing by zero [m]


@dataclass(frozen=True)
class View:
    """Places of plates along and across their axes, seen from the LRF."""

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

    def silhouette(self, ahead: Points) -> Array:
        """The outermost corners, right and left, seen in the directions `ahead` (M,).

        Returns (4, 2, M): their bearings from `ahead` [rad], which thus do not wrap, and the derivatives of these with
        respect to the place along and across the plate's axes and the heading.
        """
        half = complex(self.plate.length, self.plate.thickness) / 2
        from_centre = np.array([[half], [half.conjugate()], [-half], [-half.conjugate()]])
        corners = from_centre + self.place + _TINY  # (4, M)
        bearing = np.angle(corners * (self.axis * ahead.conj()))
        outermost = np.stack([bearing.argmin(axis=0), bearing.argmax(axis=0)])  # (2, M)
        inverse = 1 / np.take_along_axis(corners, outermost, axis=0)  # a bearing is the imaginary part of the logarithm
        by_heading = inverse * from_centre[outermost, 0]
        seen = np.take_along_axis(bearing, outermost, axis=0)
        return np.stack([seen, inverse.imag, inverse.real, by_heading.real])


def viewing_angle(pose: Array) -> Array:
    """Angles (S,) between plates at poses (S, 3) in the LRF's frame and the line of sight: 0 is edge-on [rad]."""
    off = pose[:, 2] - np.arctan2(pose[:, 1], pose[:, 0])
    return np.abs((off + np.pi / 2) % np.pi - np.pi / 2)


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that turn changes of (x, y, phi) into those along and across plates of `heading` (M,)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes
