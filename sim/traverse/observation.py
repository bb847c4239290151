"""Layout of the observations of trackslip/Traverse-v0.

An observation is float32, (N_FIXED + 2 F + E,) for F flippers and a map of E heights; each element is divided by its
scale and clipped to its bound:

    element     what                                                                    scale             bound
    0, 1, 2     the world's vertical in the robot's frame: forward, left, up [-]        1                 1
    3, 4, 5     angular velocity in the robot's frame [rad/s]                           2                 2
    6           distance from the course's middle, positive to the left [m]             1                 2
    7           heading relative to the course [rad]                                    pi                1
    8, 9        belt speeds, left and right [m/s]                                       top speed         1
    10 ..       angles of the flippers, tips up [rad]                                   pi / 2            2
    10 + F ..   set points that their motors have [rad]                                 pi / 2            2
    10 + 2 F .. heights of the ground below the robot's frame, on a grid that is        0.3               3
                centred on the robot and aligned with its heading [m]

The grid has columns at `AHEAD` in front of the robot and rows at `ASIDE` to its left, row by row.
"""

from __future__ import annotations

import numpy as np

from sim.traverse.world import Traverse
from trackslip import se2
from trackslip.kinematics import Array

AHEAD = np.linspace(-0.5, 0.9, 15)
"""Columns of the map [m]."""
ASIDE = np.array([-0.22, 0.0, 0.22])
"""Rows of the map [m]."""
_FIXED = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0, np.pi])
_FIXED_BOUND = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 1.0])


class CrossingLayout:
    """Scales and bounds of an observation, (n,) each."""

    def __init__(self, world: Traverse) -> None:
        """For the robots of `world`."""
        flippers, cells = len(world.flippers.length), len(AHEAD) * len(ASIDE)
        top = world.servos.top_speed
        self.scale = np.array([*_FIXED, top, top, *[np.pi / 2] * (2 * flippers), *[0.3] * cells])
        self.bound = np.array([*_FIXED_BOUND, 1.0, 1.0, *[2.0] * (2 * flippers), *[3.0] * cells], np.float32)
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
        return np.clip((whole / self.scale).astype(np.float32), -self.bound, self.bound)
