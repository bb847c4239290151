"""References, tabulated at the control periods and looked up for many robots at once."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sim.path_tracking.config import PERIOD
from trackslip.kinematics import Array
from trackslip.trajectory.named import load_reference

Index = NDArray[np.int_]


class ReferenceTable:
    """Poses and twists of R references, one row each, at multiples of the control period."""

    def __init__(self, names: Iterable[str], steps: Index) -> None:
        """`names`: of the references; `steps` (K,): control periods from now to twists looked up, ascending from 0."""
        self._steps = steps
        self.names: list[str] = []
        """Names of the references, in order of their indices."""
        self.last: Index = np.empty(0, int)
        """Control period (R,) in which each reference ends."""
        self._pose: Array = np.empty((0, 1, 3))
        self._twists: Array = np.empty((0, 1, len(steps), 2))
        for name in names:
            self.index(name)

    def index(self, name: str) -> int:
        """Index of a reference, which is added if it is new; raises TrackslipError for an unknown name."""
        if name not in self.names:
            reference = load_reference(name)
            last = math.ceil(reference.duration / PERIOD - 1e-9)
            now = np.arange(last + self._steps[-1] + 1)  # beyond the end it stands
            time = now * PERIOD
            self._pose = _stacked(self._pose, reference.pose(time))
            later = np.minimum(now[:, None] + self._steps, now[-1])
            self._twists = _stacked(self._twists, reference.twist(time)[later])
            self.last = np.append(self.last, last)
            self.names.append(name)
        return self.names.index(name)

    def path(self, index: int) -> Array:
        """Poses (T, 3) of a reference from its start to its end."""
        return self._pose[index, : self.last[index] + 1]

    def pose(self, index: Index, k: Index) -> Array:
        """Poses (..., 3) of references (...) in control periods (...)."""
        return self._pose[index, np.minimum(k, self._pose.shape[1] - 1)]

    def twists(self, index: Index, k: Index) -> Array:
        """Twists (..., K, 2) of references (...), `steps` after control periods (...)."""
        return self._twists[index, np.minimum(k, self._twists.shape[1] - 1)]


def _stacked(table: Array, row: Array) -> Array:
    """Append a row (t, ...) to a table (R, T, ...); the shorter of the two is continued with its last values."""
    length = max(table.shape[1], len(row))
    every = [part.take(np.minimum(np.arange(length), part.shape[1] - 1), axis=1) for part in (table, row[None])]
    return np.concatenate(every)
