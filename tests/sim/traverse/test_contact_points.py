"""Contacts found again from states."""

import mujoco
import numpy as np
import pytest

from sim.robot.tracked import load_tracked
from sim.robot.tracked_model import build_tracked
from sim.tracks import bind
from sim.traverse.contact import ContactPoints


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_forces_of_a_standing_robot_add_up_to_its_weight(speed):
    world = build_tracked(load_tracked("box"))
    model, data = world.model, mujoco.MjData(world.model)
    belts = bind(model, *world.tracks)
    belts.set(model, np.full(2, speed))
    for _ in range(1000):
        mujoco.mj_step(model, data)
    points, forces = ContactPoints(world).at(data.qpos, data.qvel, np.full(2, speed), np.zeros(0))
    assert len(points) > 10
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, 9.81 * 25], atol=0.5)
    assert (forces[:, 2] > 0).all()
    np.testing.assert_allclose(np.abs(points[:, 1]), 0.17, atol=1e-6)
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-3)
    assert belts.read(model, data).load.sum() == pytest.approx(forces[:, 2].sum(), rel=1e-3)


def test_in_the_air_there_are_none():
    world = build_tracked(load_tracked("box"))
    qpos = world.model.qpos0.copy()
    qpos[2] = 1.0
    points, forces = ContactPoints(world).at(qpos, np.zeros(world.model.nv), np.zeros(2), np.zeros(0))
    assert points.shape == forces.shape == (0, 3)
