"""The arc fitted to poses is where its equations have their root."""

import numpy as np
import pytest
import scipy

from trackslip.kinematics import advance, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES, arc, fit_arc, poses_on_arc
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance

SCALE = np.array([0.0025, 0.0025, np.radians(0.3)])  # units of the residuals [m, m, rad]
TIME = 0.05 * np.arange(-300, 300)  # [s]


def noise(kind, rng):
    """Errors (T, 3) of poses: white, with wild poses that are all alike, or with heavy tails."""
    white = rng.normal(size=(len(TIME), 3)) * [0.002, 0.002, 0.004]
    if kind == "white":
        return white
    if kind == "heavy":
        return rng.standard_t(1.5, size=white.shape) * [0.01, 0.01, 0.02]
    wild = rng.random(len(TIME)) < 0.15
    white[wild] += rng.normal(size=3) * [0.3, 0.3, 0.5]
    return white


def root_near(parameters, pose):
    """Parameters (6,) where the sum of the bounded residuals' scores is 0, found by scipy."""

    def total_score(parameters):
        predicted, jacobian = poses_on_arc(parameters, TIME)
        missed = predicted - pose
        missed[:, 2] = wrap_angle(missed[:, 2])
        residual = missed / SCALE
        spread = np.maximum(1.0, 1.4826 * np.median(np.abs(residual), axis=0))
        bounded = np.clip(residual, -3 * spread, 3 * spread)
        return np.einsum("tki,tk->i", jacobian / SCALE[:, None], bounded)

    found = scipy.optimize.root(total_score, parameters, tol=1e-12)
    assert np.abs(found.fun).max() < 1e-6
    return found.x


@pytest.mark.parametrize("kind", ["white", "wild", "heavy"])
@pytest.mark.parametrize("seed", range(6))
def test_arc_converges_to_a_small_share_of_its_errors(kind, seed):
    rng = np.random.default_rng(seed)
    twist = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.6, 0.6)])
    pose = advance([1.0, 2.0, 0.5], twist, TIME) + noise(kind, rng)
    parameters, hessian, scores, _ = fit_arc(TIME, pose)
    inverse = np.linalg.inv(hessian)
    covariance = inverse @ (len(TIME) * long_run_covariance(scores)) @ inverse
    errors = np.sqrt(np.diag(covariance))
    missed = parameters - root_near(parameters, pose)
    assert np.abs(missed / errors).max() < 1e-3


def test_few_poses_are_closer_to_their_arc_than_to_the_true_one():
    """Six parameters are fitted to 36 residuals of 12 poses: their variance is 36/30 as large."""
    time = 0.5 * np.arange(MIN_ARC_POSES)
    noise = np.random.default_rng(0).normal(size=(len(time), 3)) * [0.002, 0.002, 0.004]
    pose = advance([1.0, 2.0, 0.5], [0.1, 0.08], time) + noise
    found = arc(RunLog("a", time, np.ones((len(time), 2)), pose), (-1.0, 100.0))

    parameters, hessian, scores, _ = fit_arc(time - time.mean(), pose)
    inverse = np.linalg.inv(hessian)
    of_residuals = inverse @ (len(time) * long_run_covariance(scores)) @ inverse
    expected = SteadyTwist.of_arc(parameters, of_residuals * 36 / 30)
    np.testing.assert_allclose(found.covariance, expected.covariance)
