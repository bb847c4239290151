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

    def __init__(self, names: Iterable[str], ahead: int) -> None:
        """`names`: of the references; `ahead`: number of control periods tabulated beyond a reference's end."""
        self._ahead = ahead
        self.names: list[str] = []
        """Names of the references, in order of their indices."""
        self.last: Index = np.empty(0, int)
        """Control period (R,) in which each reference ends."""
        self._pose: Array = np.empty((0, 1, 3))
        self._twist: Array = np.empty((0, 1, 2))
        for name in names:
            self.index(name)

    def index(self, name: str) -> int:
        """Index of a reference, which is added if it is new; raises TrackslipError for an unknown name."""
        if name not in self.names:
            reference = load_reference(name)
            last = math.ceil(reference.duration / PERIOD - 1e-9)
            time = np.arange(last + self._ahead + 1) * PERIOD
            self._pose = _stacked(self._pose, reference.pose(time))
            self._twist = _stacked(self._twist, reference.twist(time))
            self.last = np.append(self.last, last)
            self.names.append(name)
        return self.names.index(name)

    def path(self, index: int) -> Array:
        """Poses (T, 3) of a reference from its start to its end."""
        return self._pose[index, : self.last[index] + 1]

    def pose(self, index: Index, k: Index) -> Array:
        """Poses (..., 3) of references (...) in control periods (...)."""
        return self._pose[index, np.minimum(k, self.last[index] + self._ahead)]

    def twist(self, index: Index, k: Index) -> Array:
        """Twists (..., 2) of references (...) in control periods (...)."""
        return self._twist[index, np.minimum(k, self.last[index] + self._ahead)]


def _stacked(table: Array, row: Array) -> Array:
    """Append a row (t, n) to a table (R, T, n); the shorter of the two is padded with zeros."""
    length = max(table.shape[1], len(row))
    longer = np.zeros((len(table) + 1, length, table.shape[2]))
    longer[:-1, : table.shape[1]], longer[-1, : len(row)] = table, row
    return longer
