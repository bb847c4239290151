"""Tracks drawn into a scene."""

import mujoco
import numpy as np
import pytest
from tracked import HULL, add_robot, plane

from sim.tracks import Belts, DrawnTracks, Track, add_tracks


@pytest.fixture
def robot():
    spec = plane()
    body = add_robot(spec)
    add_tracks(spec, body, Track(half_gauge=0.2, hull=HULL), terrain=["ground"])
    return spec.compile()


def places(scene):
    return np.array([scene.geoms[k].pos for k in range(scene.ngeom)])


def test_belts_move_as_far_as_they_have_run(robot):
    model = robot
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 1000)
    drawn, belts = DrawnTracks(Belts(model)), Belts(model)
    mujoco.mj_forward(model, data)

    def seen():
        scene.ngeom = 0
        drawn.draw(scene, data)
        return places(scene)

    first = seen()
    assert (np.abs(np.abs(first[:, 1]) - 0.2) < 1e-6).all()
    np.testing.assert_array_equal(first, seen())
    belts.set([0.1, 0.0])
    data.time = 0.1
    later = seen()
    left = first[:, 1] > 0
    np.testing.assert_array_equal(later[~left], first[~left])
    lower = left & (first[:, 2] < 0.01) & (np.abs(first[:, 0]) < 0.2)  # shoes on the ground go backwards
    np.testing.assert_allclose(later[lower] - first[lower], [[-0.01, 0, 0]] * lower.sum(), atol=1e-6)
    assert lower.sum() > 5
    data.time = 0.0
    np.testing.assert_array_equal(seen(), first)


def test_they_go_with_their_body(robot):
    model = robot
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 1000)
    drawn = DrawnTracks(Belts(model))
    mujoco.mj_forward(model, data)
    drawn.draw(scene, data)
    before = places(scene)
    half = np.pi / 4
    data.qpos[:7] = 1.0, 2.0, 0.5, np.cos(half), 0, 0, np.sin(half)  # a quarter turn to the left
    mujoco.mj_forward(model, data)
    scene.ngeom = 0
    drawn.draw(scene, data)
    turned = before @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [1.0, 2.0, 0.5]
    np.testing.assert_allclose(places(scene), turned, atol=1e-6)
