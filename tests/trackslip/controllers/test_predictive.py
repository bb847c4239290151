import numpy as np
import pytest
from linearised import error_gains, pose_with_error
from scipy.linalg import solve_discrete_are
from scipy.optimize import lsq_linear, minimize

from trackslip.controllers.feedback import Lqr, error_dynamics
from trackslip.controllers.predictive import (
    LinearPredictive,
    ModelPredictive,
    PathIntegral,
    bounded_optimum,
)
from trackslip.kinematics import advance, track_speeds, twist_of_tracks
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import circle, paper_reference


def lqr_gains(a, b, q, r):
    """Gains K of the optimal u = -K x by the discrete Riccati equation."""
    cost = solve_discrete_are(a, b, q, r)
    return np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)


@pytest.mark.parametrize(
    "error", [(0.02, -0.01, 0.05), (0.3, 0.2, -0.4), (-0.5, 0.1, 0.8), (0.0, -0.6, 0.3)]
)
@pytest.mark.parametrize("speed", [0.15, -0.2])
@pytest.mark.parametrize("law", [LinearPredictive, ModelPredictive])
def test_the_plan_is_the_optimum_of_its_problem(law, error, speed):
    """Another solver minimises the cost, with errors by a linear recursion or of arcs, within the
    tracks' limits.
    """
    more = {"iterations": 30} if law is ModelPredictive else {}
    controller = law(intervals=8, track_speed=0.26, **more)
    reference = circle(0.8, speed, 40.0)
    nodes = 5.0 + controller.interval * np.arange(9)
    twists = reference.twist((nodes[1:] + nodes[:-1]) / 2)
    desired = reference.pose(nodes)
    wanted = track_speeds(twists, controller.half_gauge)
    a, b = error_dynamics(twists, controller.interval)
    pose = pose_with_error(desired[0], np.array(error))

    def predicted(speeds):
        """Errors (8, 3) at the nodes after the first."""
        errors = []
        left = np.array(error)
        at = pose
        for k, change in enumerate(speeds - wanted):
            correction = twist_of_tracks(change, controller.half_gauge)
            left = a[k] @ left + b[k] @ correction
            twist = twist_of_tracks(speeds[k], controller.half_gauge)
            at = advance(at, twist, controller.interval)
            errors.append(left if law is LinearPredictive else at - desired[k + 1])
        return np.array(errors)

    def cost(speeds):
        speeds = speeds.reshape(-1, 2)
        of_errors = np.sum(predicted(speeds) ** 2 * controller.weights)
        of_speeds = np.sum((speeds - wanted) ** 2) / controller.speed_scale**2
        return of_errors + of_speeds

    best = minimize(
        cost,
        np.clip(wanted, -0.26, 0.26).ravel(),
        method="L-BFGS-B",
        bounds=[(-controller.track_speed, controller.track_speed)] * wanted.size,
        options={"ftol": 1e-15, "gtol": 1e-9, "maxfun": 100_000, "maxiter": 10_000},
    )
    driven = track_speeds(controller.twist(5.0, pose, reference), controller.half_gauge)
    np.testing.assert_allclose(driven, best.x[:2], atol=2e-4)
    assert np.abs(driven).max() <= controller.track_speed
    is_limited = (np.abs(best.x) == controller.track_speed).any()
    is_far = np.hypot(error[0], error[1]) > 0.1
    assert is_limited == is_far


def test_optima_within_bounds_are_those_of_scipy():
    """Some problems with no bound that matters, most with many."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(40, 30, 20))
    sizes = np.geomspace(0.01, 10, 40)
    sides = rng.normal(size=(40, 30)) * sizes[:, None]
    transposed = roots.swapaxes(1, 2)
    hessians = transposed @ roots
    right = (transposed @ sides[..., None])[..., 0]
    wanted = []
    for root, side in zip(roots, sides, strict=True):
        wanted.append(lsq_linear(root, side, (-0.3, 0.3), "bvls").x)
    np.testing.assert_allclose(bounded_optimum(hessians, right, 0.3), wanted, atol=1e-9)


def test_ill_conditioned_problems_end():
    """Of errors that cost 10^10 times as much as others, and robots metres away."""
    controller = ModelPredictive(intervals=40, position_scale=1e-4, final_weight=1e4)
    reference = circle(1.0, 0.2, 40.0)
    pose = reference.pose(5.0) + np.random.default_rng(0).normal(0, 10.0, (4, 3))
    assert np.isfinite(controller.twist(5.0, pose, reference)).all()


def test_many_samples_tend_to_the_linear_quadratic_optimum():
    """The path integral of a linear system with a quadratic cost is known: its mean plan is the
    optimum.
    """
    reference = circle(1.0, 0.15, 40.0)
    pose = pose_with_error(reference.pose(5.0), np.array([0.01, 0.015, 0.03]))
    sampling = PathIntegral(samples=4000, intervals=5, noise=0.03, temperature=0.5)
    scale = sampling.noise * np.sqrt(2 / sampling.temperature)
    wanted = LinearPredictive(intervals=5, speed_scale=scale).twist(5.0, pose, reference)
    twists = [sampling.twist(5.0 + 1e-6 * k, pose, reference) for k in range(100)]
    settled = twists[20:]
    found = np.mean(settled, axis=0) - reference.twist(5.0)
    expected = wanted - reference.twist(5.0)
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())


@pytest.mark.parametrize("twist", [(0.15, 0.12), (-0.2, 0.1), (0.15, 0.0), (0.0, 0.0)])
def test_error_dynamics_by_finite_differences(twist):
    """A and B are the derivatives of the true motion of robot and reference over a period."""
    desired = np.array([1.0, 2.0, 0.7])
    period = 0.1
    a, b = error_dynamics(twist, period)

    def after(error, correction):
        """Errors after a period that begins with `error`."""
        begin = pose_with_error(desired, np.asarray(error))
        pose = advance(begin, np.add(twist, correction), period)
        return body_errors(pose, advance(desired, twist, period))

    h = 1e-6
    no_error = np.zeros(3)
    no_correction = np.zeros(2)
    by_error = []
    for step in h * np.eye(3):
        change = after(step, no_correction) - after(-step, no_correction)
        by_error.append(change / (2 * h))
    by_correction = []
    for step in h * np.eye(2):
        change = after(no_error, step) - after(no_error, -step)
        by_correction.append(change / (2 * h))
    np.testing.assert_allclose(a, np.transpose(by_error), atol=1e-8)
    np.testing.assert_allclose(b, np.transpose(by_correction), atol=1e-8)


@pytest.mark.parametrize("speed", [0.15, -0.15])
def test_on_a_long_arc_the_gain_solves_the_riccati_equation(speed):
    controller = Lqr()
    reference = circle(1.0, speed, 120.0)
    a, b = error_dynamics(reference.twist(5.0), controller.period)
    wanted = lqr_gains(a, b, *controller.weights)
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
    others = last[[0, 1, 1], [1, 0, 1]]
    np.testing.assert_allclose(others, 0.0, atol=1e-12)


@pytest.mark.parametrize("speed", [0.15, -0.15])
def test_near_the_reference_a_long_horizon_is_the_lqr(speed):
    """The same errors and inputs weighed over the same intervals, where no limit is near."""
    controller = ModelPredictive(intervals=60, interval=0.25, final_weight=1.0, iterations=2)
    reference = circle(1.0, speed, 60.0)
    a, b = error_dynamics(reference.twist(5.0), controller.interval)
    position = controller.position_scale
    scales = np.array([position, position, controller.heading_scale])
    tracks = track_speeds(np.eye(2), controller.half_gauge).T / controller.speed_scale
    wanted = lqr_gains(a, b, q=np.diag(scales**-2), r=tracks.T @ tracks)
    gains = error_gains(controller, 5.0, reference, h=1e-4)
    np.testing.assert_allclose(gains, -wanted, rtol=2e-3, atol=2e-3)


def test_samples_are_pairs_and_an_odd_number_is_rounded_up():
    reference = circle(1.0, 0.15, 40.0)
    pose = pose_with_error(reference.pose(5.0), np.array([0.01, 0.015, 0.03]))
    odd, even, more = (
        PathIntegral(samples=count).twist(5.0, pose, reference) for count in (9, 10, 11)
    )
    np.testing.assert_array_equal(odd, even)
    assert (more != even).any()


def test_random_numbers_depend_on_seed_and_time_alone():
    reference = circle(1.0, 0.15, 40.0)
    errors = np.array([[0.01, 0.015, 0.03], [0.0, -0.02, 0.1]])
    pose = pose_with_error(reference.pose(5.0), errors)
    twist = PathIntegral().twist(5.0, pose, reference)
    np.testing.assert_array_equal(PathIntegral().twist(5.0, pose[1:], reference), twist[1:])
    assert (PathIntegral(seed=2).twist(5.0, pose, reference) != twist).any()
    assert (PathIntegral().twist(5.0 + 1e-6, pose, reference) != twist).any()


def test_sampled_tracks_do_not_exceed_their_limit():
    controller = PathIntegral()
    reference = circle(0.7, 0.2, 40.0)
    start_errors = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    pose = pose_with_error(reference.pose(5.0), start_errors)
    twist = controller.twist(5.0, pose, reference)
    tracks = np.abs(track_speeds(twist, controller.half_gauge))
    assert tracks.max() == pytest.approx(controller.track_speed, rel=0.1)
    assert (tracks <= controller.track_speed + 1e-12).all()
