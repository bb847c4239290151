"""Points on a reference by distance along its path instead of by time."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, advance
from trackslip.trajectory.base import Reference

STEP = 0.01
"""Approximate time between samples of the speed of a reference [s]."""


class PathAhead:
    """The path of a reference, divided where it changes direction or stops."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        cells = max(1, round(reference.duration / STEP))
        self._times = np.linspace(0.0, reference.duration, cells + 1)  # (C + 1,)
        speeds = reference.twist((self._times[1:] + self._times[:-1]) / 2)[:, 0]
        self._distance = np.concatenate([[0.0], np.cumsum(speeds * np.diff(self._times))])  # (C + 1,)
        self._direction = np.sign(speeds)  # (C,)
        cuts = np.concatenate([np.flatnonzero(np.diff(self._direction)) + 1, [cells]])
        self._cut = cuts[np.searchsorted(cuts, np.arange(cells), side="right")]  # (C,)

    def point(self, time: float, distance: float) -> Array:
        """The pose (3,) on the path `distance` [m] beyond that at `time` [s], in the direction of travel.

        Beyond a cusp, a stop or the end, the path continues along its tangent.
        """
        now = float(np.clip(time, 0.0, self._reference.duration))
        cell = min(int(np.searchsorted(self._times, now, side="right")) - 1, len(self._direction) - 1)
        direction, cut = self._direction[cell], self._cut[cell]
        way = direction * (self._distance[cell : cut + 1] - np.interp(now, self._times, self._distance))
        then = max(now, np.interp(distance, way, self._times[cell : cut + 1])) if direction else now
        missing = direction * max(0.0, distance - way[-1])
        return advance(self._reference.pose(then), [missing, 0.0], 1.0)
