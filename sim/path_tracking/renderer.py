"""Drawing of robots that follow paths: their references and trails."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import mujoco
import numpy as np

from sim.engine.opengl import place
from sim.learning.renderer import TaskRenderer
from sim.path_tracking.tracking import PathTracking
from sim.robot.looks import robot_looks
from trackslip.kinematics import Array

_SPACING = 0.03  # smallest length of a drawn segment [m]
# height above the ground and half width [m], and colour of a line
_PATH, _TRAIL = (0.004, 0.012, (0.10, 0.36, 0.85, 1.0)), (0.014, 0.008, (0.95, 0.45, 0.08, 1.0))
_DISTANCE, _AZIMUTH, _ELEVATION = 2.6, 140.0, -35.0  # camera behind a robot [m, deg, deg]


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
