"""Plates as the LRF sees them, in their own axes."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import Plate

_TINY = 1e-12  # keeps a corner on the LRF from dividing by zero [m]


@dataclass(frozen=True)
class View(Rows):
    """Where plates are along and across their own axes, seen from the LRF."""

    plate: Plate
    along: Array  # (M,) coordinates of the centre [m]
    across: Array  # (M,)
    turn: np.ndarray  # (M,) complex unit vectors along the long axes, in the LRF's frame

    @classmethod
    def of(cls, plate: Plate, pose: Array) -> View:
        """Of plates at poses (M, 3) in the LRF's frame."""
        turn = np.exp(1j * pose[:, 2])
        centre = (pose[:, 0] + 1j * pose[:, 1]) * turn.conj()
        return cls(plate, centre.real, centre.imag, turn)

    def slid(self, offset: Array) -> View:
        """Of plates slid along themselves by `offset` (M, K) [m]: (M * K,)."""
        every = np.repeat(np.arange(len(self.along)), offset.shape[1])
        return View(self.plate, (self.along[:, None] + offset).ravel(), self.across[every], self.turn[every])

    def silhouette(self, ahead: np.ndarray) -> tuple[Array, Array]:
        """The outermost corners, right and left, seen in the directions `ahead` (M,), complex.

        Returns their bearings from `ahead` (M, 2) [rad], which thus do not wrap, and the derivatives (M, 2, 3) of these
        with respect to the place along and across the plate's axes and the heading.
        """
        half_length, half_thickness = self.plate.length / 2, self.plate.thickness / 2
        beyond = (self.along > -half_length).astype(int) + (self.along > half_length)
        beside = (self.across > -half_thickness).astype(int) + (self.across > half_thickness)
        offset = _outermost(self.plate)[beyond, beside]  # (M, 2)
        corner = offset + (self.along + (1j * self.across + _TINY))[:, None]
        seen = corner * (self.turn * ahead.conj())[:, None]
        inverse = 1 / corner
        jacobian = np.empty((*corner.shape, 3))
        jacobian[:, :, 0], jacobian[:, :, 1], jacobian[:, :, 2] = inverse.imag, inverse.real, (offset * inverse).real
        return np.arctan2(seen.imag, seen.real), jacobian


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that turn changes of (x, y, phi) into those along and across plates of `heading` (M,)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes


@functools.lru_cache(maxsize=64)
def _outermost(plate: Plate) -> np.ndarray:
    """The outermost corners (3, 3, 2), right and left, complex, less the centre [m].

    The first two axes tell whether the centre is behind, within or ahead of the LRF along and across the plate: by more
    than half its length or thickness, or not. A plate with the LRF inside has none, whatever the table says.
    """
    corners = np.array([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j])
    corners = corners.real * plate.length / 2 + 1j * corners.imag * plate.thickness / 2
    table = np.empty((3, 3, 2), complex)
    for i in range(3):
        for k in range(3):
            centre = (i - 1) * plate.length + 1j * (k - 1) * plate.thickness
            bearing = np.angle((corners + centre) / (centre or 1))
            table[i, k] = corners[bearing.argmin()], corners[bearing.argmax()]
    return table
