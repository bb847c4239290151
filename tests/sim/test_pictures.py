"""What environments and views draw: pictures, a window on a virtual display, and errors where nothing can be drawn."""

import importlib
import shutil
import subprocess
import sys

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from sim import build_tracked, load_tracked
from sim.opengl import Pictures
from sim.robot.looks import RobotLooks
from trackslip.errors import InvalidValueError, TrackslipError

TRACKING, TRAVERSE = "sim:trackslip/PathTracking-v0", "sim:trackslip/Traverse-v0"


@pytest.fixture(scope="module")
def opengl():
    for backend in ("egl", "osmesa"):
        try:
            context = importlib.import_module(f"mujoco.{backend}").GLContext(8, 8)
        except Exception:
            continue
        context.free()
        return backend
    pytest.skip("OpenGL doesn't work here")


def pixels(picture, colour):
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    path, trail = (blue > red + 60) & (blue > green), (red > blue + 90) & (red > green + 40)
    return int({"blue": path, "orange": trail}[colour].sum())


@pytest.mark.filterwarnings("ignore")  # of drivers
@pytest.mark.usefixtures("opengl")
def test_pictures_show_the_robot_its_path_and_its_trail():
    env = gym.make(TRACKING, render_mode="rgb_array", reference="circle", off_path=5.0).unwrapped
    env.reset(seed=0, options={"start_error": (0.0, 0.0, 1.0)})
    turned = env.render()
    env.reset(seed=0)
    before = env.render()
    assert (np.abs(turned.astype(int) - before).max(axis=2) > 50).sum() > 500  # only the robot has turned
    assert (before.shape, before.dtype) == ((480, 640, 3), np.uint8)
    assert pixels(before, "blue") > 200
    for _ in range(60):
        env.step(np.array([0.7, 0.7], np.float32))
    after = env.render()
    assert pixels(after, "orange") > pixels(before, "orange") + 50
    env.close()


@pytest.mark.filterwarnings("ignore")  # of drivers
@pytest.mark.usefixtures("opengl")
def test_belts_and_wheels_turn_in_pictures_and_nothing_else_does():
    world = build_tracked(load_tracked("rescue"), looks=True)
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    view, count, pictures = RobotLooks.of(world), len(world.track_side), Pictures(world.model, 320, 180)
    still, again, moved = (
        pictures.take(data, view.camera(data), lambda scene, way=way: view.draw(scene, data, np.full(count, way)))
        for way in (0.0, 0.0, 0.1)
    )
    pictures.close()
    assert still.shape == (180, 320, 3)
    np.testing.assert_array_equal(still, again)
    changed = np.abs(moved.astype(int) - still).max(axis=2) > 40
    assert 50 < changed.sum() < 0.1 * changed.size


def test_where_nothing_can_be_drawn_it_says_so(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)

    def broken(*_):
        raise mujoco.FatalError("no OpenGL")

    monkeypatch.setattr(mujoco, "Renderer", broken)
    for name in (TRACKING, TRAVERSE):
        env = gym.make(name, render_mode="rgb_array").unwrapped
        env.reset(seed=0)
        with pytest.raises(TrackslipError, match="no OpenGL works here"):
            env.render()
    with pytest.raises(InvalidValueError, match="render_mode"):
        gym.make(TRACKING).unwrapped.render()
    if sys.platform == "linux":
        with pytest.raises(TrackslipError, match="needs a display"):
            gym.make(TRACKING, render_mode="human").unwrapped.reset(seed=0)


DRIVE = """
import gymnasium, numpy as np
env = gymnasium.make("sim:trackslip/PathTracking-v0", render_mode="human", reference="circle")
env.reset(seed=0)
for _ in range(20):
    env.step(np.array([0.7, 0.7], np.float32))
"""


@pytest.mark.skipif(not shutil.which("xvfb-run"), reason="there is no virtual display")
@pytest.mark.slow
@pytest.mark.parametrize("end", ["env.close()", "pass"])
def test_a_window_follows_the_robot_and_closes(end):
    command = ["xvfb-run", "-a", sys.executable, "-c", DRIVE + end]
    driving = subprocess.run(command, text=True, capture_output=True, timeout=60)
    assert (driving.returncode, driving.stdout, driving.stderr) == (0, "", "")
