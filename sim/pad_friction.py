"""Friction under each pad of a fleet, as its ground has it at a place and a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.ground import Ground
from trackslip.kinematics import Array


class PadFriction:
    """Friction of N robots' grounds under their P pads."""

    def __init__(self, grounds: Sequence[Ground], pads: Array) -> None:
        """`grounds`: one for each robot; `pads`: where the pads are on the robot, (P, 2) [m]."""
        self._pads = pads
        n, changes, patches = (
            len(grounds),
            max(len(g.changes) for g in grounds),
            max(len(g.patches) for g in grounds),
        )
        self.varies = changes > 0 or patches > 0
        """Whether it depends on place or time at all."""
        self._time = np.full((n, changes), np.inf)  # ascending
        self._base = np.zeros((n, changes + 1, 2))
        self._corners = np.full((n, patches, 2, 2), np.nan)  # least, greatest; x, y
        self._patch = np.zeros((n, patches, 2))
        for i, ground in enumerate(grounds):
            self._base[i] = ground.along, ground.across
            for j, change in enumerate(ground.changes):
                self._time[i, j] = change.time
                self._base[i, j + 1 :] = change.along, change.across
            for j, patch in enumerate(ground.patches):
                self._corners[i, j] = np.transpose([patch.x, patch.y])
                self._patch[i, j] = patch.along, patch.across

    def at(self, time: float, position: Array, heading: Array) -> Array:
        """Friction (N, P, 2) along and across, at a time [s], of robots at positions (N, 2) [m] and headings (N,)."""
        n = len(position)
        passed = (self._time <= time + 1e-9).sum(axis=1)
        friction = np.repeat(self._base[np.arange(n), passed][:, None], len(self._pads), axis=1)
        if self._patch.shape[1] == 0:
            return friction
        cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
        x, y = self._pads.T
        place = position[:, None] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)  # (N, P, 2)
        for low, high, patch in zip(
            *np.moveaxis(self._corners, (2, 1), (0, 1)), np.moveaxis(self._patch, 1, 0), strict=True
        ):
            inside = ((place >= low[:, None]) & (place < high[:, None])).all(axis=-1)  # (N, P)
            friction = np.where(inside[..., None], patch[:, None], friction)
        return friction
