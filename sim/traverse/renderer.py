"""Pictures of robots on their courses, and a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from sim.opengl import Window
from sim.robot.tracked_model import build_tracked
from sim.robot.tracked_view import TrackedView
from sim.terrain import Course
from sim.traverse.task import Crossing

WIDTH, HEIGHT = 640, 480


class Renderer:
    """Draws a robot with its looks on its course."""

    def __init__(self, task: Crossing) -> None:
        self._task = task
        self._travel = np.zeros(task.world.contact.belt.shape)  # of the belts in this episode (N, T) [m]
        self._course: Course | None = None
        self._data: Any = None
        self._view: TrackedView | None = None
        self._window: Window | None = None

    def begin(self, rows: Sequence[int]) -> None:
        """Draw belts from their start again."""
        self._travel[list(rows)] = 0.0

    def follow(self) -> None:
        """Let the drawn belts run as far as the true ones."""
        self._travel += self._task.world.contact.belt * self._task.config.period

    def picture(self, row: int) -> np.ndarray:
        """Image (HEIGHT, WIDTH, 3) uint8 of robot `row`; raises TrackslipError if OpenGL doesn't work."""
        view = self._posed(row)
        ground = self._task.world.elevation(self._task.world.state.position[:, None, :2])[row, 0]
        return view.picture(self._data, self._travel[row], float(ground))

    def show(self) -> None:
        """Show robot 0 in a window; raises TrackslipError if there is no display."""
        view = self._posed(0)
        if self._window is None:
            self._window = Window(self._data)
        viewer = self._window.viewer
        with viewer.lock():
            self._posed(0)
            viewer.user_scn.ngeom = 0
            view.draw(viewer.user_scn, self._data, self._travel[0])
        viewer.sync()

    def close(self) -> None:
        """Close the window and free the image buffers."""
        if self._view is not None:
            self._view.close()
        if self._window is not None:
            self._window.close()
        self._view = self._window = None
        self._course = None

    def _posed(self, row: int) -> TrackedView:
        """The view of the model with looks, compiled for every new course, in the state of robot `row`."""
        world = self._task.world
        if self._view is None or self._course is not world.course[row]:
            self.close()
            self._course = world.course[row]
            tracked = build_tracked(world.tracked.robot, self._course, preset=self._task.config.preset, looks=True)
            self._view, self._data = TrackedView(tracked, WIDTH, HEIGHT), mujoco.MjData(tracked.model)
        self._data.qpos[:] = world.state.qpos[row]
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            compute(self._data.model, self._data)
        return self._view
