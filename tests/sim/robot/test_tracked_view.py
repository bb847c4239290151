"""Pictures of a robot with tracks."""

import mujoco
import numpy as np
import pytest

from sim.robot.tracked import load_tracked
from sim.robot.tracked_model import build_tracked
from sim.robot.tracked_view import TrackedView
from trackslip.errors import TrackslipError


@pytest.mark.filterwarnings("ignore")  # of drivers
def test_belts_and_wheels_turn_in_pictures_and_nothing_else_does():
    world = build_tracked(load_tracked("rescue"), looks=True)
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    view = TrackedView(world, 320, 180)
    count = len(world.track_side)
    try:
        still = view.picture(data, np.zeros(count))
    except TrackslipError as error:
        pytest.skip(str(error))
    again, moved = view.picture(data, np.zeros(count)), view.picture(data, np.full(count, 0.1))
    view.close()
    assert still.shape == (180, 320, 3)
    np.testing.assert_array_equal(still, again)
    changed = np.abs(moved.astype(int) - still).max(axis=2) > 40
    assert 50 < changed.sum() < 0.1 * changed.size
    yellow = (still[..., 0] > 150) & (still[..., 2] < 60)
    assert yellow.sum() > 300


def test_without_opengl_it_says_so(monkeypatch):
    def broken(*_):
        raise mujoco.FatalError("no OpenGL")

    monkeypatch.setattr(mujoco, "Renderer", broken)
    world = build_tracked(load_tracked("box"), looks=True)
    with pytest.raises(TrackslipError, match="no OpenGL works here"):
        TrackedView(world).picture(mujoco.MjData(world.model), np.zeros(2))
