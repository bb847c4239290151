import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from linearised import closed_loop, error_gains, pose_with_error

from trackslip.controllers.feedback import (
    DynamicFeedback,
    Kanayama,
    LinearTimeVarying,
    OffsetPoint,
    Samson,
)
from trackslip.controllers.path_following import PathFollowing
from trackslip.controllers.steering import PathAhead, PurePursuit, RegulatedPurePursuit, Stanley
from trackslip.kinematics import advance
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle

SPEEDS = pytest.mark.parametrize("speed", [0.15, -0.15])
RADII = pytest.mark.parametrize("radius", [1.25, -0.7])


@given(st.floats(0.02, 0.5), st.floats(-0.5, 0.5), st.floats(0.2, 1.5), st.floats(1.0, 40.0))
def test_gains_give_the_papers_closed_loop_polynomial(v, w, damping, stiffness):
    """Eq. 25 with the error dynamics of Eq. 20, built by hand."""
    controller = LinearTimeVarying(damping=damping, stiffness=stiffness)
    k1, k2, k3 = controller.gains([v, w])
    gains = np.array([[k1, 0, 0], [0, k2, k3]])
    matrix = closed_loop(gains, np.array([v, w]))
    a = np.sqrt(w**2 + stiffness * v**2)
    wanted = np.polymul([1, 2 * damping * a], [1, 2 * damping * a, a**2])
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
        function(body_errors(advance(pose, twist, h), advance(desired, reference.twist(5.0), h)))
        for h in (-step, step)
    ]
    np.testing.assert_allclose(
        (values[1] - values[0]) / (2 * step), rate(body_errors(pose, desired)), atol=1e-6
    )


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

    errors = [
        point(advance(desired, reference.twist(5.0), h)) - point(advance(pose, twist, h))
        for h in (-step, step)
    ]
    wanted = -controller.gain * (point(desired) - point(pose))
    np.testing.assert_allclose((errors[1] - errors[0]) / (2 * step), wanted, atol=1e-6)
    # to the right of the reference, at rest
    pose = pose_with_error(reference.pose(50.0), np.array([0.0, 0.1, 0.0]))
    assert controller.twist(50.0, pose, reference)[1] == pytest.approx(
        0.1 * controller.gain / controller.distance
    )


@SPEEDS
@RADII
def test_pure_pursuit_to_first_order(speed, radius):
    """The curvature 2 y / d^2 differentiated by hand, with the goal (x, y) on the reference's
    arc.
    """
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
    path = PathAhead(reference)
    cusp = reference.pose(2.0)
    end = reference.pose(4.0)
    for time, start, distance in (
        (1.0, cusp, 0.3 - 0.05),
        (3.0, end, -(0.3 - 0.15)),
        (4.0, end, -0.3),
        (9.0, end, -0.3),
    ):
        point, *_ = path.point(time, 0.3)
        straight_on = advance(start, [distance, 0.0], 1.0)
        np.testing.assert_allclose(point, straight_on, atol=1e-4)


def test_the_point_ahead_of_a_standing_reference_is_its_pose():
    standing = SegmentedReference((1.0, 2.0, 3.0), [Segment(2.0, 0.0, 0.0)])
    point, *_ = PathAhead(standing).point(1.0, 0.3)
    np.testing.assert_array_equal(point, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(("speed", "stiffness", "damping"), [(0.15, 1.0, 1.4), (-0.15, 0.5, 2.0)])
def test_each_axis_is_a_damped_spring(speed, stiffness, damping):
    """e'' + k_d e' + k_p e = 0 in the world frame, along an arc that speeds up, against its
    solution.
    """
    reference = SegmentedReference((1.0, 2.0, 0.7), [Segment(10.0, speed, 1.5 * speed, 0.8)])
    controller = DynamicFeedback(stiffness, damping)
    pose = pose_with_error(reference.pose(0.0), np.array([0.03, 0.04, 0.1]))
    step, steps = 2e-3, 750
    error, twist = np.zeros((steps, 2)), np.zeros((steps, 2))
    for k in range(steps):
        error[k] = (reference.pose(k * step) - pose)[:2]
        twist[k] = controller.twist(k * step, pose, reference)
        if k == 0:
            heading = [np.cos(pose[2]), np.sin(pose[2])]
            desired = np.array([np.cos(0.7), np.sin(0.7)]) * speed
            rate = desired - twist[0, 0] * np.array(heading)
        pose = advance(pose, twist[k], step)
    roots = np.roots([1, damping, stiffness]).astype(complex)
    weights = np.linalg.solve([[1, 1], roots], np.stack([error[0], rate]))
    wanted = (np.exp(np.outer(np.arange(steps) * step, roots)) @ weights).real
    np.testing.assert_allclose(error, wanted, atol=1e-4)


@SPEEDS
def test_errors_across_decay_with_the_distance_as_stated(speed):
    law = PathFollowing(approach_angle=0.7, approach=3.0, across=6.0, heading=4.0)
    _, (_, by_left, by_turn) = error_gains(law, 5.0, circle(1e9, speed, 40.0))
    # of (y, theta) = -(e_y, e_phi), per metre
    motion = np.array([[0.0, speed], [-by_left, -by_turn]]) / abs(speed)
    slope = 0.7 * 3.0
    np.testing.assert_allclose(np.poly(motion), [1.0, 4.0 + slope, 4.0 * slope + 6.0], rtol=1e-6)


def drive(law, reference, pose, duration, held=0.0, step=0.05):
    """Poses (T, ..., 3) and twists (T, ..., 2) of ideal robots, held in place for the first `held`
    seconds.
    """
    poses, twists = [], []
    for k in range(round(duration / step)):
        twists.append(law.twist(k * step, pose, reference))
        pose = pose if k * step < held else advance(pose, twists[-1], step)
        poses.append(pose)
    return np.array(poses), np.array(twists)


@SPEEDS
def test_a_late_robot_stays_on_its_path_and_hurries(speed):
    """Held for 3 s on a circle of 1 m, it is 0.45 m late; Eq. 31 then cuts the corner by
    centimetres.
    """
    reference = circle(1.0, speed, 60.0)

    def away(law):
        poses, twists = drive(law, reference, reference.pose(0.0), 40.0, held=3.0)
        assert np.hypot(*(poses[-1] - reference.pose(40.0))[:2]) < 2e-3
        return np.abs(np.hypot(poses[:, 0], poses[:, 1] - 1.0) - 1.0).max(), np.abs(twists[:, 0])

    distance, speeds = away(PathFollowing())
    assert distance < 5e-3
    assert speeds.max() == pytest.approx(1.3 * abs(speed), rel=0.02)
    assert away(LinearTimeVarying())[0] > 0.02


@SPEEDS
def test_without_regulation_it_is_plain_pure_pursuit(speed):
    reference = circle(1.0, speed, 40.0)
    plain = error_gains(PurePursuit(look_ahead=0.3), 5.0, reference)
    np.testing.assert_allclose(
        error_gains(RegulatedPurePursuit(lookahead_time=2.0), 5.0, reference), plain, atol=1e-9
    )
    near = RegulatedPurePursuit(min_lookahead_dist=0.3, max_lookahead_dist=0.3)
    np.testing.assert_allclose(error_gains(near, 5.0, reference), plain, atol=1e-9)


def test_speed_falls_before_a_cusp_where_the_robot_is():
    ramps = [Segment(2.0, 0.2, 0.2), Segment(2.0, -0.2, -0.2)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    law = RegulatedPurePursuit(approach_velocity_scaling_dist=0.2, stiffness=1e-9)  # doesn't hurry
    for time, behind, wanted in (
        (0.5, 0.0, 0.2),
        (1.5, 0.0, 0.1),
        (1.5, 0.05, 0.15),
        (1.9, 0.0, 0.05),
        (3.7, 0.0, 0.06),
    ):
        pose = pose_with_error(reference.pose(time), np.array([behind, 0.0, 0.0]))
        v, w = law.twist(time, pose, reference)
        np.testing.assert_allclose([abs(v), w], [wanted, 0.0], atol=1e-5)


def test_the_speed_never_jumps():
    """Through stop, cusp and end, with an error that makes both laws disagree."""
    forwards = [Segment(3.0, 0.0, 0.15, 0.5), Segment(3.0, 0.15, 0.0, 0.5)]
    backwards = [Segment(3.0, 0.0, -0.15, -0.5), Segment(3.0, -0.15, 0.0, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), [*forwards, *backwards])
    controller = DynamicFeedback(stiffness=0.5)
    pose = pose_with_error(
        reference.pose(0.0), np.array([[0.08, 0.1, 0.3], [-0.08, 0.05, 0.0], [0.0, 0.0, 0.0]])
    )
    step = 0.02
    twists = []
    for k in range(700):
        twists.append(controller.twist(k * step, pose, reference))
        pose = advance(pose, twists[-1], step)
    jumps = np.abs(np.diff(twists, axis=0))
    assert jumps[..., 0].max() < 0.5 * step  # 0.5 m/s^2
    assert np.abs(twists).max() < 1.5
