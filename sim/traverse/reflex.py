"""Flipper reflexes: each flipper follows the ground ahead of it, so that its belt comes down on edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.robot.tracked_model import FlipperGeometry
from trackslip.errors import Checked, checked, require_within
from trackslip.kinematics import Array

SAMPLES = np.array([1.0, 1.25, 1.5])
"""Distances from the hinge at which a reflex samples the ground, in flipper lengths."""


@dataclass(frozen=True)
class Reflex(Checked):
    """Rules that turn ground and attitude into set points of the flippers.

    Front flippers rise as far as what is ahead demands. Rear flippers stay in line with the chassis, which keeps it
    from tipping backwards, and reach down for the ground behind it when the robot comes over an edge. Where the chassis
    points upwards more than the ground rises from the rear to the front, as on a step, they push it level.
    """

    highest: float = checked(1.3, require_within, -np.pi, np.pi, "rad")
    """Largest lift of front flippers above the chassis' plane [rad]."""
    lowest: float = checked(-1.3, require_within, -np.pi, np.pi, "rad")
    """Lowest reach of rear flippers [rad]."""
    push: float = checked(2.0, require_within, -np.pi, np.pi, "rad")
    """Angle by which rear flippers push down, per pitch beyond the ground's and `tolerated` [-]."""
    tolerated: float = checked(0.12, require_within, -np.pi, np.pi, "rad")
    """Pitch beyond the ground's at which they begin to push [rad]."""

    def angles(self, ground: Array, pitch: Array, hinge_height: Array, geometry: FlipperGeometry) -> Array:
        """Set points (N, F) of the flippers' angles, tips up [rad].

        Args:
            ground: heights (N, F, S) of the ground at `SAMPLES` beyond the hinges, in the flippers' directions [m].
            pitch: angles (N,) by which the chassis points upwards [rad].
            hinge_height: heights (N, F) of the hinges [m].
            geometry: the F flippers.
        """
        away = SAMPLES * geometry.length[:, None]  # (F, S)
        rise = ground - hinge_height[..., None]
        distance = np.hypot(away, rise)
        # of a line through the hinge whose lower side, `radius` below, touches the ground there
        above = np.arcsin(np.minimum(geometry.radius[:, None] / distance, 1.0))
        slope = (np.arctan2(rise, away) + above).max(axis=-1)
        lift = slope - np.where(geometry.front, 1.0, -1.0) * pitch[:, None]
        low, high = np.where(geometry.front, 0.0, self.lowest), np.where(geometry.front, self.highest, 0.0)
        steep = np.maximum(pitch - _grade(ground, geometry) - self.tolerated, 0.0)
        push = np.where(geometry.front, 0.0, self.push * steep[:, None])
        return np.maximum(np.clip(lift, low, high) - push, low) - geometry.rest


def _grade(ground: Array, geometry: FlipperGeometry) -> Array:
    """Slopes (N,) of the ground (N, F, S) from beyond the rear flippers to beyond the front ones [rad]."""
    front, height = geometry.front, ground.mean(axis=-1)
    if front.all() or not front.any():
        return np.zeros(len(ground))
    place = geometry.hinge[:, 0] + np.where(front, 1.0, -1.0) * SAMPLES.mean() * geometry.length
    rise = height[:, front].mean(axis=1) - height[:, ~front].mean(axis=1)
    return np.asarray(np.arctan2(rise, place[front].mean() - place[~front].mean()))
