"""A tracked robot as it is drawn on its terrain: belts and wheels that turn, and the camera that follows it."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.robot.parameters import WHEELS
from sim.robot.tracked_model import TrackedModel
from sim.tracks.drawing import TrackLook, WheelLook, draw
from trackslip.kinematics import Array

_AZIMUTH, _ELEVATION = 106.0, -21.0  # of the camera: it looks at the robot from the right, a little ahead of it [deg]
_AWAY = 2.8  # distance of the camera, in lengths of the robot
_CALM = 0.6  # share of the robot's heave that the camera follows


def track_looks(world: TrackedModel) -> list[tuple[int, TrackLook]]:
    """Bodies and visuals of T tracks, in the order of `world.track_side`."""
    robot = world.robot
    hull = np.array(robot.hull)
    look = WheelLook if robot.contact == WHEELS else TrackLook
    chassis = [(world.body, look(hull, sign * robot.half_gauge, robot.width)) for sign in (1.0, -1.0)]
    flippers = [(world.model.body(f.body).id, TrackLook(np.array(f.hull), f.y, f.width)) for f in robot.flippers]
    return chassis + flippers


class TrackedView:
    """Draws a robot's tracks into scenes."""

    def __init__(self, world: TrackedModel) -> None:
        """Draw `world`, which must be built with its looks."""
        self._world = world
        self._looks = track_looks(world)
        x, _, radius = np.array([wheel for _, look in self._looks for wheel in look.hull]).T
        self._length = float((x + radius).max() - (x - radius).min())

    def draw(self, scene: mujoco.MjvScene, data: mujoco.MjData, travel: Array) -> None:
        """Append the tracks to a scene, after their belts have driven `travel` (T,) [m] forwards."""
        for (body, look), way in zip(self._looks, travel, strict=True):
            draw(scene, look.pieces(way), data.xpos[body], data.xmat[body].reshape(3, 3))

    def camera(self, data: mujoco.MjData, height: float = 0.0) -> mujoco.MjvCamera:
        """The camera that moves with the robot without turning."""
        camera = mujoco.MjvCamera()
        x, y, z = data.xpos[self._world.body]
        camera.lookat[:] = x, y, height + _CALM * (z - height) + self._length / 6
        camera.distance, camera.azimuth, camera.elevation = _AWAY * self._length, _AZIMUTH, _ELEVATION
        return camera
