"""Rendering of the robots with their paths and trails: images, and a window."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from sim.opengl import Window, offscreen
from sim.path_tracking.tracking import PathTracking
from sim.robot.robot import FIELD
from trackslip.kinematics import Array

WIDTH, HEIGHT = 640, 480
_SPACING = 0.03  # smallest length of a segment of a drawn line [m]
# of a drawn line: height above the ground and half width [m], colour
_PATH, _TRAIL = (0.004, 0.012, (0.10, 0.36, 0.85, 1.0)), (0.014, 0.008, (0.95, 0.45, 0.08, 1.0))
_DISTANCE, _AZIMUTH, _ELEVATION = 2.6, 140.0, -35.0  # of the camera that follows a robot [m, deg, deg]


class Renderer:
    """Draws a robot with its visuals, its reference path (blue) and its trail (orange)."""

    def __init__(self, tracking: PathTracking) -> None:
        self._tracking = tracking
        self._data: Any = None
        self._renderer: Any = None
        self._window: Window | None = None
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

    def picture(self, row: int) -> np.ndarray:
        """Image (HEIGHT, WIDTH, 3) uint8 of robot `row`; raises TrackslipError if OpenGL doesn't work."""
        data = self._posed(row)
        if self._renderer is None:
            self._renderer = offscreen(data.model, WIDTH, HEIGHT)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (*data.qpos[:2], 0.2)
        camera.distance, camera.azimuth, camera.elevation = _DISTANCE, _AZIMUTH, _ELEVATION
        self._renderer.update_scene(data, camera=camera)
        self._draw(self._renderer.scene, row)
        return np.array(self._renderer.render())

    def show(self) -> None:
        """Show robot 0 in a window; raises TrackslipError if there is no display."""
        if self._window is None:
            self._window = Window(self._posed(0))
        viewer = self._window.viewer
        with viewer.lock():
            self._posed(0)
            viewer.user_scn.ngeom = 0
            self._draw(viewer.user_scn, 0)
        viewer.sync()

    def close(self) -> None:
        """Close the window and free the image buffers."""
        for opened in filter(None, (self._renderer, self._window)):
            opened.close()
        self._renderer = self._window = None

    def _posed(self, row: int) -> Any:
        """Data of the model with visuals, which is compiled when first needed, in the state of robot `row`."""
        if self._data is None:
            spec = mujoco.MjSpec.from_file(str(FIELD))
            self._tracking.config.robot.apply(spec)
            self._data = mujoco.MjData(spec.compile())
        self._data.qpos[:] = self._tracking.fleet.batch.qpos[row]
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            compute(self._data.model, self._data)
        return self._data

    def _draw(self, scene: mujoco.MjvScene, row: int) -> None:
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
