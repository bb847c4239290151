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

_SPACE = 32
_STEPS = {  # by a key, as GLFW numbers it: changes of speed [m/s], turn [rad/s], front and rear flippers [rad]
    265: (0.05, 0.0, 0.0, 0.0),  # up
    264: (-0.05, 0.0, 0.0, 0.0),  # down
    263: (0.0, 0.1, 0.0, 0.0),  # left
    262: (0.0, -0.1, 0.0, 0.0),  # right
    268: (0.0, 0.0, 0.1, 0.0),  # Home
    269: (0.0, 0.0, -0.1, 0.0),  # End
    266: (0.0, 0.0, 0.0, 0.1),  # Page Up
    267: (0.0, 0.0, 0.0, -0.1),  # Page Down
}
HELP = (
    "arrow keys: faster, slower, left, right; space: stop; "
    "Home, End: front flippers up, down; Page Up, Page Down: rear flippers up, down; close the window to end"
)
_BETWEEN = 0.03  # time between pictures, at least [s]


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
        if key == _SPACE:
            self.speed = self.turn = 0.0
        if key not in _STEPS:
            return
        faster, left, front, rear = _STEPS[key]
        most_turn = self._top_speed / self._half_gauge
        self.speed = float(np.clip(self.speed + faster, -self._top_speed, self._top_speed))
        self.turn = float(np.clip(self.turn + left, -most_turn, most_turn))
        if front or rear:
            self.angles = np.clip(self.angles + np.where(self._front, front, rear), *self._range.T)
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
