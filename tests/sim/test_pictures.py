import importlib
import sys

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from sim.terrain import Course, Flat
from trackslip.errors import InvalidValueError, TrackslipError

TRACKING = "sim:trackslip/PathTracking-v0"
TRAVERSE = "sim:trackslip/Traverse-v0"


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
    path = (blue > red + 60) & (blue > green)
    trail = (red > blue + 90) & (red > green + 40)
    return int({"blue": path, "orange": trail}[colour].sum())


@pytest.mark.filterwarnings("ignore")  # of drivers
@pytest.mark.usefixtures("opengl")
def test_pictures_show_the_robot_its_path_and_its_trail():
    env = gym.make(TRACKING, render_mode="rgb_array", reference="circle", off_path=5.0).unwrapped
    env.reset(seed=0, options={"start_error": (0.0, 0.0, 1.0)})
    turned = env.render()
    env.reset(seed=0)
    before = env.render()
    # only the robot has turned
    difference = np.abs(turned.astype(int) - before).max(axis=2)
    assert (difference > 50).sum() > 500
    assert before.shape == (480, 640, 3)
    assert before.dtype == np.uint8
    assert pixels(before, "blue") > 200
    for _ in range(60):
        env.step(np.array([0.7, 0.7], np.float32))
    after = env.render()
    assert pixels(after, "orange") > pixels(before, "orange") + 50
    env.close()


@pytest.mark.usefixtures("opengl")
def test_courses_have_a_line_every_metre():
    """Seen from above by a camera without perspective, 4 m wide."""
    course = Course((Flat(5.0),), width=6.0)
    spec = mujoco.MjSpec()
    course.add_to(spec)
    camera = spec.worldbody.add_camera(name="above", pos=[2.5, 0.5, 5.0], fovy=4.0)
    camera.proj = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 400, 400) as renderer:
        renderer.update_scene(data, "above")
        picture = renderer.render().astype(float).sum(axis=2)
    for axis in (0, 1):
        brightness = picture.mean(axis=axis)
        darker_than_beside = brightness[4:-4] < brightness[:-8] - 20
        darker_than_beside &= brightness[4:-4] < brightness[8:] - 20
        lines = 4 + np.flatnonzero(darker_than_beside)
        begins = lines[np.diff(lines, prepend=-9) > 1]
        assert len(begins) in (3, 4)
        np.testing.assert_allclose(np.diff(begins), 100, atol=1)


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
