"""The linear quadratic regulator, and the model predictive controller that is one near the reference."""

import numpy as np
import pytest
from linearised import error_gains, pose_with_error
from scipy.linalg import solve_discrete_are

from trackslip.controllers.lqr import Lqr, error_dynamics
from trackslip.controllers.mpc import ModelPredictive
from trackslip.kinematics import advance, track_speeds
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import circle, paper_reference


@pytest.mark.parametrize("twist", [(0.15, 0.12), (-0.2, 0.1), (0.15, 0.0), (0.0, 0.0)])
def test_error_dynamics_by_finite_differences(twist):
    """A and B are the derivatives of the true motion of robot and reference over a period."""
    desired, period, h = np.array([1.0, 2.0, 0.7]), 0.1, 1e-6
    a, b = error_dynamics(twist, period)

    def after(error, correction):
        pose = advance(pose_with_error(desired, np.asarray(error)), np.add(twist, correction), period)
        return body_errors(pose, advance(desired, twist, period))

    by_error = [(after(h * e, [0, 0]) - after(-h * e, [0, 0])) / (2 * h) for e in np.eye(3)]
    by_correction = [(after(np.zeros(3), h * u) - after(np.zeros(3), -h * u)) / (2 * h) for u in np.eye(2)]
    np.testing.assert_allclose(a, np.transpose(by_error), atol=1e-8)
    np.testing.assert_allclose(b, np.transpose(by_correction), atol=1e-8)


@pytest.mark.parametrize("speed", [0.15, -0.15])
def test_on_a_long_arc_the_gain_solves_the_algebraic_riccati_equation(speed):
    controller = Lqr()
    reference = circle(1.0, speed, 120.0)
    a, b = error_dynamics(reference.twist(5.0), controller.period)
    q, r = controller.weights
    cost = solve_discrete_are(a, b, q, r)
    wanted = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)
    gains = controller.gains(reference)
    np.testing.assert_allclose(gains[100], wanted, rtol=1e-6)
    np.testing.assert_allclose(error_gains(controller, 5.0, reference), -wanted, atol=1e-6)
    assert np.abs(np.linalg.eigvals(a - b @ wanted)).max() < 1


def test_gains_do_not_fade_towards_the_end():
    """The robot is thought to stand for a while, so what can be held there still is."""
    reference = paper_reference()
    gains = Lqr().gains(reference)
    last = gains[-1]
    assert -last[0, 0] > 0.5
    assert -last[1, 2] > 0.5
    np.testing.assert_allclose(last[[0, 1, 1], [1, 0, 1]], 0.0, atol=1e-12)


@pytest.mark.parametrize("speed", [0.15, -0.15])
def test_near_the_reference_a_long_horizon_is_the_linear_quadratic_regulator(speed):
    """The same errors and inputs weighed over the same intervals, where no limit is near."""
    controller = ModelPredictive(intervals=60, interval=0.25, final_weight=1.0, iterations=2)
    reference = circle(1.0, speed, 60.0)
    a, b = error_dynamics(reference.twist(5.0), controller.interval)
    scales = np.array([controller.position_scale, controller.position_scale, controller.heading_scale])
    tracks = track_speeds(np.eye(2), controller.half_gauge).T / controller.speed_scale
    q, r = np.diag(scales**-2), tracks.T @ tracks
    cost = solve_discrete_are(a, b, q, r)
    wanted = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)
    np.testing.assert_allclose(error_gains(controller, 5.0, reference, h=1e-4), -wanted, rtol=2e-3, atol=2e-3)
