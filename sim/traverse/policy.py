"""The scripted controller, which crosses courses with flipper reflexes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.robot.tracked_model import FlipperGeometry
from sim.traverse.world import Command, Traverse
from trackslip import se2
from trackslip.errors import Checked, checked, require_non_negative, require_positive, require_within
from trackslip.kinematics import Array

SAMPLES = np.array([1.0, 1.25, 1.5])
"""Distances from the hinge at which a reflex samples the ground, in flipper lengths."""
OPTIONS: dict[str, Any] = {"action": "correction", "flippers": "pairs", "period": 0.2}
"""Fields of `TraverseConfig` for which policies are trained."""


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

    def set_points(self, world: Traverse) -> Array:
        """Set points (N, F) of the flippers' angles of all robots in `world`, tips up [rad]."""
        geometry, state = world.flippers, world.state
        hinge = state.position[:, None] + np.einsum("nij,fj->nfi", state.rotation, geometry.hinge)
        away = np.where(geometry.front, 1.0, -1.0)[:, None] * SAMPLES * geometry.length[:, None]  # (F, S)
        points = hinge[:, :, None, :2] + away[..., None] * se2.direction(state.heading)[:, None, None]
        ground = world.elevation(points.reshape(world.size, -1, 2)).reshape(world.size, *away.shape)
        return self.angles(ground, state.pitch, hinge[..., 2], geometry)

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


@dataclass(frozen=True)
class Scripted(Checked):
    """Drives along y = 0 and keeps the flippers on reflex."""

    speed: float = checked(0.4, require_positive)
    """Forward speed of the belts [m/s]."""
    position_gain: float = checked(0.3, require_non_negative)
    """Belt speed per distance from the middle [1/s]."""
    heading_gain: float = checked(0.45, require_non_negative)
    """Belt speed per heading [m/s]."""
    turn: float = checked(0.3, require_non_negative)
    """Largest difference of a belt's speed from the mean of both [m/s]."""
    reflex: Reflex = field(default_factory=Reflex)
    """Reflex of the flippers."""

    def command(self, world: Traverse) -> Command:
        """Set points of all robots in `world`."""
        state = world.state
        aside = -self.position_gain * state.position[:, 1] - self.heading_gain * state.heading
        turn = np.clip(aside, -self.turn, self.turn)
        return Command(self.speed + turn[:, None] * np.array([-1.0, 1.0]), self.reflex.set_points(world))
