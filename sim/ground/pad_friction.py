"""Friction under each pad of a fleet, as its ground has it at a place and a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim.ground.ground import Ground
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

    def replace(self, rows: np.ndarray, grounds: Sequence[Ground]) -> None:
        """Put the robots `rows` (R,) on other grounds, one each."""
        new = PadFriction(grounds, self._pads)
        changes, patches = (
            max(mine.shape[1], others.shape[1]) for mine, others in ((self._time, new._time), (self._patch, new._patch))
        )
        self._widen(changes, patches)
        new._widen(changes, patches)
        for mine, others in zip(self._tables(), new._tables(), strict=True):
            mine[rows] = others
        self.varies = bool(np.isfinite(self._time).any() or (self._patch > 0).any())

    def _tables(self) -> tuple[Array, Array, Array, Array]:
        return self._time, self._base, self._corners, self._patch

    def _widen(self, changes: int, patches: int) -> None:
        """Make room for as many changes and patches, which never come and are nowhere."""
        later, more = changes - self._time.shape[1], patches - self._patch.shape[1]
        self._time = np.pad(self._time, ((0, 0), (0, later)), constant_values=np.inf)
        self._base = np.pad(self._base, ((0, 0), (0, later), (0, 0)), mode="edge")
        self._corners = np.pad(self._corners, ((0, 0), (0, more), (0, 0), (0, 0)), constant_values=np.nan)
        self._patch = np.pad(self._patch, ((0, 0), (0, more), (0, 0)))

    def at(self, time: ArrayLike, position: Array, heading: Array) -> Array:
        """Friction (N, P, 2) along and across of robots at positions (N, 2) [m] and headings (N,).

        `time`: since the start of their runs, one or (N,) [s].
        """
        n = len(position)
        passed = (self._time <= np.reshape(time, (-1, 1)) + 1e-9).sum(axis=1)
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
