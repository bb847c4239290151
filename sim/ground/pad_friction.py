"""Friction and shear modulus under each pad of a fleet, as functions of place and time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim.ground.ground import Ground
from trackslip import se2
from trackslip.kinematics import Array


class PadFriction:
    """Friction and shear modulus of N robots' grounds under their P pads."""

    def __init__(self, grounds: Sequence[Ground], pads: Array) -> None:
        """`grounds`: one for each robot; `pads`: positions (P, 2) of the pads on the robot [m]."""
        self._pads = pads
        n, changes, patches = len(grounds), max(len(g.changes) for g in grounds), max(len(g.patches) for g in grounds)
        self.varies = changes > 0 or patches > 0
        """True if the ground depends on place or time at all."""
        self._time = np.full((n, changes), np.inf)  # ascending [s]
        self._base = np.zeros((n, changes + 1, 3))  # along, across, shear
        self._corners = np.full((n, patches, 2, 2), np.nan)  # minimum, maximum; x, y [m]
        self._patch = np.zeros((n, patches, 3))
        laid = {key: _laid(ground) for key, ground in {id(g): g for g in grounds}.items()}  # each ground once
        for i, ground in enumerate(grounds):
            self._base[i] = ground.along, ground.across, ground.shear
            for j, change in enumerate(ground.changes):
                self._time[i, j] = change.time
                shear = self._base[i, j, 2] if change.shear is None else change.shear
                self._base[i, j + 1 :] = change.along, change.across, shear
            self._corners[i, : len(ground.patches)], self._patch[i, : len(ground.patches)] = laid[id(ground)]

    def surface(self, time: ArrayLike, position: Array, heading: Array) -> Array:
        """Friction along and across the tracks [-] and shear modulus [m], (N, P, 3).

        `time` since the start of the runs is one or (N,) [s]. The robots have positions (N, 2) [m] and headings (N,)
        [rad].
        """
        n = len(position)
        passed = (self._time <= np.reshape(time, (-1, 1)) + 1e-9).sum(axis=1)
        friction = np.repeat(self._base[np.arange(n), passed][:, None], len(self._pads), axis=1)
        if self._patch.shape[1] == 0:
            return friction
        place = position[:, None] + se2.rotate(heading[:, None], self._pads)  # (N, P, 2)
        low, high = np.moveaxis(self._corners[:, None], 3, 0)  # (N, 1, M, 2) each
        inside = ((place[:, :, None] >= low) & (place[:, :, None] < high)).all(axis=-1)  # (N, P, M)
        last = inside.shape[2] - 1 - np.argmax(inside[..., ::-1], axis=-1)  # of overlapping patches
        on_patch = np.take_along_axis(self._patch, last[..., None], axis=1)
        on_patch[..., 2] = np.where(np.isnan(on_patch[..., 2]), friction[..., 2], on_patch[..., 2])
        return np.where(inside.any(axis=-1)[..., None], on_patch, friction)


def _laid(ground: Ground) -> tuple[Array, Array]:
    """Corners (K, 2, 2) [m] and surface (K, 3) of a ground's patches; shear is NaN where it is the ground's."""
    corners = np.array([(patch.x, patch.y) for patch in ground.patches]).reshape(-1, 2, 2)
    surface = [(p.along, p.across, np.nan if p.shear is None else p.shear) for p in ground.patches]
    return corners.swapaxes(1, 2), np.array(surface).reshape(-1, 3)
