from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_motion import LawMotion, driven_by_law

from sim.wander.motion import DRIVING, Driver, Motion, joined_log, track_commands
from trackslip.kinematics import RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr

RATE = 50.0


def commands(driving, seed=0, duration=120.0, driver=None):
    rng = np.random.default_rng(seed)
    return track_commands(driving, duration, RATE, driver or Driver(), rng)


@settings(max_examples=40)
@given(
    st.sampled_from(list(DRIVING)),
    st.integers(0, 10**6),
    st.floats(0.05, 2.0),
    st.floats(0.1, 5.0),
    st.floats(0.03, 1),
)
def test_speeds_and_accelerations_stay_within_their_limits(
    driving, seed, max_speed, acceleration, half_gauge
):
    speeds = commands(driving, seed, 30.0, Driver(max_speed, acceleration, half_gauge))
    assert np.abs(speeds).max() <= max_speed * (1 + 1e-12)
    rate_of_change = np.diff(speeds, axis=0) * RATE
    assert np.abs(rate_of_change).max() <= acceleration * (1 + 1e-9)
    np.testing.assert_array_equal(speeds[0], 0.0)
    assert len(speeds) == 1501


GEOMETRY = RobotGeometry(0.168, 0.06)


@pytest.fixture
def encoders():
    rng = np.random.default_rng(0)
    omega = track_commands("random", 20.0, RATE, Driver(), rng) / GEOMETRY.sprocket_radius
    robot = LawMotion(ConstantIcr(0.045, 0.168, 0.0066), GEOMETRY)
    log, _ = driven_by_law("drive", robot, omega, RATE, rng)
    return log


def test_rows_are_those_of_both_clocks(encoders):
    stamps = np.array([-0.01, 0.0, 0.013, 0.02, 0.5, 20.0, 20.001])
    poses = np.arange(21.0).reshape(7, 3)
    log = joined_log(encoders, stamps, poses)
    assert len(log.time) == len(encoders.time) + 1  # 0, 0.02, 0.5 and 20 s are the encoders', too
    assert (np.diff(log.time) > 0).all()
    np.testing.assert_allclose(log.time[log.valid], stamps[1:6])
    np.testing.assert_array_equal(log.pose[log.valid], poses[1:6])
    assert np.isnan(log.pose[~log.valid]).all()


def test_sprockets_and_truth_are_those_of_the_encoders_rows(encoders):
    stamps = np.sort(np.random.default_rng(1).uniform(0, 20, 200))
    log = joined_log(encoders, stamps, np.zeros((200, 3)))
    angle = np.cumsum(log.omega[1:] * np.diff(log.time)[:, None], axis=0)
    rows = np.isin(log.time, encoders.time)
    expected = np.cumsum(encoders.omega[1:] / RATE, axis=0)
    np.testing.assert_allclose(angle[rows[1:]], expected, atol=1e-9)
    np.testing.assert_allclose(log.truth.pose[rows], encoders.truth.pose, atol=1e-12)
    np.testing.assert_allclose(log.truth.twist[rows], encoders.truth.twist, atol=1e-12)


def test_a_row_with_only_a_pose_has_the_command_in_force(encoders):
    """That of the reading before, until the next reading."""
    command = np.arange(2.0 * len(encoders.time)).reshape(-1, 2)
    commanded = replace(encoders, command=command)
    log = joined_log(commanded, np.array([0.013, 0.5, 19.99]), np.zeros((3, 3)))
    np.testing.assert_array_equal(log.command[log.read], command)
    np.testing.assert_array_equal(log.command[log.valid], command[[0, 25, 999]])


RNG = np.random.default_rng(4)


def test_poses_between_rows_lie_on_the_arc():
    twist = np.array([0.2, 0.9])
    time = np.cumsum(RNG.uniform(0.05, 0.2, 40))
    start = np.array([1.0, -2.0, 3.0])
    at = RNG.uniform(time[0], time[-1], 100)
    motion = Motion(time, advance(start, twist, time))
    np.testing.assert_allclose(motion.at(at), advance(start, twist, at), atol=1e-12)
    np.testing.assert_allclose(motion.at(time), motion.pose, atol=1e-12)
