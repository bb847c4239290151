"""References: trajectories that a robot follows in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.kinematics import Array


class Reference(Protocol):
    """A trajectory. It rests at its start before time 0 and at its end after `duration`."""

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""


class PiecewiseReference(ABC):
    """Base of references at constant acceleration between knots."""

    def __init__(self, durations: ArrayLike, start_speeds: ArrayLike, end_speeds: ArrayLike) -> None:
        """Durations (K,) [s] of the cells between knots, and speeds (K,) [m/s] at their starts and ends."""
        durations, self._speeds = np.asarray(durations, float), np.asarray(start_speeds, float)
        self._accelerations = (np.asarray(end_speeds, float) - self._speeds) / durations
        self._times = np.concatenate([[0.0], np.cumsum(durations)])

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""
        return float(self._times[-1])

    @property
    def knots(self) -> Array:
        """Times (K + 1,) between which the twist is smooth [s]."""
        return self._times

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        k, way, _ = self._driven(time)
        return self._pose(k, way)

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        k, way, speed = self._driven(time)
        return np.stack([speed, speed * self._curvature(k, way)], axis=-1)

    def _driven(self, time: ArrayLike) -> tuple[NDArray[np.intp], Array, Array]:
        """Index of the cell, way driven since its start [m] and speed [m/s], each (...)."""
        time = np.asarray(time, float)
        clipped = np.minimum(np.maximum(time, 0.0), self.duration)
        k = cell(self._times, clipped)
        t = clipped - self._times[k]
        speed = np.where((time < 0) | (time >= self.duration), 0.0, self._speeds[k] + self._accelerations[k] * t)
        return k, t * (self._speeds[k] + self._accelerations[k] * t / 2), speed

    @abstractmethod
    def _pose(self, k: NDArray[np.intp], way: Array) -> Array:
        """Poses (..., 3) in cells k (...), `way` (...) from their starts [m]."""

    @abstractmethod
    def _curvature(self, k: NDArray[np.intp], way: Array) -> Array:
        """Curvatures (...) there [1/m]."""


class Tabulated:
    """A reference whose poses and twists at certain times are computed in advance, all at once."""

    def __init__(self, reference: Reference, times: ArrayLike) -> None:
        """Tabulate `reference` at `times` (T,) [s]; at other times it is evaluated."""
        times = np.asarray(times, float)
        self._reference = reference
        self._poses = dict(zip(times.tolist(), reference.pose(times), strict=True))
        self._twists = dict(zip(times.tolist(), reference.twist(times), strict=True))

    def __getattr__(self, name: str) -> Any:
        """Any other attribute of the reference."""
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


def cell(knots: Array, at: Array) -> NDArray[np.intp]:
    """Index (...) of the last of the knots (K,) below `at` (...), at most K - 2: the start of its cell."""
    k = np.searchsorted(knots, at, side="right") - 1
    return np.minimum(np.maximum(k, 0), len(knots) - 2)
