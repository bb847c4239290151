"""Drawing of robots that cross courses."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from sim.engine.opengl import place
from sim.learning.renderer import TaskRenderer
from sim.robot.looks import RobotLooks
from sim.robot.tracked_model import build_tracked
from sim.traverse.task import Crossing


class CourseRenderer(TaskRenderer):
    """Drawing of robots on their courses."""

    def __init__(self, task: Crossing) -> None:
        world = task.world
        drawn = build_tracked(world.tracked.robot, world.slots, looks=True)
        super().__init__(RobotLooks.of(drawn))
        self._task = task
        # (N, T) belt travel in this episode [m]
        self._travel = np.zeros(world.contact.belt.shape)

    def begin(self, rows: Sequence[int]) -> None:
        """Reset the drawn belts of the robots `rows`."""
        self._travel[list(rows)] = 0.0

    def follow(self) -> None:
        """Advance the drawn belts by the simulated belts' travel."""
        self._travel += self._task.world.contact.belt * self._task.config.period

    def pose(self, row: int) -> None:
        """Set `data` to the state of the robot `row`, and the model to its course."""
        world = self._task.world
        world.slots.show(row, world.course[row], self.looks.model)
        place(self.data, world.state.qpos[row])

    def camera(self, row: int) -> mujoco.MjvCamera:
        """The camera that follows the robot `row`."""
        world = self._task.world
        position = world.state.position[:, None, :2]
        ground = float(world.elevation(position)[row, 0])
        return self.looks.camera(self.data, ground)

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append the tracks of the robot `row` to a scene."""
        self.looks.draw(scene, self.data, self._travel[row])
