"""Drawing of robots that follow paths: their references and trails."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import mujoco
import numpy as np

from sim.engine.opengl import place
from sim.learning.renderer import TaskRenderer
from sim.path_tracking.tracking import PathTracking
from sim.robot.looks import robot_looks
from trackslip.kinematics import Array

_SPACING: Final = 0.03  # smallest length of a drawn segment [m]


class _Line(NamedTuple):
    """How a line is drawn."""

    height: float  # above the ground [m]
    half_width: float  # [m]
    colour: tuple[float, float, float, float]  # red, green, blue, opacity


_PATH: Final = _Line(0.004, 0.012, (0.10, 0.36, 0.85, 1.0))
_TRAIL: Final = _Line(0.014, 0.008, (0.95, 0.45, 0.08, 1.0))
# camera behind a robot
_DISTANCE: Final = 2.6  # [m]
_AZIMUTH: Final = 140.0  # [deg]
_ELEVATION: Final = -35.0  # [deg]
_LOOK_AT: Final = 0.2  # height of the point in the middle of the picture [m]


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
        camera.lookat[:] = (*self.data.qpos[:2], _LOOK_AT)
        camera.distance = _DISTANCE
        camera.azimuth = _AZIMUTH
        camera.elevation = _ELEVATION
        return camera

    def pose(self, row: int) -> None:
        """Set `data` to the state of the robot `row`."""
        qpos = self.looks.rest.copy()
        qpos[:7] = self._tracking.fleet.batch.qpos[row]
        place(self.data, qpos)

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Append tracks, path and trail of the robot `row` to a scene."""
        radius = self._tracking.config.parameters.sprocket_radius
        travel = self._tracking.fleet.drive.angle[row] * radius
        self.looks.draw(scene, self.data, travel[self.looks.track_side])
        draw_path(scene, self._tracking.path(row)[:, :2])
        _draw_line(scene, self._trails[row], _TRAIL)


def draw_path(scene: mujoco.MjvScene, points: Array) -> None:
    """Append a reference path through points (n, 2) to a scene."""
    _draw_line(scene, points, _PATH)


def _draw_line(scene: mujoco.MjvScene, points: Array | list[Array], line: _Line) -> None:
    """Append a line through points (2,) to a scene, as far as the scene has room."""
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    for start, end in pairwise(_thinned(points)):
        if scene.ngeom == scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        colour = np.array(line.colour)
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        first = np.append(start, line.height)
        second = np.append(end, line.height)
        mujoco.mjv_connector(geom, kind, line.half_width, first, second)
        scene.ngeom += 1


def _thinned(points: Array | list[Array]) -> Iterator[Array]:
    """Points (2,) on a line (T, 2) that are at least _SPACING apart."""
    last = points[0]
    yield last
    for point in points[1:]:
        if np.linalg.norm(point - last) > _SPACING:
            last = point
            yield last
