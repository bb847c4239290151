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
TIME = 5.0
"""Amid the references' circles [s]."""


def rate_of_change(value, pose, twist, desired, reference, step=1e-6):
    """Rate of `value(pose, desired)` by central differences, where a robot and its reference move
    on along arcs.
    """

    def after(time):
        return value(advance(pose, twist, time), advance(desired, reference.twist(TIME), time))

    return (after(step) - after(-step)) / (2 * step)


def damped(v, w):
    """The gain 2 zeta sqrt(w^2 + g v^2) along the path, with the default zeta = 0.7 and g = 10."""
    return 2 * 0.7 * np.sqrt(w**2 + 10.0 * v**2)


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
    k1, k2, k3 = LinearTimeVarying().gains(reference.twist(TIME))
    expected = [[k1, 0, 0], [0, k2 * np.sign(speed), k3]]
    gains = error_gains(controller, TIME, reference)
    np.testing.assert_allclose(gains, expected, atol=1e-6)


@SPEEDS
@RADII
@pytest.mark.parametrize("controller", [Samson(), Kanayama()])
def test_lyapunov_function_falls(controller, speed, radius):
    """From errors up to a metre and 150 degrees, by the rate that the law's paper proves.

    Kanayama: V = (x^2 + y^2) / 2 + (1 - cos phi) / k_y falls by
    k_x x^2 + |v| k_phi sin^2 phi / k_y.
    Samson: V = k_2 (x^2 + y^2) / 2 + phi^2 / 2 falls by k_1 k_2 x^2 + k_3 phi^2.
    """
    reference = circle(radius, speed, 40.0)
    rng = np.random.default_rng(0)
    desired = reference.pose(TIME)
    start_errors = rng.uniform([-1, -1, -2.6], [1, 1, 2.6], (200, 3))
    pose = pose_with_error(desired, start_errors)
    twist = controller.twist(TIME, pose, reference)

    def function(pose, desired):
        along, across, turn = body_errors(pose, desired).T
        square = (along**2 + across**2) / 2
        if isinstance(controller, Kanayama):
            return square + (1 - np.cos(turn)) / controller.across
        return controller.stiffness * square + turn**2 / 2

    def proven_rate(error):
        along, _, turn = error.T
        if isinstance(controller, Kanayama):
            of_turn = abs(speed) * controller.heading * np.sin(turn) ** 2 / controller.across
            return -controller.along * along**2 - of_turn
        k1, k2, k3 = controller.gains(reference.twist(TIME))
        return -k1 * k2 * along**2 - k3 * turn**2

    rate = rate_of_change(function, pose, twist, desired, reference)
    expected = proven_rate(body_errors(pose, desired))
    np.testing.assert_allclose(rate, expected, atol=1e-6)


@SPEEDS
def test_offset_points_error_decays_exactly(speed):
    """E' = -k E in the world frame, from any error."""
    controller = OffsetPoint()
    reference = circle(0.8, speed, 40.0)
    desired = reference.pose(TIME)
    start_errors = np.random.default_rng(1).uniform(-1, 1, (50, 3))
    pose = pose_with_error(desired, start_errors)
    twist = controller.twist(TIME, pose, reference)

    def point(pose):
        heading = np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
        return pose[..., :2] + np.sign(speed) * controller.distance * heading

    def error(pose, desired):
        return point(desired) - point(pose)

    rate = rate_of_change(error, pose, twist, desired, reference)
    np.testing.assert_allclose(rate, -controller.gain * error(pose, desired), atol=1e-6)

    # to the right of the reference, which is at rest after its end
    pose = pose_with_error(reference.pose(50.0), np.array([0.0, 0.1, 0.0]))
    _, w = controller.twist(50.0, pose, reference)
    assert w == pytest.approx(0.1 * controller.gain / controller.distance)


@SPEEDS
@RADII
def test_pure_pursuit_to_first_order(speed, radius):
    """The curvature 2 y / d^2 differentiated by hand, with the goal (x, y) on the reference's
    arc and d^2 = x^2 + y^2.

    An error shifts and turns the goal in the robot's frame: by the errors along and across it
    moves by (1, 0) and (0, 1), by the heading error by (-y, x), which leaves d as it is.
    """
    look_ahead = 0.35
    controller = PurePursuit(look_ahead=look_ahead)
    reference = circle(radius, speed, 40.0)
    v, w = reference.twist(TIME)
    kappa = w / v
    ahead = np.sign(v) * look_ahead
    x, y, _ = advance(np.zeros(3), [ahead, ahead * kappa], 1.0)
    square = x**2 + y**2
    by_along = -4 * x * y / square**2
    by_across = 2 / square - 4 * y**2 / square**2
    by_heading = 2 * x / square
    k1 = damped(v, w)
    expected = [[k1, 0, 0], [v * by_along + kappa * k1, v * by_across, v * by_heading]]
    gains = error_gains(controller, TIME, reference)
    np.testing.assert_allclose(gains, expected, atol=2e-6)
    slowest = np.linalg.eigvals(closed_loop(gains, np.array([v, w]))).real.max()
    assert slowest < -0.1


@SPEEDS
@RADII
def test_stanley_to_first_order(speed, radius):
    """The yaw rate |v| tan(steering) / wheelbase differentiated by hand about the steering angle
    delta of the reference's arc.
    """
    wheelbase = 0.3
    controller = Stanley(wheelbase=wheelbase, gain=0.9, softening=0.08)
    reference = circle(radius, speed, 40.0)
    v, w = reference.twist(TIME)
    direction = np.sign(v)
    speed = abs(v)
    delta = np.arctan(wheelbase * w / speed)
    k1 = damped(v, w)
    pull = 0.9 / (0.08 + speed)  # steering angle per error across at the front axle
    turn = speed / (wheelbase * np.cos(delta) ** 2)  # yaw rate per steering angle
    by_along = direction * (k1 * np.tan(delta) / wheelbase - turn * pull * np.sin(delta))
    by_across = turn * pull * direction * np.cos(delta)
    by_heading = turn * (1 + pull * wheelbase * np.cos(delta))
    expected = [[k1, 0, 0], [by_along, by_across, by_heading]]
    gains = error_gains(controller, TIME, reference)
    np.testing.assert_allclose(gains, expected, atol=1e-6)
    slowest = np.linalg.eigvals(closed_loop(gains, np.array([v, w]))).real.max()
    assert slowest < -0.1


def test_beyond_a_cusp_and_the_end_the_path_goes_on_straight():
    ramps = [Segment(2.0, 0.2, 0.0, 0.5), Segment(2.0, 0.0, -0.2, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    path = PathAhead(reference)
    cusp = reference.pose(2.0)
    end = reference.pose(4.0)
    # time, where the path goes straight on, and how far the point is beyond
    for time, start, beyond in (
        (1.0, cusp, 0.3 - 0.05),
        (3.0, end, -(0.3 - 0.15)),
        (4.0, end, -0.3),
        (9.0, end, -0.3),
    ):
        point, *_ = path.point(time, 0.3)
        straight_on = advance(start, [beyond, 0.0], 1.0)
        np.testing.assert_allclose(point, straight_on, atol=1e-4)


def test_the_point_ahead_of_a_standing_reference_is_its_pose():
    standing = SegmentedReference((1.0, 2.0, 3.0), [Segment(2.0, 0.0, 0.0)])
    point, *_ = PathAhead(standing).point(1.0, 0.3)
    np.testing.assert_array_equal(point, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(("speed", "stiffness", "damping"), [(0.15, 1.0, 1.4), (-0.15, 0.5, 2.0)])
def test_each_axis_is_a_damped_spring(speed, stiffness, damping):
    """e'' + k_d e' + k_p e = 0 in the world frame, along an arc that speeds up, against its
    solution: a sum of exp(root t) with the weights of e and e' at the start.
    """
    heading = 0.7
    start_error = np.array([0.03, 0.04, 0.8])
    reference = SegmentedReference((1.0, 2.0, heading), [Segment(10.0, speed, 1.5 * speed, 0.8)])
    controller = DynamicFeedback(stiffness, damping)
    start = pose_with_error(reference.pose(0.0), start_error)
    pose = start
    step = 2e-3
    time = np.arange(750) * step
    error = np.zeros((len(time), 2))
    twist = np.zeros((len(time), 2))
    for k, now in enumerate(time):
        error[k] = (reference.pose(now) - pose)[:2]
        twist[k] = controller.twist(now, pose, reference)
        pose = advance(pose, twist[k], step)

    desired_velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    velocity = twist[0, 0] * np.array([np.cos(start[2]), np.sin(start[2])])
    start_rate = desired_velocity - velocity
    roots = np.roots([1, damping, stiffness]).astype(complex)
    weights = np.linalg.solve([[1, 1], roots], np.stack([error[0], start_rate]))
    solution = (np.exp(np.outer(time, roots)) @ weights).real
    np.testing.assert_allclose(error, solution, atol=1e-4)


@SPEEDS
def test_errors_across_decay_with_the_distance_as_stated(speed):
    law = PathFollowing(approach_angle=0.7, approach=3.0, across=6.0, heading=4.0)
    straight = circle(1e9, speed, 40.0)
    _, (_, by_left, by_turn) = error_gains(law, TIME, straight)
    # of (y, theta) = -(e_y, e_phi), per metre
    motion = np.array([[0.0, speed], [-by_left, -by_turn]]) / abs(speed)
    slope = 0.7 * 3.0
    stated = [1.0, 4.0 + slope, 4.0 * slope + 6.0]
    np.testing.assert_allclose(np.poly(motion), stated, rtol=1e-6)


def drive(law, reference, pose, duration, held=0.0, step=0.05):
    """Poses (T, ..., 3) and twists (T, ..., 2) of ideal robots, held in place for the first `held`
    seconds.
    """
    poses = []
    twists = []
    for k in range(round(duration / step)):
        twists.append(law.twist(k * step, pose, reference))
        is_held = k * step < held
        pose = pose if is_held else advance(pose, twists[-1], step)
        poses.append(pose)
    return np.array(poses), np.array(twists)


@SPEEDS
def test_a_late_robot_stays_on_its_path_and_hurries(speed):
    """Held for 3 s on a circle of 1 m, it is 0.45 m late; Eq. 31 then cuts the corner by
    centimetres.
    """
    reference = circle(1.0, speed, 60.0)

    def away(law):
        """Largest distance from the circle [m], and largest speed [m/s]."""
        poses, twists = drive(law, reference, reference.pose(0.0), 40.0, held=3.0)
        missed = poses[-1] - reference.pose(40.0)
        assert np.hypot(missed[0], missed[1]) < 2e-3
        radius = np.hypot(poses[:, 0], poses[:, 1] - 1.0)
        return np.abs(radius - 1.0).max(), np.abs(twists[:, 0]).max()

    distance, top_speed = away(PathFollowing())
    assert distance < 5e-3
    assert top_speed == pytest.approx(1.3 * abs(speed), rel=0.02)
    distance_by_eq_31, _ = away(LinearTimeVarying())
    assert distance_by_eq_31 > 0.02


@SPEEDS
def test_without_regulation_it_is_plain_pure_pursuit(speed):
    reference = circle(1.0, speed, 40.0)
    plain = error_gains(PurePursuit(look_ahead=0.3), TIME, reference)
    for regulated in (
        RegulatedPurePursuit(lookahead_time=2.0),
        RegulatedPurePursuit(min_lookahead_dist=0.3, max_lookahead_dist=0.3),
    ):
        gains = error_gains(regulated, TIME, reference)
        np.testing.assert_allclose(gains, plain, atol=1e-9)


def test_speed_falls_before_a_cusp_where_the_robot_is():
    ramps = [Segment(2.0, 0.2, 0.2), Segment(2.0, -0.2, -0.2)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    law = RegulatedPurePursuit(approach_velocity_scaling_dist=0.2, stiffness=1e-9)  # doesn't hurry
    # time [s], how far the robot is behind [m], and its speed [m/s]
    for time, behind, expected in (
        (0.5, 0.0, 0.2),
        (1.5, 0.0, 0.1),
        (1.5, 0.05, 0.15),
        (1.9, 0.0, 0.05),
        (3.7, 0.0, 0.06),
    ):
        pose = pose_with_error(reference.pose(time), np.array([behind, 0.0, 0.0]))
        v, w = law.twist(time, pose, reference)
        np.testing.assert_allclose([abs(v), w], [expected, 0.0], atol=1e-5)


def test_the_speed_never_jumps():
    """Through stop, cusp and end, with an error that makes both laws disagree."""
    forwards = [Segment(3.0, 0.0, 0.15, 0.5), Segment(3.0, 0.15, 0.0, 0.5)]
    backwards = [Segment(3.0, 0.0, -0.15, -0.5), Segment(3.0, -0.15, 0.0, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), [*forwards, *backwards])
    controller = DynamicFeedback(stiffness=0.5)
    start_errors = np.array([[0.08, 0.1, 0.3], [-0.08, 0.05, 0.0], [0.0, 0.0, 0.0]])
    pose = pose_with_error(reference.pose(0.0), start_errors)
    step = 0.02
    twists = []
    for k in range(700):
        twists.append(controller.twist(k * step, pose, reference))
        pose = advance(pose, twists[-1], step)
    jumps = np.abs(np.diff(twists, axis=0))
    assert jumps[..., 0].max() < 0.5 * step  # 0.5 m/s^2
    assert np.abs(twists).max() < 1.5
