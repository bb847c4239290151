"""Drawing of a task's robots, with paths and trails or on courses: pictures of each robot, and a
window.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from sim.opengl import Pictures, Window, place
from sim.path_tracking.tracking import PathTracking
from sim.robot.looks import RobotLooks, robot_looks
from sim.robot.tracked_model import build_tracked
from sim.traverse.task import Crossing
from trackslip.kinematics import Array

_SPACING = 0.03  # smallest length of a drawn segment [m]
# height above the ground and half width [m], and colour of a line
_PATH, _TRAIL = (0.004, 0.012, (0.10, 0.36, 0.85, 1.0)), (0.014, 0.008, (0.95, 0.45, 0.08, 1.0))
_DISTANCE, _AZIMUTH, _ELEVATION = 2.6, 140.0, -35.0  # camera behind a robot [m, deg, deg]


class TaskRenderer(ABC):
    """Renderer for a task's robots: it takes pictures of any robot, and shows robot 0 in a
    window.
    """

    def __init__(self, looks: RobotLooks) -> None:
        # data: state of the robot being drawn
        self.looks, self.data = looks, mujoco.MjData(looks.model)
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
            quality.offsamples = quality.shadowsize = 0
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
        self._window = self._pictures = None


class PathRenderer(TaskRenderer):
    """Drawing of robots, their reference paths (blue) and their trails (orange)."""

    def __init__(self, tracking: PathTracking) -> None:
        super().__init__(robot_looks(tracking.config.parameters))
        self._tracking = tracking
        self._trails = [[position] for position in tracking.fleet.pose()[:, :2]]

    def begin(self, rows: Sequence[int]) -> None:
        """Begin new trails for the robots `rows`."""
        pose = self._tracking.fleet.pose()
        for row in rows:
            self._trails[row] = [pose[row, :2]]

    def follow(self) -> None:
        """Extend the trails to the robots' current positions."""
        for trail, position in zip(self._trails, self._tracking.fleet.pose()[:, :2], strict=True):
            trail.append(position)

    def camera(self, row: int) -> mujoco.MjvCamera:
        """The camera that follows the robot `row`."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (*self.data.qpos[:2], 0.2)
        camera.distance, camera.azimuth, camera.elevation = _DISTANCE, _AZIMUTH, _ELEVATION
        return camera

    def pose(self, row: int) -> None:
        """Set `data` to the state of the robot `row`."""
        qpos = self.looks.rest.copy()
        qpos[:7] = self._tracking.fleet.batch.qpos[row]
        place(self.data, qpos)

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append tracks, path and trail of the robot `row` to a scene."""
        travel = (
            self._tracking.fleet.drive.angle[row] * self._tracking.config.parameters.sprocket_radius
        )
        self.looks.draw(scene, self.data, travel[self.looks.track_side])
        path, kind = self._tracking.path(row)[:, :2], mujoco.mjtGeom.mjGEOM_CAPSULE
        for points, (height, width, colour) in ((path, _PATH), (self._trails[row], _TRAIL)):
            for start, end in pairwise(_thinned(points)):
                if scene.ngeom == scene.maxgeom:
                    return
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(
                    geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(colour)
                )
                mujoco.mjv_connector(
                    geom, kind, width, np.append(start, height), np.append(end, height)
                )
                scene.ngeom += 1


def _thinned(points: Array | list[Array]) -> Iterator[Array]:
    """Points (2,) on a line (T, 2) that are at least _SPACING apart."""
    last = points[0]
    yield last
    for point in points[1:]:
        if np.linalg.norm(point - last) > _SPACING:
            last = point
            yield last


class CourseRenderer(TaskRenderer):
    """Drawing of robots on their courses."""

    def __init__(self, task: Crossing) -> None:
        super().__init__(
            RobotLooks.of(build_tracked(task.world.tracked.robot, task.world.slots, looks=True))
        )
        self._task = task
        # (N, T) belt travel in this episode [m]
        self._travel = np.zeros(task.world.contact.belt.shape)

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
        ground = self._task.world.elevation(self._task.world.state.position[:, None, :2])[row, 0]
        return self.looks.camera(self.data, float(ground))

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append the tracks of the robot `row` to a scene."""
        self.looks.draw(scene, self.data, self._travel[row])
