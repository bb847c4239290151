import mujoco
import numpy as np
import pytest
from tracked import add_robot, built, plane


@pytest.fixture
def robot():
    spec = plane()
    add_robot(spec)
    return built(spec)


def test_slip_in_a_turn_is_that_of_the_track_over_the_ground(robot):
    model, data, belts = robot
    speeds = np.array([0.1, 0.3])
    belts.set(model, speeds)
    mujoco.mj_step(model, data, 1000)
    twist = data.qvel.copy()  # of the state that the last step began with, to within a step
    forwards = data.xmat[1].reshape(3, 3)[:, 0] @ twist[:3]
    over_ground = forwards + np.array([-0.2, 0.2]) * twist[5]
    reading = belts.read(model, data)
    np.testing.assert_allclose(reading.slip, 1 - over_ground / speeds, atol=1e-4)
    np.testing.assert_allclose(reading.sliding, speeds - over_ground, atol=1e-5)


def test_tracks_share_the_pull_on_a_slope(robot):
    model, data, belts = robot
    model.opt.gravity[:] = [-9.81 * np.sin(0.3), 0, -9.81 * np.cos(0.3)]
    belts.set(model, [0.2, 0.2])
    mujoco.mj_step(model, data, 1000)
    reading = belts.read(model, data)
    np.testing.assert_allclose(reading.traction, 25 * 9.81 * np.sin(0.3) / 2, rtol=1e-3)
    np.testing.assert_allclose(reading.load, 25 * 9.81 * np.cos(0.3) / 2, rtol=1e-3)


def test_a_track_in_the_air_has_no_slip(robot):
    model, data, belts = robot
    belts.set(model, [0.2, 0.2])
    data.qpos[2] = 1.0
    mujoco.mj_step(model, data)
    reading = belts.read(model, data)
    assert not reading.touching.any()
    assert np.isnan(reading.slip).all()
    assert np.isnan(reading.sliding).all()
    np.testing.assert_array_equal([reading.traction, reading.load, reading.depth], np.zeros((3, 2)))


def test_wheels_on_an_edge_pull_along_the_belt_there():
    """A wheel before a high step: the belt's force is tangential, and turns with the normal."""
    spec = plane()
    spec.worldbody.add_geom(name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 1, 0.5], pos=[0.43, 0, 0.5])
    add_robot(spec)
    model, data, belts = built(spec, terrain=["ground", "wall"])
    belts.set(model, [0.1, 0.1])
    mujoco.mj_step(model, data, 300)
    wall = model.geom("wall").id
    assert (data.contact.geom == wall).any()
    reading, pull, load = belts.read(model, data), 0.0, 0.0
    for i, contact in enumerate(data.contact):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, force)
        load += force[0]
        out = contact.frame[:3] * (1 if contact.geom[1] < contact.geom[0] else -1)  # from the track
        ahead = np.cross([0, 1, 0], -out)
        on_track = contact.frame.reshape(3, 3).T @ force[:3] * (1 if contact.geom[1] > contact.geom[0] else -1)
        pull += ahead @ on_track
    np.testing.assert_allclose(reading.traction.sum(), pull, rtol=1e-4)
    np.testing.assert_allclose(reading.load.sum(), load, rtol=1e-9)
    assert pull > 0
