"""What `render` draws of the robots, their paths and trails; and what it says where nothing can be drawn."""

import os

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from trackslip.errors import InvalidValueError, TrackslipError

ID = "sim:trackslip/PathTracking-v0"


def opengl():
    for backend in ("egl", "osmesa"):
        try:
            context = __import__(f"mujoco.{backend}", fromlist=["GLContext"]).GLContext(8, 8)
        except Exception:
            continue
        context.free()
        return True
    return False


@pytest.mark.filterwarnings("ignore")  # of drivers
def test_pictures_show_the_robot_its_path_and_its_trail():
    if not opengl():
        pytest.skip("OpenGL doesn't work here")
    env = gym.make(ID, render_mode="rgb_array", reference="circle", off_path=5.0).unwrapped
    env.reset(seed=0)
    before = env.render()
    assert before.shape == (480, 640, 3)
    assert before.dtype == np.uint8

    def pixels(picture, colour):
        red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
        return int(((blue > red + 60) if colour == "blue" else (red > blue + 90) & (red > green + 40)).sum())

    assert pixels(before, "blue") > 200
    for _ in range(60):
        env.step(np.array([0.7, 0.7], np.float32))
    after = env.render()
    assert pixels(after, "orange") > pixels(before, "orange") + 50
    assert np.abs(after.astype(int) - before).max() > 50
    env.close()
    many = gym.make_vec(ID, num_envs=2, render_mode="rgb_array")
    many.reset(seed=0)
    assert [picture.shape for picture in many.render()] == [(480, 640, 3)] * 2
    many.close()


def test_where_nothing_can_be_drawn_it_says_so(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)

    def broken(*_):
        raise mujoco.FatalError("no OpenGL")

    monkeypatch.setattr(mujoco, "Renderer", broken)
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    with pytest.raises(TrackslipError, match="no OpenGL works here"):
        env.render()
    with pytest.raises(InvalidValueError, match="render_mode"):
        gym.make(ID).unwrapped.render()
    if os.name == "posix" and os.uname().sysname == "Linux":
        with pytest.raises(TrackslipError, match="needs a display"):
            gym.make(ID, render_mode="human").unwrapped.reset(seed=0)
