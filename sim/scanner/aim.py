"""Which beams are worth casting at the plates: those that pass a plate by needn't be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, wrap_angle

SLACK = 0.2
"""Around the plate, so that the beams to cast needn't be chosen anew for every scan [m]."""


@dataclass(frozen=True)
class Aim:
    """The beams that can meet plates which stay near `centre`, whatever their headings; as many for every robot."""

    centre: Array  # (N, 3) of the plates, when these beams were chosen [m]
    beams: np.ndarray  # (N, W) among the B of all
    place: np.ndarray  # (N, W) among the N x B of all robots

    @classmethod
    def at(cls, centre: Array, origin: Array, heading: float, radius: float, bearings: Array, width: float) -> Aim:
        """The beams to cast at plates about `centre` (N, 3).

        Args:
            centre: of the plates, in the world [m].
            origin: (3,) where the beams start [m].
            heading: of bearing 0, in the world [rad].
            radius: of the sphere that holds a plate wherever it is when the beams are cast, SLACK not counted [m].
            bearings: (B,) of all beams, equally spaced, ascending [rad].
            width: of a beam [rad].
        """
        radius += SLACK
        x, y = (centre - origin)[:, :2].T
        distance = np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - heading)
        spread = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0)), np.pi)
        spread = spread + width / 2
        last = len(bearings) - 1
        step = (bearings[-1] - bearings[0]) / last
        low, high = ((edge - bearings[0]) / step for edge in (bearing - spread, bearing + spread))
        around = np.abs(bearing) + spread > np.pi  # behind the scanner, where the bearing jumps
        low, high = np.where(around, 0, np.clip(low, 0, last)), np.where(around, last, np.clip(high, 0, last))
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        beams = np.minimum(first, last + 1 - count)[:, None] + np.arange(count)
        return cls(centre, beams, np.arange(len(centre))[:, None] * len(bearings) + beams)

    def holds(self, centre: Array) -> bool:
        """Whether plates about `centre` (N, 3) are still near enough to where they were."""
        return bool(np.abs(centre - self.centre).max() <= SLACK / 2)
