import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trackslip.kinematics import (
    RobotGeometry,
    body_twist,
    curvature,
    limit_sprocket_speeds,
    sprocket_speeds,
    track_slip,
)

GEOMETRY = RobotGeometry(0.168, 0.06)
twists = arrays(float, (3, 2), elements=st.floats(-1, 1))
slips = arrays(float, (3, 2), elements=st.floats(-0.9, 0.9))


@given(twists, slips)
def test_forward_of_inverse_is_identity(twist, slip):
    omega = sprocket_speeds(twist, slip, GEOMETRY)
    np.testing.assert_allclose(body_twist(omega, slip, GEOMETRY), twist, atol=1e-12)


@given(arrays(float, (3, 2), elements=st.floats(0.1, 10)), slips)
def test_slip_is_what_made_the_twist(omega, slip):
    twist = body_twist(omega, slip, GEOMETRY)
    np.testing.assert_allclose(track_slip(omega, twist, GEOMETRY), slip, atol=1e-12)


def test_curvature_has_no_threshold():
    twist = [[1.0, 0.5], [0.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, 0.5], [1e-300, 0.0]]
    expected = [0.5, 0.0, -np.inf, np.inf, -0.5, 0.0]
    np.testing.assert_array_equal(curvature(twist), expected)


def test_slip_of_a_standing_sprocket_is_undefined():
    slip = track_slip([0.0, 1.0], [0.03, 0.0], GEOMETRY)
    assert np.isnan(slip).tolist() == [True, False]


@given(arrays(float, 2, elements=st.floats(-20, 20)))
def test_limiting_keeps_the_curvature(omega):
    limited = limit_sprocket_speeds(omega, 5.0)
    assert np.abs(limited).max() <= 5.0 * (1 + 1e-12)
    np.testing.assert_allclose(limited[0] * omega[1], limited[1] * omega[0], atol=1e-9)
    if np.abs(omega).max() <= 5:
        np.testing.assert_array_equal(limited, omega)


@given(arrays(float, (4, 3, 2), elements=st.floats(-20, 20)))
def test_each_robots_speeds_are_limited_on_their_own(omega):
    limited = limit_sprocket_speeds(omega, 5.0)
    alone = [limit_sprocket_speeds(each, 5.0) for each in omega.reshape(-1, 2)]
    np.testing.assert_array_equal(limited.reshape(-1, 2), alone)


def test_a_twist_is_that_of_the_tracks_by_hand():
    """The right track drives 0.3 m/s, slips by a third and moves by 0.2 m/s; the left one 0.1."""
    twist = body_twist([0.1 / 0.06, 0.3 / 0.06], [0.0, 1 / 3], GEOMETRY)
    np.testing.assert_allclose(twist, [0.15, 0.1 / 0.336])
