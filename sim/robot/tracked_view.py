"""Pictures of a tracked robot on its terrain, with belts and wheels that turn."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from sim.opengl import offscreen
from sim.robot.tracked_model import TrackedModel
from sim.tracks.drawing import TrackLook, draw
from trackslip.kinematics import Array

_AZIMUTH, _ELEVATION = 106.0, -21.0  # of the camera: it looks at the robot from the right, a little ahead of it [deg]
_AWAY = 2.8  # distance of the camera, in lengths of the robot
_CALM = 0.6  # share of the robot's heave that the camera follows


def track_looks(world: TrackedModel) -> list[tuple[int, TrackLook]]:
    """Bodies and visuals of T tracks, in the order of `world.track_side`."""
    robot = world.robot
    hull = np.array(robot.hull)
    chassis = [(world.body, TrackLook(hull, sign * robot.half_gauge, robot.width)) for sign in (1.0, -1.0)]
    flippers = [(world.model.body(f.body).id, TrackLook(np.array(f.hull), f.y, f.width)) for f in robot.flippers]
    return chassis + flippers


class TrackedView:
    """Draws a robot's tracks into scenes, and pictures of it."""

    def __init__(self, world: TrackedModel, width: int = 960, height: int = 540) -> None:
        """Draw `world`, which must be built with its looks, in pictures (height, width)."""
        self._world, self._size = world, (width, height)
        self._looks = track_looks(world)
        self._renderer: Any = None
        x, _, radius = np.array([wheel for _, look in self._looks for wheel in look.hull]).T
        self._length = float((x + radius).max() - (x - radius).min())

    def draw(self, scene: mujoco.MjvScene, data: mujoco.MjData, travel: Array) -> None:
        """Append the tracks to a scene, after their belts have driven `travel` (T,) [m] forwards."""
        for (body, look), way in zip(self._looks, travel, strict=True):
            draw(scene, look.pieces(way), data.xpos[body], data.xmat[body].reshape(3, 3))

    def picture(self, data: mujoco.MjData, travel: Array, height: float = 0.0) -> np.ndarray:
        """Picture (height, width, 3) uint8 by a camera that moves with the robot, above ground of some height [m].

        Raises TrackslipError if OpenGL doesn't work here.
        """
        if self._renderer is None:
            self._renderer = offscreen(self._world.model, *self._size)
        self._renderer.update_scene(data, camera=self.camera(data, height))
        self.draw(self._renderer.scene, data, travel)
        return np.array(self._renderer.render())

    def camera(self, data: mujoco.MjData, height: float = 0.0) -> mujoco.MjvCamera:
        """The camera that moves with the robot without turning."""
        camera = mujoco.MjvCamera()
        x, y, z = data.xpos[self._world.body]
        camera.lookat[:] = x, y, height + _CALM * (z - height) + self._length / 6
        camera.distance, camera.azimuth, camera.elevation = _AWAY * self._length, _AZIMUTH, _ELEVATION
        return camera

    def close(self) -> None:
        """Free the buffers of pictures."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None
