"""A reference with a table: what controllers ask for again and again is computed once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


class Tabulated:
    """A reference whose poses and twists at certain times are computed in advance, all at once."""

    def __init__(self, reference: Reference, times: ArrayLike) -> None:
        """Tabulate `reference` at `times` (T,) [s]; at any other time it is asked."""
        times = np.asarray(times, float)
        self._reference = reference
        self._poses = dict(zip(times.tolist(), reference.pose(times), strict=True))
        self._twists = dict(zip(times.tolist(), reference.twist(times), strict=True))

    def __getattr__(self, name: str) -> Any:
        """Whatever else the reference offers."""
        return getattr(self._reference, name)

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""
        return self._reference.duration

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        known = self._poses.get(time) if isinstance(time, float) else None
        return self._reference.pose(time) if known is None else known.copy()

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        known = self._twists.get(time) if isinstance(time, float) else None
        return self._reference.twist(time) if known is None else known.copy()
