"""Layout of the observations of trackslip/Traverse-v0, float32 (10 + 2 F + 45,) for F flippers.

They are attitude, rates, place on the course, belts, flippers (tips up) and a map of the ground's heights over the
lowest point of the level robot. The map is centred on the robot and aligned with its heading: columns at `AHEAD` in
front of it, rows at `ASIDE` to its left, row by row.
"""

from __future__ import annotations

import numpy as np

from sim.task import Element
from sim.traverse.world import Traverse
from trackslip import se2
from trackslip.kinematics import Array

AHEAD = np.linspace(-0.5, 0.9, 15)
"""Columns of the map [m]."""
ASIDE = np.array([-0.22, 0.0, 0.22])
"""Rows of the map [m]."""
_AXES = ("forward", "left", "up")


class CrossingLayout:
    """Elements (n) of an observation."""

    def __init__(self, world: Traverse) -> None:
        """For the robots of `world`."""
        flippers, quarter = [flipper.body for flipper in world.tracked.robot.flippers], np.pi / 2
        self.elements = (
            *(Element(f"vertical, {axis}", "-", 1.0) for axis in _AXES),
            *(Element(f"{rate} rate", "rad/s", 2.0, 2.0) for rate in ("roll", "pitch", "yaw")),
            Element("distance from the middle, to the left", "m", 1.0, 2.0),
            Element("heading on the course", "rad", np.pi),
            *(Element(f"{side} belt speed", "m/s", world.servos.top_speed) for side in ("left", "right")),
            *(Element(f"{name} angle", "rad", quarter, 2.0) for name in flippers),
            *(Element(f"{name} set point", "rad", quarter, 2.0) for name in flippers),
            *(Element(f"height at ({round(x, 2) + 0.0:g}, {y:g}) m", "m", 0.3, 3.0) for y in ASIDE for x in AHEAD),
        )
        """Names, units, scales and bounds."""
        self._scale = np.array([element.scale for element in self.elements])
        self._bound = np.array([element.bound for element in self.elements], np.float32)
        self._lowest = world.tracked.robot.lowest
        across, along = np.meshgrid(ASIDE, AHEAD, indexing="ij")
        self._around = np.stack([along.ravel(), across.ravel()], axis=-1)

    def observation(self, world: Traverse) -> Array:
        """Observations (N, n) of all robots."""
        state = world.state
        heading, position = state.heading, state.position
        around = position[:, None, :2] + se2.rotate(heading[:, None], self._around)
        heights = world.elevation(around) - position[:, 2:] - self._lowest
        whole = np.concatenate(
            [
                *(state.rotation[:, 2], state.rate, position[:, 1:2], heading[:, None]),
                *(world.servo.speed, state.flippers, world.servo.angle, heights),
            ],
            axis=1,
        )
        return np.clip((whole / self._scale).astype(np.float32), -self._bound, self._bound)
