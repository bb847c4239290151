"""References: trajectories that a robot follows in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.kinematics import Array


@runtime_checkable
class Reference(Protocol):
    """A trajectory that rests at its start before time 0 and at its end after `duration`."""

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s], with phi unwrapped."""

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""


class PiecewiseReference(ABC):
    """Base class of references with constant acceleration between knots.

    In turns on the spot, distances, speeds and accelerations are angles [rad], yaw rates and yaw
    accelerations.
    """

    def __init__(
        self, durations: ArrayLike, start_speeds: ArrayLike, end_speeds: ArrayLike
    ) -> None:
        """Join cells of durations (K,) [s], with speeds (K,) [m/s] at their starts and ends."""
        self.cells = np.array([durations, start_speeds, end_speeds])  # (3, K)
        durations, speeds, end_speeds = self.cells
        self._speeds = speeds
        self._accelerations = (end_speeds - speeds) / durations
        self._times = np.concatenate([[0.0], np.cumsum(durations)])

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""
        return float(self._times[-1])

    @property
    def knots(self) -> Array:
        """Times (K + 1,) [s] between which the twist is smooth."""
        return self._times

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s], with phi unwrapped."""
        k, distance, _ = self._driven(time)
        return self.pose_in(k, distance)

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        return self.twist_in(*self._driven(time))

    def _driven(self, time: ArrayLike) -> tuple[NDArray[np.intp], Array, Array]:
        """Cells, distances driven in them [m] and speeds [m/s], each (...), at times (...) [s]."""
        time = np.asarray(time, float)
        clipped = np.minimum(np.maximum(time, 0.0), self.duration)
        k = cell(self._times, clipped)
        t = clipped - self._times[k]  # time in the cell
        v = self._speeds[k]
        a = self._accelerations[k]
        distance = t * (v + a * t / 2)
        at_rest = (time < 0) | (time >= self.duration)
        speed = np.where(at_rest, 0.0, v + a * t)
        return k, distance, speed

    @abstractmethod
    def pose_in(self, k: NDArray[np.intp], distance: Array) -> Array:
        """Poses (..., 3) in cells k (...), at distances (...) [m] from their starts."""

    @abstractmethod
    def twist_in(self, k: NDArray[np.intp], distance: Array, speed: Array) -> Array:
        """Twists (..., 2) in cells k (...), at distances [m] from their starts and speeds [m/s],
        each (...).
        """


def cell(knots: Array, places: Array) -> NDArray[np.intp]:
    """Indices (...) of the cells between knots (K,) that contain places (...), from 0 to K - 2."""
    k = np.searchsorted(knots, places, side="right") - 1
    return np.minimum(np.maximum(k, 0), len(knots) - 2)
