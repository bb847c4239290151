"""Driving with the keyboard, in MuJoCo's viewer."""

import time
from collections.abc import Callable

import mujoco
import numpy as np

from experiments.drive.course import DrivenCourse, drive_course
from sim.opengl import Window, place
from sim.robot.looks import TrackedView
from sim.robot.tracked_model import TrackedModel
from sim.traverse.world import Command, Traverse
from trackslip.kinematics import Array, track_speeds

HELP = (
    "arrow keys: faster, slower, left, right; space: stop; "
    "Home, End: front flippers up, down; Page Up, Page Down: rear flippers up, down; close the window to end"
)
SPACE = 32
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
_EVERY = 2  # one row in so many is shown


class Keyboard:
    """Set points that keys change, by a step each."""

    def __init__(self, world: Traverse) -> None:
        self._world = world
        self._most = world.servos.top_speed * np.array([1.0, 1 / world.tracked.robot.half_gauge])
        self.twist: Array = np.zeros(2)
        """Speed and yaw rate [m/s], [rad/s]."""
        self.angles: Array | None = None
        """Angles (1, F) of the flippers, tips up; None until a key moves them [rad]."""

    def press(self, key: int) -> None:
        """React to a key."""
        if key == SPACE:
            self.twist = np.zeros(2)
        if key not in _STEPS:
            return
        faster, left, front, rear = _STEPS[key]
        self.twist = np.clip(self.twist + np.array([faster, left]), -self._most, self._most)
        if front or rear:
            step = np.where(self._world.tracked.flipper_front, front, rear)
            angles = self._world.servo.angle if self.angles is None else self.angles
            self.angles = np.clip(angles + step, *self._world.tracked.flipper_range.T)


def teleoperate(world: Traverse, looks: TrackedModel, flippers: Callable[[Traverse], Array]) -> DrivenCourse:
    """Drive by the keyboard, in a window on the model `looks`, no faster than real time.

    `flippers` gives the angles (1, F) until a key moves them. Raises TrackslipError without a display.
    """
    data, keyboard, view = mujoco.MjData(looks.model), Keyboard(world), TrackedView(looks)
    window = Window(data, keyboard.press, panels=False)
    viewer, travel, shown = window.viewer, np.zeros(len(looks.track_side)), time.monotonic()
    with viewer.lock():
        viewer.cam.type, viewer.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, looks.body
        viewer.cam.distance = view.camera(data).distance

    def driver(world: Traverse) -> Command | None:
        nonlocal travel, shown
        if not viewer.is_running():
            return None
        travel = travel + world.contact.belt[0] * world.period
        if round(world.time[0] / world.period) % _EVERY == 0:
            with viewer.lock():
                place(data, world.state.qpos[0])
                viewer.user_scn.ngeom = 0
                view.draw(viewer.user_scn, data, travel)
            now = "{:+.2f} m/s\n{:+.1f} rad/s\n{:.1f} s".format(*keyboard.twist, world.time[0])
            viewer.set_texts((None, None, "speed\nturn\ntime", now))
            viewer.sync()
            time.sleep(max(0.0, shown + _EVERY * world.period - time.monotonic()))
            shown = time.monotonic()
        angles = flippers(world) if keyboard.angles is None else keyboard.angles
        return Command(track_speeds(keyboard.twist[None], world.tracked.robot.half_gauge), angles)

    print(HELP, flush=True)
    try:
        return drive_course(world, driver)
    finally:
        window.close()
