"""Pictures of robots on their courses, and a window."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from sim.opengl import TaskRenderer, place
from sim.robot.looks import RobotLooks
from sim.robot.tracked_model import build_tracked
from sim.traverse.task import Crossing


class CourseRenderer(TaskRenderer):
    """Draws a robot with its looks on its course."""

    def __init__(self, task: Crossing) -> None:
        super().__init__()
        self._task = task
        self._travel = np.zeros(task.world.contact.belt.shape)  # of the belts in this episode (N, T) [m]
        self._looks: RobotLooks

    def begin(self, rows: Sequence[int]) -> None:
        """Draw belts from their start again."""
        self._travel[list(rows)] = 0.0

    def follow(self) -> None:
        """Advance the drawn belts with the simulated ones."""
        self._travel += self._task.world.contact.belt * self._task.config.period

    def pose(self, row: int) -> None:
        """See TaskRenderer; the model is compiled when it is first needed."""
        world = self._task.world
        if self.data is None:
            tracked = build_tracked(world.tracked.robot, world.terrain, preset=self._task.config.preset, looks=True)
            self._looks, self.data = RobotLooks.of(tracked), mujoco.MjData(tracked.model)
        world.show(row, self.data.model)
        place(self.data, world.state.qpos[row])

    def camera(self, row: int) -> mujoco.MjvCamera:
        """See TaskRenderer."""
        ground = self._task.world.elevation(self._task.world.state.position[:, None, :2])[row, 0]
        return self._looks.camera(self.data, float(ground))

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append the tracks."""
        self._looks.draw(scene, self.data, self._travel[row])
