"""Drawing of a task's robots: pictures of each robot, and a window."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

from sim.engine.opengl import Pictures, Window
from sim.robot.looks import RobotLooks


class TaskRenderer(ABC):
    """Renderer for a task's robots: it takes pictures of any robot, and shows robot 0 in a
    window.
    """

    def __init__(self, looks: RobotLooks) -> None:
        self.looks = looks
        """How the robots look."""
        self.data = mujoco.MjData(looks.model)
        """State of the robot being drawn."""
        self._window: Window | None = None
        self._pictures: Pictures | None = None

    @abstractmethod
    def begin(self, rows: Sequence[int]) -> None:
        """Note that new episodes have begun for the robots `rows`."""

    @abstractmethod
    def follow(self) -> None:
        """Note that a control period has passed."""

    @abstractmethod
    def pose(self, row: int) -> None:
        """Set `data` to the state of the robot `row`."""

    @abstractmethod
    def camera(self, row: int) -> Any:
        """The camera that follows the robot `row`."""

    @abstractmethod
    def draw(self, scene: Any, row: int) -> None:
        """Append everything except the model of the robot `row` to a scene."""

    def picture(self, row: int) -> np.ndarray:
        """Image (480, 640, 3) uint8 of the robot `row`; raises TrackslipError if OpenGL doesn't
        work.
        """
        self.pose(row)
        if self._pictures is None:
            quality = self.looks.model.vis.quality  # low enough for drawing in 60 ms on a CPU
            quality.offsamples = 0
            quality.shadowsize = 0
            self._pictures = Pictures(self.looks.model, 640, 480)
        return self._pictures.take(self.data, self.camera(row), partial(self.draw, row=row))

    def show(self) -> None:
        """Show robot 0 in a window; raises TrackslipError if there is no display."""
        self.pose(0)
        if self._window is None:
            self._window = Window(self.data)
        viewer = self._window.viewer
        with viewer.lock():
            self.pose(0)
            viewer.user_scn.ngeom = 0
            self.draw(viewer.user_scn, 0)
        viewer.sync()

    def close(self) -> None:
        """Close the window and free the image buffers."""
        for shown in (self._window, self._pictures):
            if shown is not None:
                shown.close()
        self._window = None
        self._pictures = None
