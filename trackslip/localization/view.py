"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Plate

_TINY = 1e-12


@dataclass(frozen=True)
class View:
    """Plates whose axes are reversed, where needed, so that both point away from the LRF.

    In these axes the centre lies at (along, across), neither negative, so the faces that may point towards the LRF are
    the ones nearer to the origin.
    """

    plate: Plate
    along: Array  # (M,) coordinates of the centre, 0 or more [m]
    across: Array  # (M,)
    axes: Array  # (M, 2, 2) the plate's long and short axis in the LRF's frame
    mirrored: Array  # (M,) -1 where one axis is reversed, so that turns count the other way, else 1

    @classmethod
    def of(cls, plate: Plate, pose: Array) -> View:
        """Of plates at poses (M, 3) in the LRF's frame."""
        x, y, phi = pose[:, 0], pose[:, 1], pose[:, 2]
        cos, sin = np.cos(phi), np.sin(phi)
        along, across = cos * x + sin * y, cos * y - sin * x
        ahead, aside = np.copysign(1.0, along), np.copysign(1.0, across)
        axes = np.empty((len(pose), 2, 2))
        axes[:, 0, 0], axes[:, 0, 1] = ahead * cos, ahead * sin
        axes[:, 1, 0], axes[:, 1, 1] = -aside * sin, aside * cos
        return cls(plate, np.abs(along), np.abs(across), axes, ahead * aside)

    @property
    def depths(self) -> tuple[Array, Array]:
        """Distances (M,) of the planes of the short and of the long face, 0 where the face points away [m]."""
        return (
            np.maximum(self.along - self.plate.length / 2, 0.0),
            np.maximum(self.across - self.plate.thickness / 2, 0.0),
        )

    def silhouette(self, ahead: Array) -> tuple[Array, Array]:
        """The outermost corners, right and left, seen in the directions `ahead` (M, 2).

        Returns their bearings from `ahead` (M, 2) [rad], which thus do not wrap, and the derivatives (M, 2, 3) of these
        with respect to (x, y, phi).
        """
        half_length, half_thickness = self.plate.length / 2, self.plate.thickness / 2
        beside, before = self.across > half_thickness, self.along > half_length
        # towards the long axis the far end is the outermost unless the LRF lies within the plate's thickness
        offset = np.empty((len(self.along), 2, 2))  # of the (right, left) corner from the centre along (long, short)
        offset[:, 0, 0] = np.where(beside, half_length, -half_length)
        offset[:, 0, 1] = -half_thickness
        offset[:, 1, 0] = -half_length
        offset[:, 1, 1] = np.where(before, half_thickness, -half_thickness)
        reversed_ = self.mirrored < 0
        if reversed_.any():
            offset[reversed_] = offset[reversed_, ::-1]
        corner = offset.copy()
        corner[:, :, 0] += self.along[:, None]
        corner[:, :, 1] += self.across[:, None]
        jacobian = np.empty((len(self.along), 2, 3))
        lever = np.sum(corner * offset, axis=2)
        corner = corner @ self.axes
        x, y = corner[:, :, 0], corner[:, :, 1]
        square = np.maximum(x * x + y * y, _TINY)
        jacobian[:, :, 0], jacobian[:, :, 1], jacobian[:, :, 2] = -y / square, x / square, lever / square
        ahead_x, ahead_y = ahead[:, :1], ahead[:, 1:]
        return np.arctan2(ahead_x * y - ahead_y * x, ahead_x * x + ahead_y * y), jacobian
