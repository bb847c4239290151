"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import Plate

_ENDS = np.array([-0.5, 0.5])  # of a side from its middle [its length]
_TINY = 1e-12  # keeps a corner on the LRF from dividing by zero [m]


@dataclass(frozen=True)
class View(Rows):
    """Where plates are along and across their own axes, seen from the LRF."""

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

    def slid(self, offset: Array) -> View:
        """Of plates slid along themselves by `offset` (M, K) [m]: (M * K,)."""
        every = np.repeat(np.arange(len(self.along)), offset.shape[1])
        along = (self.along[:, None] + offset).ravel()
        return View(self.plate, along, self.across[every], self.cos[every], self.sin[every])

    def corners(self) -> Array:
        """The outermost corners (M, 2, 2), right and left, along and across the plates from their centres [m]."""
        beyond = (_ENDS * self.plate.length).searchsorted(self.along)
        beside = (_ENDS * self.plate.thickness).searchsorted(self.across)
        return _outermost(self.plate)[beyond, beside]

    def silhouette(self, ahead: Array) -> tuple[Array, Array]:
        """The outermost corners, right and left, seen in the directions `ahead` (M, 2).

        Returns their bearings from `ahead` (M, 2) [rad], which thus do not wrap, and the derivatives (M, 2, 3) of these
        with respect to the place along and across the plate's axes and the heading.
        """
        offset = self.corners()
        o_x, o_y = offset[:, :, 0], offset[:, :, 1]
        x, y = o_x + self.along[:, None], o_y + (self.across + _TINY)[:, None]
        cos = (self.cos * ahead[:, 0] + self.sin * ahead[:, 1])[:, None]
        sin = (self.sin * ahead[:, 0] - self.cos * ahead[:, 1])[:, None]
        jacobian = np.empty((*x.shape, 3))
        np.negative(y, out=jacobian[:, :, 0])
        jacobian[:, :, 1] = x
        np.add(o_x * x, o_y * y, out=jacobian[:, :, 2])
        jacobian /= (x * x + y * y)[:, :, None]
        return np.arctan2(x * sin + y * cos, x * cos - y * sin), jacobian


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that turn changes of (x, y, phi) into those along and across plates of `heading` (M,)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes


@functools.lru_cache(maxsize=64)
def _outermost(plate: Plate) -> Array:
    """The outermost corners (3, 3, 2, 2), right and left, less the centre [m].

    The first two axes tell whether the centre is behind, within or ahead of the LRF along and across the plate: by more
    than half its length or thickness, or not. A plate with the LRF inside has none, whatever the table says.
    """
    corners = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * (plate.length / 2, plate.thickness / 2)
    table = np.empty((3, 3, 2, 2))
    for i in range(3):
        for k in range(3):
            x, y = (i - 1) * plate.length, (k - 1) * plate.thickness
            c_x, c_y = x + corners[:, 0], y + corners[:, 1]
            bearing = np.arctan2(x * c_y - y * c_x, x * c_x + y * c_y)
            table[i, k] = corners[bearing.argmin()], corners[bearing.argmax()]
    return table
