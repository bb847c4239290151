"""Poses that jump while the sprockets turn steadily: no law is biased by them."""

import numpy as np
import pytest

from trackslip.identification.samples import usable_samples
from trackslip.kinematics import RobotGeometry, advance
from trackslip.logs.runlog import RunLog
from trackslip.motion.jumps import find_jumps

GEOMETRY = RobotGeometry(0.168, 0.06)
NOISE = {"fine": (0.002, 0.002, np.radians(0.25)), "coarse": (0.02, 0.02, np.radians(1.0))}


def circle(rng, noise, rate=10.0, duration=30.0, twist=None):
    """Times and poses of a steady turn."""
    twist = np.array([rng.uniform(0.05, 0.3), rng.uniform(-0.4, 0.4)]) if twist is None else np.array(twist)
    time = np.arange(0, duration, 1 / rate)
    pose = advance([1.0, 2.0, rng.uniform(-3, 3)], twist, time)
    return time, pose + rng.normal(size=pose.shape) * noise, twist


def displaced(pose, way, direction, turn):
    """Poses turned about the first of them and shifted: a map that was corrected."""
    x, y = (pose[:, :2] - pose[0, :2]).T
    cos, sin = np.cos(turn), np.sin(turn)
    moved = np.column_stack([cos * x - sin * y, sin * x + cos * y]) + pose[0, :2]
    return np.column_stack([moved + way * np.array([np.cos(direction), np.sin(direction)]), pose[:, 2] + turn])


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
def test_poses_without_jumps_are_all_kept(noise):
    rng = np.random.default_rng(0)
    for rate in (2.0, 5.0, 20.0, 100.0):
        for duration in (6.0, 30.0):
            for _ in range(10):
                time, pose, _ = circle(rng, noise, rate, duration)
                found = find_jumps(time, pose)
                assert not found.glitch.any()
                assert found.lasting == ()


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0])
@pytest.mark.parametrize(("way", "turn"), [(0.1, 0.0), (0.2, 0.0), (0.5, 0.0), (0.0, 5.0), (0.0, 30.0), (0.3, 15.0)])
def test_a_lasting_jump_is_found_where_it_is(way, turn, rate, noise):
    rng = np.random.default_rng([1, int(1000 * way), int(turn), int(rate)])
    for _ in range(10):
        time, pose, _ = circle(rng, noise, rate)
        row = int(rng.integers(len(time) // 4, 3 * len(time) // 4))
        pose[row:] = displaced(pose[row:], way, rng.uniform(-3, 3), np.radians(turn))
        found = find_jumps(time, pose)
        assert len(found.lasting) == 1
        assert abs(time[found.lasting[0]] - time[row]) < 0.5  # what is left out before and after a break
        assert found.glitch.sum() <= 2


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
def test_jumps_at_random_times_do_not_bias_the_motion(noise):
    """Errors of v and w in standard errors, with and without a jump of the poses."""
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(60):
        time, pose, twist = circle(rng, noise, rng.choice([5.0, 10.0, 20.0]), duration=20.0)
        row = int(rng.integers(1, len(time)))
        way, turn = rng.choice([0, 1]) * rng.uniform(0.1, 0.5), np.radians(rng.choice([0, 1]) * rng.uniform(5, 30))
        pose[row:] = displaced(pose[row:], way, rng.uniform(-3, 3), turn)
        omega = np.tile((twist[0] + np.array([-1, 1]) * 0.21 * twist[1]) / 0.06, (len(time), 1))
        samples = usable_samples([RunLog("jump", time, omega, pose)], GEOMETRY).samples
        assert samples.covariance is not None
        errors += list((samples.twist - twist) / np.sqrt(np.diagonal(samples.covariance, axis1=1, axis2=2)))
    assert len(errors) > 60
    assert np.abs(errors).max() < 6.0  # short pieces know their errors from few poses
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def test_glitches_are_left_out_one_by_one():
    rng = np.random.default_rng(3)
    for _ in range(20):
        time, pose, _ = circle(rng, NOISE["coarse"])
        rows = np.sort(rng.choice(len(time), 15, replace=False))
        pose[rows, :2] += rng.uniform(0.5, 5, (15, 2)) * rng.choice([-1, 1], (15, 2))
        found = find_jumps(time, pose)
        assert np.flatnonzero(found.glitch).tolist() == rows.tolist()
        assert found.lasting == ()


def test_a_glitch_of_the_heading_may_unwrap_to_another_turn():
    rng = np.random.default_rng(4)
    time, pose, twist = circle(rng, NOISE["fine"], twist=(0.2, 0.3))
    pose[150, 2] += np.pi - 0.01
    pose[:, 2] = np.unwrap(pose[:, 2])
    assert pose[200, 2] - pose[100, 2] == pytest.approx(3.0 - 2 * np.pi, abs=0.1)  # the glitch takes a turn for good
    found = find_jumps(time, pose)
    assert np.flatnonzero(found.glitch).tolist() == [150]
    assert found.lasting == ()
    omega = np.tile((twist[0] + np.array([-1, 1]) * 0.21 * twist[1]) / 0.06, (len(time), 1))
    samples = usable_samples([RunLog("glitch", time, omega, pose)], GEOMETRY).samples
    np.testing.assert_allclose(samples.twist[0], twist, atol=1e-3)


def test_poses_that_are_held_do_not_count_as_jumps():
    """Poses at 5 Hz beside encoders at 50 Hz, each repeated until the next."""
    rng = np.random.default_rng(5)
    time, pose, _ = circle(rng, NOISE["fine"], rate=50.0, twist=(0.3, 0.2))
    found = find_jumps(time, pose[np.arange(len(time)) // 10 * 10])
    assert not found.glitch.any()
    assert found.lasting == ()
