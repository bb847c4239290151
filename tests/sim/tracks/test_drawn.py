"""Tracks drawn into a scene."""

import mujoco
import numpy as np
from tracked import add_robot, built, plane

from sim.tracks import DrawnTracks


def test_belts_move_as_far_as_they_have_run_and_go_with_their_body():
    spec = plane()
    add_robot(spec)
    model, data, belts = built(spec)
    scene, drawn = mujoco.MjvScene(model, 1000), DrawnTracks(belts)

    def places():
        mujoco.mj_forward(model, data)
        scene.ngeom = 0
        drawn.draw(scene, data)
        return np.array([scene.geoms[k].pos for k in range(scene.ngeom)])

    first = places()
    np.testing.assert_allclose(np.abs(first[:, 1]), 0.2, atol=1e-6)
    belts.set([0.1, 0.0])
    data.time = 0.1
    later, left = places(), first[:, 1] > 0
    np.testing.assert_array_equal(later[~left], first[~left])
    lower = left & (first[:, 2] < 0.006) & (np.abs(first[:, 0]) < 0.2)  # shoes on the ground go backwards
    np.testing.assert_allclose(later[lower] - first[lower], [[-0.01, 0, 0]] * lower.sum(), atol=1e-6)
    assert lower.sum() > 5
    data.time = 0.0
    np.testing.assert_array_equal(places(), first)
    half = np.pi / 4
    data.qpos[:7] = 1.0, 2.0, 0.5, np.cos(half), 0, 0, np.sin(half)  # a quarter turn to the left
    turned = first @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [1.0, 2.0, 0.5]
    np.testing.assert_allclose(places(), turned, atol=1e-6)
