"""Attitudes against SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.world import States

EULER = np.random.default_rng(0).uniform(-1.2, 1.2, (50, 3))  # yaw, then nose down, then leaning to the right
TURNED = Rotation.from_euler("ZYX", EULER)


def states(turned):
    quaternion = turned.as_quat(scalar_first=True)
    return States(np.concatenate([np.zeros((*quaternion.shape[:-1], 3)), quaternion], axis=-1), np.zeros(6))


def test_axes_and_angles_are_those_of_the_rotation():
    state = states(TURNED)
    np.testing.assert_allclose(state.rotation, TURNED.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(state.heading, EULER[:, 0], atol=1e-12)
    np.testing.assert_allclose(state.pitch, -EULER[:, 1], atol=1e-12)
    np.testing.assert_allclose(state.roll, EULER[:, 2], atol=1e-12)
    np.testing.assert_allclose(state.upright, TURNED.as_matrix()[:, 2, 2], atol=1e-12)


def test_a_robot_leans_to_its_right_with_its_left_side_up():
    left_up = Rotation.from_euler("x", 0.2)
    assert left_up.as_matrix()[2, 1] > 0
    assert states(left_up).roll == pytest.approx(0.2)
