"""Selection of the beams that can hit a plate; the others need not be cast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, wrap_angle

SLACK = 0.2
"""Margin around the plate, so that the beams need not be selected again for every scan [m]."""


@dataclass(frozen=True)
class Aim:
    """The beams that can hit plates near `centre`, whatever their headings; the same number for every robot."""

    centre: Array  # (N, 3) of the plates, when the beams were selected [m]
    beams: np.ndarray  # (N, W) among the B of all
    place: np.ndarray  # (N, W) the same among the N x B beams of all robots

    @classmethod
    def at(cls, centre: Array, origin: Array, heading: float, radius: float, bearings: Array, width: float) -> Aim:
        """Select the beams to cast at plates around `centre` (N, 3) [m].

        The beams start at `origin` (3,) [m] with equally spaced, ascending `bearings` (B,) from the world direction
        `heading` and are `width` wide [rad]. While they are cast, each plate stays within `radius` of its centre [m].
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
        around = np.abs(bearing) + spread > np.pi  # behind the scanner, where the bearing wraps
        low, high = np.where(around, 0, np.clip(low, 0, last)), np.where(around, last, np.clip(high, 0, last))
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        beams = np.minimum(first, last + 1 - count)[:, None] + np.arange(count)
        return cls(centre, beams, np.arange(len(centre))[:, None] * len(bearings) + beams)

    def holds(self, centre: Array) -> bool:
        """Whether the selection is still valid for plates around `centre` (N, 3)."""
        return bool(np.abs(centre - self.centre).max() <= SLACK / 2)
