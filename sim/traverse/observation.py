"""Layout of the observations of trackslip/Traverse-v0, float32 (10 + 2 F + 45,) for F flippers.

They are attitude, rates, place on the course, belts, flippers (tips up) and a map of the ground's heights over the
lowest point of the level robot. The map is centred on the robot and aligned with its heading: columns at `AHEAD` in
front of it, rows at `ASIDE` to its left, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.task import Element, Floats
from sim.traverse.world import Traverse
from trackslip import se2
from trackslip.errors import Checked, checked, require_non_negative

AHEAD = np.linspace(-0.5, 0.9, 15)
"""Columns of the map [m]."""
ASIDE = np.array([-0.22, 0.0, 0.22])
"""Rows of the map [m]."""
_AXES = ("forward", "left", "up")


@dataclass(frozen=True)
class SensorNoise(Checked):
    """Standard deviations of Gaussian noise of the observations, independent from step to step."""

    attitude: float = checked(0.0, require_non_negative, 10.0)
    """Of each component of the vertical in the robot's frame [-], which are small angles [rad]."""
    rate: float = checked(0.0, require_non_negative, 10.0)
    """Of the roll, pitch and yaw rates [rad/s]."""
    position: float = checked(0.0, require_non_negative, 10.0)
    """Of the distance from the middle of the course, by odometry [m]."""
    heading: float = checked(0.0, require_non_negative, 10.0)
    """Of the heading, by odometry [rad]."""
    speed: float = checked(0.0, require_non_negative, 10.0)
    """Of the belts' speeds [m/s]."""
    flipper: float = checked(0.0, require_non_negative, 10.0)
    """Of the flippers' angles; their set points are known [rad]."""
    height: float = checked(0.0, require_non_negative, 10.0)
    """Of each height in the map [m]."""


class CrossingLayout:
    """Elements (n) of an observation."""

    def __init__(self, world: Traverse, noise: SensorNoise) -> None:
        """For the robots of `world`, whose sensors have this noise."""
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
        f, heights = len(flippers), len(ASIDE) * len(AHEAD)
        parts = (
            *((3, noise.attitude), (3, noise.rate), (1, noise.position), (1, noise.heading), (2, noise.speed)),
            *((f, noise.flipper), (f, 0.0), (heights, noise.height)),
        )
        self.noise = np.repeat([deviation for _, deviation in parts], [count for count, _ in parts])
        """Standard deviations (n,) of the quantities, in their units."""
        self._lowest = world.tracked.robot.lowest
        across, along = np.meshgrid(ASIDE, AHEAD, indexing="ij")
        self._around = np.stack([along.ravel(), across.ravel()], axis=-1)

    def observation(self, world: Traverse, seeds: Sequence[int]) -> Floats:
        """Observations (N, n) of all robots; their noise depends on `seeds` (N,) and on the time of the run."""
        state = world.state
        heading, position = state.heading, state.position
        around = position[:, None, :2] + se2.rotate(heading[:, None], self._around)
        heights = world.elevation(around) - position[:, 2:] - self._lowest
        whole = np.concatenate(
            [
                *(state.rotation[:, 2], state.rate, position[:, 1:2], heading[:, None]),
                *(world.servo.speed, world.tracked.flipper_angles(state.qpos), world.servo.angle, heights),
            ],
            axis=1,
        )
        if self.noise.any():
            steps = np.rint(world.time / world.period).astype(int)
            draws = [
                np.random.default_rng(both).standard_normal(len(self.noise)) for both in zip(seeds, steps, strict=True)
            ]
            whole = whole + self.noise * np.array(draws)
        return np.clip((whole / self._scale).astype(np.float32), -self._bound, self._bound)
