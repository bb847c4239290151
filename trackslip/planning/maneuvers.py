"""Maneuvers: pieces of a drive from rest to rest, in which the speeds of the belts keep their ratio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.planning.limits import DriveLimits

RATE = 50.0
"""Commands per second; maneuvers take multiples of its period [Hz]."""
TURNING = 0.65
"""Largest yaw rate, as a share of the fastest spin's [-]: the ICRs of real tracks move outwards with the yaw rate, so
that faster spins would identify a law of unusual driving."""
_LEAST = 1e-9  # way of a maneuver that counts [m]


@dataclass(frozen=True)
class Maneuvers:
    """Ways of the belts, and the times that they take within the limits."""

    way: Array  # (n, 2) of the left and the right belt, negative backwards [m]
    duration: Array  # (n,) multiples of the period [s]
    acceleration: float  # [m/s^2]

    @classmethod
    def of(cls, way: Array, limits: DriveLimits) -> Maneuvers:
        """The fastest maneuvers (n, 2) within the limits; maneuvers without any way are left out."""
        way = way[np.abs(way).max(axis=1, initial=0.0) > _LEAST]
        return cls(way, durations(way, limits), limits.acceleration)

    def speeds(self, duration: float) -> Array:
        """Speeds (T, 2) of the belts, mean over each period, until `duration` [s]; at rest after the last maneuver.

        The means of a speed within the limits are within them, too, and so are their differences.
        """
        edges = np.arange(round(duration * RATE) + 1) / RATE
        begin = np.concatenate([[0.0], np.cumsum(self.duration)])
        k = np.clip(np.searchsorted(begin, edges + 1e-9, side="right") - 1, 0, len(self.way) - 1)
        into = np.clip(edges - begin[k], 0.0, self.duration[k])
        length = np.abs(self.way).max(axis=1)
        share = (self._driven(into, k) / length[k])[:, None]
        before = np.concatenate([np.zeros((1, 2)), np.cumsum(self.way, axis=0)])
        return np.asarray(np.diff(before[k] + share * self.way[k], axis=0) * RATE)

    def _driven(self, into: Array, k: np.ndarray) -> Array:
        """Way (T,) of the faster belt at the time `into` (T,) the maneuvers `k` (T,): a trapezoid of speed."""
        a, whole, length = self.acceleration, self.duration[k], np.abs(self.way).max(axis=1)[k]
        peak = (a * whole - np.sqrt(np.maximum((a * whole) ** 2 - 4 * a * length, 0.0))) / 2
        ramp = peak / a
        rest = whole - into
        middle = peak * (into - ramp / 2)
        return np.where(into < ramp, a * into**2 / 2, np.where(rest < ramp, length - a * rest**2 / 2, middle))


def durations(way: Array, limits: DriveLimits) -> Array:
    """Shortest times (n,), in whole periods, of maneuvers with ways (n, 2) of the belts [m], from rest to rest [s]."""
    length = np.abs(way).max(axis=1)
    turn = np.abs(way[:, 1] - way[:, 0])
    v = limits.max_speed * np.minimum(1.0, 2 * TURNING * np.maximum(length, _LEAST) / np.maximum(turn, _LEAST))
    a = limits.acceleration
    shortest = np.where(length >= v**2 / a, length / v + v / a, 2 * np.sqrt(length / a))
    return np.asarray(np.ceil(shortest * RATE - 1e-9) / RATE)


def longest_spin(duration: float, limits: DriveLimits) -> float:
    """Way of either belt in a spin of this duration, rounded down to periods [m]."""
    whole = np.floor(max(duration, 0.0) * RATE + 1e-9) / RATE
    v, a = TURNING * limits.max_speed, limits.acceleration
    return float(v * (whole - v / a) if whole >= 2 * v / a else a * whole**2 / 4)
