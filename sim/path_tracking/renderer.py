"""Rendering of the robots with their paths and trails: images, and a window."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import mujoco
import numpy as np

from sim.opengl import TaskRenderer, place
from sim.path_tracking.tracking import PathTracking
from sim.robot.looks import RobotLooks, robot_looks
from trackslip.kinematics import Array

_SPACING = 0.03  # smallest length of a segment of a drawn line [m]
# of a drawn line: height above the ground and half width [m], colour
_PATH, _TRAIL = (0.004, 0.012, (0.10, 0.36, 0.85, 1.0)), (0.014, 0.008, (0.95, 0.45, 0.08, 1.0))
_DISTANCE, _AZIMUTH, _ELEVATION = 2.6, 140.0, -35.0  # of the camera that follows a robot [m, deg, deg]


class PathRenderer(TaskRenderer):
    """Draws a robot with its visuals, its reference path (blue) and its trail (orange)."""

    def __init__(self, tracking: PathTracking) -> None:
        super().__init__()
        self._tracking = tracking
        self._looks: RobotLooks
        self._trails: list[list[Array]] = [[] for _ in range(tracking.size)]

    def begin(self, rows: Sequence[int]) -> None:
        """Start new trails for the robots `rows`."""
        pose = self._tracking.fleet.pose()
        for row in rows:
            self._trails[row] = [pose[row, :2]]

    def follow(self) -> None:
        """Extend the trails to the present positions."""
        for trail, position in zip(self._trails, self._tracking.fleet.pose()[:, :2], strict=True):
            if not trail or np.linalg.norm(position - trail[-1]) > _SPACING:
                trail.append(position)

    def camera(self, row: int) -> mujoco.MjvCamera:
        """See TaskRenderer."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (*self.data.qpos[:2], 0.2)
        camera.distance, camera.azimuth, camera.elevation = _DISTANCE, _AZIMUTH, _ELEVATION
        return camera

    def pose(self, row: int) -> None:
        """See TaskRenderer; the model is compiled when it is first needed."""
        if self.data is None:
            self._looks = robot_looks(self._tracking.config.parameters)
            self.data = mujoco.MjData(self._looks.model)
        qpos = self._looks.rest.copy()
        qpos[:7] = self._tracking.fleet.batch.qpos[row]
        place(self.data, qpos)

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append the tracks, the path and the trail."""
        travel = self._tracking.fleet.drive.angle[row] * self._tracking.config.parameters.sprocket_radius
        self._looks.draw(scene, self.data, travel[self._looks.track_side])
        path, kind = self._tracking.path(row)[:, :2], mujoco.mjtGeom.mjGEOM_CAPSULE
        for points, (height, width, colour) in ((_thinned(path), _PATH), (self._trails[row], _TRAIL)):
            for start, end in pairwise(points):
                if scene.ngeom == scene.maxgeom:
                    return
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(colour))
                mujoco.mjv_connector(geom, kind, width, np.append(start, height), np.append(end, height))
                scene.ngeom += 1


def _thinned(points: Array) -> Iterator[Array]:
    """Points (2,) of a line (T, 2) that are at least _SPACING apart."""
    last = points[0]
    yield last
    for point in points[1:]:
        if np.linalg.norm(point - last) > _SPACING:
            last = point
            yield last
