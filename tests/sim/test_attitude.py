"""Attitudes against SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import attitude

EULER = np.random.default_rng(0).uniform(-1.2, 1.2, (50, 3))  # yaw, then nose down, then leaning to the right
TURNED = Rotation.from_euler("ZYX", EULER)
QUATERNION = TURNED.as_quat(scalar_first=True)


def test_axes_and_angles_are_those_of_the_rotation():
    np.testing.assert_allclose(attitude.rotation(QUATERNION), TURNED.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(attitude.heading(QUATERNION), EULER[:, 0], atol=1e-12)
    np.testing.assert_allclose(attitude.pitch(QUATERNION), -EULER[:, 1], atol=1e-12)
    np.testing.assert_allclose(attitude.roll(QUATERNION), EULER[:, 2], atol=1e-12)
    np.testing.assert_allclose(attitude.upright(QUATERNION), TURNED.as_matrix()[:, 2, 2], atol=1e-12)


def test_a_robot_leans_to_its_right_with_its_left_side_up():
    left_up = Rotation.from_euler("x", 0.2)
    assert left_up.as_matrix()[2, 1] > 0
    assert attitude.roll(left_up.as_quat(scalar_first=True)) == pytest.approx(0.2)
