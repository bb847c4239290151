"""Driving with the keyboard, in MuJoCo's viewer."""

from __future__ import annotations

import time

import mujoco
import numpy as np

from experiments.drive.course import PERIOD, DrivenCourse, drive_course
from experiments.drive.world import CourseWorld
from sim.opengl import Window
from sim.robot.tracked_model import TrackedModel
from sim.robot.tracked_view import TrackedView
from sim.traverse.states import States
from sim.traverse.world import Traverse
from trackslip.kinematics import Array

_UP, _DOWN, _LEFT, _RIGHT, _SPACE = 265, 264, 263, 262, 32  # codes of keys, as GLFW numbers them
_PAGE_UP, _PAGE_DOWN, _HOME, _END = 266, 267, 268, 269
_FASTER, _TURN = 0.05, 0.1  # a press of a key [m/s], [rad/s]
_LIFT = 0.1  # of flippers, a press of a key [rad]
HELP = (
    "arrow keys: faster, slower, left, right; space: stop; "
    "Home, End: front flippers up, down; Page Up, Page Down: rear flippers up, down; close the window to end"
)
_BETWEEN = 0.03  # pictures, at least [s]


class Keyboard:
    """A pilot whose set points keys change; each press of a key changes one by a step."""

    def __init__(self, world: TrackedModel, top_speed: float, by_reflex: bool, angles: Array) -> None:
        """Start at rest with flippers at angles (F,) [rad], or by reflex until a key moves them."""
        self._half_gauge, self._top_speed = world.robot.half_gauge, top_speed
        self._front, self._range = world.flipper_front, world.flipper_range
        self.speed, self.turn = 0.0, 0.0  # [m/s], [rad/s]
        self.by_reflex, self.angles = by_reflex, np.array(angles, float)

    def press(self, key: int) -> None:
        """React to a key."""
        if key in (_UP, _DOWN):
            change = _FASTER if key == _UP else -_FASTER
            self.speed = float(np.clip(round(self.speed + change, 6), -self._top_speed, self._top_speed))
        elif key in (_LEFT, _RIGHT):
            most = self._top_speed / self._half_gauge
            change = _TURN if key == _LEFT else -_TURN
            self.turn = float(np.clip(round(self.turn + change, 6), -most, most))
        elif key == _SPACE:
            self.speed = self.turn = 0.0
        elif key in (_HOME, _END, _PAGE_UP, _PAGE_DOWN):
            moved = self._front if key in (_HOME, _END) else ~self._front
            change = _LIFT if key in (_HOME, _PAGE_UP) else -_LIFT
            self.angles = np.clip(self.angles + change * moved, *self._range.T)
            self.by_reflex = False

    def __call__(self, state: States) -> Array:
        """See `Pilot`."""
        outwards = self.turn * self._half_gauge
        return np.array([self.speed - outwards, self.speed + outwards])


class Teleop:
    """The viewer that shows a robot as it is driven, no faster than real time; call it after each period."""

    def __init__(self, looks: TrackedModel, keyboard: Keyboard) -> None:
        """Open the viewer on the model `looks`, which is only drawn; TrackslipError without a display."""
        self._looks, self._view, self._keyboard = looks, TrackedView(looks), keyboard
        self._data = mujoco.MjData(looks.model)
        self._window = Window(self._data, keyboard.press, panels=False)
        self._travel: Array = np.zeros(len(looks.track_side))
        self._began, self._next = time.monotonic(), 0.0  # real time of the start, and of the next picture [s]
        camera, viewer = self._view.camera(self._data), self._window.viewer
        with viewer.lock():  # its camera follows the chassis
            viewer.cam.type, viewer.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, looks.body
            viewer.cam.distance, viewer.cam.azimuth = camera.distance, camera.azimuth
            viewer.cam.elevation = camera.elevation

    def __call__(self, world: Traverse) -> bool:
        """Show the state; False once the window is closed."""
        if not self._window.viewer.is_running():
            return False
        self._travel = self._travel + world.contact.belt[0] * PERIOD
        now = time.monotonic()
        if now >= self._next:
            self._show(world)
            drawn = time.monotonic()
            self._next = drawn + max(_BETWEEN, drawn - now)  # drawing takes half of the time at most
        ahead = self._began + float(world.time[0]) - time.monotonic()
        if ahead < 0:  # fallen behind: go on from here
            self._began -= ahead
        time.sleep(max(0.0, ahead))
        return True

    def _show(self, world: Traverse) -> None:
        viewer = self._window.viewer
        with viewer.lock():
            self._data.qpos[:] = world.state.qpos[0]
            mujoco.mj_kinematics(self._looks.model, self._data)
            mujoco.mj_camlight(self._looks.model, self._data)
            viewer.user_scn.ngeom = 0
            self._view.draw(viewer.user_scn, self._data, self._travel)
        now = f"{self._keyboard.speed:+.2f} m/s\n{self._keyboard.turn:+.1f} rad/s\n{world.time[0]:.1f} s"
        viewer.set_texts((None, None, "speed\nturn\ntime", now))
        viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._window.close()


def teleoperate(world: CourseWorld) -> DrivenCourse:
    """Drive by the keyboard, in the viewer; raises TrackslipError without a display."""
    by_reflex = world.config.flipper_angles() is None
    keyboard = Keyboard(world.traverse.tracked, world.traverse.servos.top_speed, by_reflex, world.set_angles)
    viewer, reflex = Teleop(world.with_looks(), keyboard), world.flippers()
    print(HELP, flush=True)
    try:
        return drive_course(
            world.traverse,
            keyboard,
            lambda traverse: reflex(traverse) if keyboard.by_reflex else keyboard.angles,
            watch=viewer,
        )
    finally:
        viewer.close()
