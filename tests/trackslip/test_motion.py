import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.kinematics import advance
from trackslip.motion import butterworth_motion, difference
from trackslip.runlog import RunLog


def circle_log(twist, rows=600, step=0.05, noise=(0.0, 0.0, 0.0), seed=0, valid=None):
    time = np.arange(rows) * step
    pose = advance([1.0, 2.0, 0.5], np.asarray(twist), time)
    pose = pose + np.random.default_rng(seed).normal(size=pose.shape) * noise
    return RunLog("circle", time, np.ones((rows, 2)), pose, valid=valid)


@pytest.mark.parametrize("twist", [(0.25, 0.4), (0.05, 0.02), (-0.2, 0.3), (0.2, 0.0), (0.0, 0.5)])
def test_differences_of_an_arc_are_its_twist(twist):
    motion = difference(circle_log(twist).time, circle_log(twist).pose)
    np.testing.assert_allclose(motion.twist, np.tile(twist, (599, 1)), atol=1e-12)


@pytest.mark.parametrize("twist", [(0.25, 0.4), (0.05, 0.02)])
def test_the_filter_bends_no_arc_away_from_the_ends(twist):
    motion = butterworth_motion(circle_log(twist))
    np.testing.assert_allclose(motion.twist[20:-20], np.tile(twist, (559, 1)), atol=1e-6)


def test_noise_makes_the_mean_speed_no_larger():
    """The length of a noisy displacement is longer than the displacement; its projection isn't."""
    noise = (0.003, 0.003, 0.004)
    errors = np.array(
        [
            butterworth_motion(circle_log((0.05, 0.04), noise=noise, seed=k)).twist[20:-20].mean(axis=0) - [0.05, 0.04]
            for k in range(200)
        ]
    )
    standard_error = errors.std(axis=0) / np.sqrt(len(errors))
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * standard_error)
    assert np.all(standard_error < 2e-5)


def test_gaps_and_uneven_steps_are_bridged():
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.04, 0.06, 600))
    pose = advance([0.0, 0.0, 0.0], [0.1, 0.1], time)
    valid = np.ones(600, bool)
    valid[200:230] = False
    pose[~valid] = np.nan
    motion = butterworth_motion(RunLog("uneven", time, np.ones((600, 2)), pose, valid=valid))
    np.testing.assert_allclose(motion.twist[20:-20].mean(axis=0), [0.1, 0.1], rtol=2e-3)
    assert np.diff(motion.time).std() < 1e-9


@pytest.mark.parametrize(("radius", "seconds"), [(0.6, 1.0), (0.6, 5.0), (3.0, 15.0)])
def test_gaps_are_bridged_along_the_arc(radius, seconds):
    """A chord would be too short, by 1 - sinc(turn / 2) of the gap."""
    twist = (0.15, 0.15 / radius)
    time = np.arange(600) * 0.05
    valid = (time < 10) | (time > 10 + seconds)
    log = circle_log(twist, valid=valid)
    log.pose[~valid] = np.nan
    np.testing.assert_allclose(butterworth_motion(log).twist[20:-20], np.tile(twist, (559, 1)), atol=1e-6)


def test_a_gap_too_wide_to_bridge_is_refused():
    time = np.arange(600) * 0.05
    with pytest.raises(LogError, match="can be bridged"):
        butterworth_motion(circle_log((0.2, 0.4), valid=(time < 5) | (time > 15)))


def test_turns_too_fast_for_the_rate_are_refused():
    with pytest.raises(LogError, match="log it more often"):
        butterworth_motion(circle_log((0.2, 0.4), step=0.5))


def test_too_little_to_filter():
    with pytest.raises(LogError, match="needs at least"):
        butterworth_motion(circle_log((0.1, 0.1), rows=10))
