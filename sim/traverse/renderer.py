"""Pictures of robots on their courses, and a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from sim.opengl import Window, offscreen
from sim.robot.tracked_model import build_tracked
from sim.terrain import Course
from sim.traverse.task import Crossing

WIDTH, HEIGHT = 640, 480
_DISTANCE, _AZIMUTH, _ELEVATION = 2.6, 140.0, -25.0  # of the camera that follows a robot [m, deg, deg]


class Renderer:
    """Draws a robot with its looks on its course."""

    def __init__(self, task: Crossing) -> None:
        self._task = task
        self._course: Course | None = None
        self._data: Any = None
        self._renderer: Any = None
        self._window: Window | None = None

    def begin(self, rows: Sequence[int]) -> None:
        """Nothing: what has been drawn is kept until another course comes."""

    def follow(self) -> None:
        """Nothing: nothing is remembered."""

    def picture(self, row: int) -> np.ndarray:
        """Image (HEIGHT, WIDTH, 3) uint8 of robot `row`; raises TrackslipError if OpenGL doesn't work."""
        data = self._posed(row)
        if self._renderer is None:
            self._renderer = offscreen(data.model, WIDTH, HEIGHT)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = self._task.world.state.position[row]
        camera.distance, camera.azimuth, camera.elevation = _DISTANCE, _AZIMUTH, _ELEVATION
        self._renderer.update_scene(data, camera=camera)
        return np.array(self._renderer.render())

    def show(self) -> None:
        """Show robot 0 in a window; raises TrackslipError if there is no display."""
        data = self._posed(0)
        if self._window is None:
            self._window = Window(data)
        with self._window.viewer.lock():
            self._posed(0)
        self._window.viewer.sync()

    def close(self) -> None:
        """Close the window and free the image buffers."""
        for opened in filter(None, (self._renderer, self._window)):
            opened.close()
        self._renderer = self._window = None

    def _posed(self, row: int) -> Any:
        """Data of the model with looks in the state of robot `row`, compiled for every new course."""
        world = self._task.world
        if self._course is not world.course[row]:
            self.close()
            self._course = world.course[row]
            tracked = build_tracked(world.tracked.robot, self._course, preset=self._task.config.preset, looks=True)
            self._data = mujoco.MjData(tracked.model)
        self._data.qpos[:] = world.state.qpos[row]
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            compute(self._data.model, self._data)
        return self._data
