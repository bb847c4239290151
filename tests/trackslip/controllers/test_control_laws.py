"""The static laws about their reference, against their closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from linearised import closed_loop, error_gains, pose_with_error

from trackslip.controllers.error_feedback import Kanayama, LinearTimeVarying, OffsetPoint, Samson
from trackslip.controllers.steering import PathAhead, PurePursuit, Stanley
from trackslip.kinematics import advance
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle

SPEEDS = pytest.mark.parametrize("speed", [0.15, -0.15])
RADII = pytest.mark.parametrize("radius", [1.25, -0.7])


@given(st.floats(0.02, 0.5), st.floats(-0.5, 0.5), st.floats(0.2, 1.5), st.floats(1.0, 40.0))
def test_gains_give_the_papers_closed_loop_polynomial(v, w, damping, stiffness):
    """Eq. 25 with the error dynamics of Eq. 20, built by hand."""
    k1, k2, k3 = LinearTimeVarying(damping=damping, stiffness=stiffness).gains([v, w])
    a = np.sqrt(w**2 + stiffness * v**2)
    wanted = np.polymul([1, 2 * damping * a], [1, 2 * damping * a, a**2])
    matrix = closed_loop(np.array([[k1, 0, 0], [0, k2, k3]]), np.array([v, w]))
    np.testing.assert_allclose(np.poly(matrix), wanted, rtol=1e-9, atol=1e-12)


@SPEEDS
@RADII
@pytest.mark.parametrize("controller", [LinearTimeVarying(), Samson()])
def test_linear_and_samson_are_eq_31_to_first_order(controller, speed, radius):
    reference = circle(radius, speed, 40.0)
    k1, k2, k3 = LinearTimeVarying().gains(reference.twist(5.0))
    wanted = [[k1, 0, 0], [0, k2 * np.sign(speed), k3]]
    np.testing.assert_allclose(error_gains(controller, 5.0, reference), wanted, atol=1e-6)


@SPEEDS
@RADII
@pytest.mark.parametrize("controller", [Samson(), Kanayama()])
def test_lyapunov_function_falls(controller, speed, radius):
    """From errors up to a metre and 150 degrees, by the rate that the law's paper proves."""
    reference = circle(radius, speed, 40.0)
    rng = np.random.default_rng(0)
    desired, step = reference.pose(5.0), 1e-6
    pose = pose_with_error(desired, rng.uniform([-1, -1, -2.6], [1, 1, 2.6], (200, 3)))
    twist = controller.twist(5.0, pose, reference)

    def function(error):
        square = (error[:, 0] ** 2 + error[:, 1] ** 2) / 2
        if isinstance(controller, Kanayama):
            return square + (1 - np.cos(error[:, 2])) / controller.across
        return controller.stiffness * square + error[:, 2] ** 2 / 2

    def rate(error):
        if isinstance(controller, Kanayama):
            heading = abs(speed) * controller.heading * np.sin(error[:, 2]) ** 2 / controller.across
            return -controller.along * error[:, 0] ** 2 - heading
        k1, k2, k3 = controller.gains(reference.twist(5.0))
        return -k1 * k2 * error[:, 0] ** 2 - k3 * error[:, 2] ** 2

    values = [
        function(body_errors(advance(pose, twist, h), advance(desired, reference.twist(5.0), h))) for h in (-step, step)
    ]
    np.testing.assert_allclose((values[1] - values[0]) / (2 * step), rate(body_errors(pose, desired)), atol=1e-6)


@SPEEDS
def test_offset_points_error_decays_exactly(speed):
    """E' = -k E in the world frame, from any error."""
    controller = OffsetPoint()
    reference = circle(0.8, speed, 40.0)
    desired, step = reference.pose(5.0), 1e-6
    pose = pose_with_error(desired, np.random.default_rng(1).uniform(-1, 1, (50, 3)))
    twist = controller.twist(5.0, pose, reference)

    def point(pose):
        heading = np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
        return pose[..., :2] + np.sign(speed) * controller.distance * heading

    errors = [point(advance(desired, reference.twist(5.0), h)) - point(advance(pose, twist, h)) for h in (-step, step)]
    wanted = -controller.gain * (point(desired) - point(pose))
    np.testing.assert_allclose((errors[1] - errors[0]) / (2 * step), wanted, atol=1e-6)


@SPEEDS
@RADII
def test_pure_pursuit_to_first_order(speed, radius):
    """The curvature 2 y / d^2 differentiated by hand, with the goal (x, y) on the reference's arc."""
    controller = PurePursuit(look_ahead=0.35)
    reference = circle(radius, speed, 40.0)
    v, w = reference.twist(5.0)
    kappa = w / v
    x, y, _ = advance(np.zeros(3), [np.sign(v) * 0.35, np.sign(v) * 0.35 * kappa], 1.0)
    square = x**2 + y**2
    k1 = 2 * 0.7 * np.sqrt(w**2 + 10.0 * v**2)
    bend = np.array([-4 * x * y / square**2, 2 / square - 4 * y**2 / square**2, 2 * x / square])
    gains = error_gains(controller, 5.0, reference)
    np.testing.assert_allclose(gains, [[k1, 0, 0], v * bend + [kappa * k1, 0, 0]], atol=2e-6)
    assert np.linalg.eigvals(closed_loop(gains, np.array([v, w]))).real.max() < -0.1


@SPEEDS
@RADII
def test_stanley_to_first_order(speed, radius):
    controller = Stanley(wheelbase=0.3, gain=0.9, softening=0.08)
    reference = circle(radius, speed, 40.0)
    v, w = reference.twist(5.0)
    direction, speed = np.sign(v), abs(v)
    delta = np.arctan(0.3 * w / speed)
    k1 = 2 * 0.7 * np.sqrt(w**2 + 10.0 * v**2)
    pull = 0.9 / (0.08 + speed)
    turn = speed / (0.3 * np.cos(delta) ** 2)
    along = direction * (k1 * np.tan(delta) / 0.3 - turn * pull * np.sin(delta))
    across = turn * pull * direction * np.cos(delta)
    gains = error_gains(controller, 5.0, reference)
    wanted = [[k1, 0, 0], [along, across, turn * (1 + pull * 0.3 * np.cos(delta))]]
    np.testing.assert_allclose(gains, wanted, atol=1e-6)
    assert np.linalg.eigvals(closed_loop(gains, np.array([v, w]))).real.max() < -0.1


def test_beyond_a_cusp_and_the_end_the_path_goes_on_straight():
    ramps = [Segment(2.0, 0.2, 0.0, 0.5), Segment(2.0, 0.0, -0.2, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    path, cusp, end = PathAhead(reference), reference.pose(2.0), reference.pose(4.0)
    for time, start, way in ((1.0, cusp, 0.3 - 0.05), (3.0, end, -(0.3 - 0.15)), (4.0, end, -0.3), (9.0, end, -0.3)):
        np.testing.assert_allclose(path.point(time, 0.3)[0], advance(start, [way, 0.0], 1.0), atol=1e-4)
    standing = SegmentedReference((1.0, 2.0, 3.0), [Segment(2.0, 0.0, 0.0)])
    np.testing.assert_array_equal(PathAhead(standing).point(1.0, 0.3)[0], [1.0, 2.0, 3.0])
