import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackslip.controllers import Feedforward, LinearTimeVarying
from trackslip.errors import InvalidValueError
from trackslip.kinematics import advance
from trackslip.metrics import body_errors
from trackslip.trajectory import circle, paper_reference


def test_feedforward_ignores_the_pose():
    reference = paper_reference()
    twist = Feedforward().twist(20.0, np.random.default_rng(0).normal(size=(4, 3)), reference)
    np.testing.assert_allclose(twist, np.tile([0.15, 0.12], (4, 1)))


@given(st.floats(0.02, 0.5), st.floats(-0.5, 0.5), st.floats(0.2, 1.5), st.floats(1.0, 40.0))
def test_gains_give_the_papers_closed_loop_polynomial(v, w, damping, stiffness):
    """Eq. 25 with the error dynamics of Eq. 20, built by hand."""
    k1, k2, k3 = LinearTimeVarying(damping, stiffness).gains([v, w])
    a = np.sqrt(w**2 + stiffness * v**2)
    closed_loop = np.array([[-k1, w, 0], [-w, 0, v], [0, -k2, -k3]])
    wanted = np.polymul([1, 2 * damping * a], [1, 2 * damping * a, a**2])
    np.testing.assert_allclose(np.poly(closed_loop), wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("speed", [0.15, -0.15])
def test_linearisation_of_the_controller_by_finite_differences(speed):
    """The twist's derivative with respect to the body-frame error is what Eq. 24 says, driving either way."""
    reference = circle(1.25, speed, 40.0)
    controller = LinearTimeVarying()
    k1, k2, k3 = controller.gains(reference.twist(5.0))
    desired = reference.pose(5.0)
    cos, sin = np.cos(desired[2]), np.sin(desired[2])
    h = 1e-6
    derivative = np.zeros((2, 3))
    for k, error in enumerate(np.eye(3) * h):
        offset = np.array([cos * error[0] - sin * error[1], sin * error[0] + cos * error[1], error[2]])
        np.testing.assert_allclose(body_errors(desired - offset, desired), error, atol=1e-11)
        difference = controller.twist(5.0, desired - offset, reference) - controller.twist(
            5.0, desired + offset, reference
        )
        derivative[:, k] = difference / (2 * h)
    np.testing.assert_allclose(derivative, [[k1, 0, 0], [0, k2 * np.sign(speed), k3]], atol=1e-6)


def test_linear_controller_converges_on_an_ideal_robot():
    reference = paper_reference()
    controller = LinearTimeVarying()
    pose = np.array([[0.3, -0.2, np.pi / 3], [-0.3, 0.2, 2 * np.pi / 3], [0.1, 0.3, np.pi / 2]])
    step = 0.01
    for k in range(4000):
        pose = advance(pose, controller.twist(k * step, pose, reference), step)
    error = body_errors(pose, reference.pose(4000 * step))
    assert np.abs(error).max() < 2e-3


@pytest.mark.parametrize("field", ["damping", "stiffness"])
def test_gains_must_be_positive(field):
    with pytest.raises(InvalidValueError, match=field):
        LinearTimeVarying(**{field: 0.0})
