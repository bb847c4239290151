from dataclasses import replace

import numpy as np
import pytest
from law_motion import STILL, LawMotion

from sim import LaserScanner
from sim.wander.motion import Driver, Motion, track_commands
from sim.wander.pose_sensor import PoseSensor, plate_scans
from trackslip import se2
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr

PERFECT = PoseSensor(rate=10.0)
FAST = PoseSensor(rate=50.0)


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(0)
    geometry = RobotGeometry(0.168, 0.06)
    omega = track_commands("random", 120.0, 50.0, Driver(), rng) / geometry.sprocket_radius
    robot = LawMotion(ConstantIcr(0.045, 0.168, 0.0066), geometry, STILL)
    driven, _ = robot.drive(omega, 50.0, rng)
    return driven


def measure(source, motion, seed=1):
    """Stamps (n,), poses (n, 3), and true poses (n, 3) of the robot."""
    stamps, poses = source.measure(motion, np.random.default_rng(seed))
    return stamps, poses, motion.at(stamps)


def test_a_sensor_is_where_it_is_mounted(motion):
    stamps, poses, true = measure(replace(PERFECT, ahead=0.3, left=0.1, mounting=0.087), motion)
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=1e-12)
    mounting = np.tile([0.3, 0.1, 0.087], (len(true), 1))
    np.testing.assert_allclose(se2.between(true, poses), mounting, atol=1e-12)


def test_noise_is_white_and_as_large_as_stated(motion):
    _, poses, true = measure(replace(FAST, position_noise=0.02, heading_noise=0.03), motion)
    errors = poses - true
    error_of_deviation = 1 / np.sqrt(2 * len(errors))
    deviation = errors.std(axis=0)
    np.testing.assert_allclose(deviation, [0.02, 0.02, 0.03], rtol=5 * error_of_deviation)
    correlation = np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]
    assert np.abs(correlation) < 5 / np.sqrt(len(errors))


@pytest.mark.parametrize("delay", [0.15, -0.3])
def test_a_late_clock_stamps_later(motion, delay):
    stamps, poses, _ = measure(replace(FAST, delay=delay), motion)
    inside = (stamps > 1) & (stamps < 119)
    np.testing.assert_allclose(poses[inside], motion.at(stamps[inside] - delay), atol=1e-12)


def test_jittered_stamps_stay_in_order(motion):
    stamps, poses, true = measure(replace(PERFECT, jitter=0.02), motion)
    assert (np.diff(stamps) > 0).all()
    early_or_late = stamps - 0.1 * np.arange(len(stamps))
    assert early_or_late.std() == pytest.approx(0.02, rel=0.1)
    # a pose stamped late by dt is off by speed times dt
    velocity = np.gradient(true[:, :2], stamps, axis=0)
    error = (poses - true)[:, :2]
    rms_speed = np.sqrt((velocity**2).sum(axis=1).mean())
    rms_error = np.sqrt((error**2).sum(axis=1).mean())
    assert rms_error == pytest.approx(0.02 * rms_speed, rel=0.15)


def test_gaps_outliers_and_jumps_have_their_numbers_and_sizes(motion):
    stamps, _, _ = measure(replace(PERFECT, gaps=3, gap_duration=5.0), motion)
    pauses = np.diff(stamps)
    np.testing.assert_allclose(pauses[pauses > 0.11], [5.0, 5.0, 5.0], atol=0.11)

    _, poses, true = measure(replace(FAST, outliers=0.05), motion)
    errors = np.abs(poses - true)
    is_wild = errors[:, 0] > 1e-9
    assert is_wild.mean() == pytest.approx(0.05, abs=0.015)
    assert 0.45 < errors.max() <= 0.5

    _, poses, true = measure(replace(PERFECT, jumps=2, jump_size=0.5, jump_turn=0.1), motion)
    errors = se2.steps(poses) - se2.steps(true)
    size = np.hypot(errors[:, 0], errors[:, 1])
    turn = np.abs(errors[:, 2])
    is_jump = size > 1e-9
    np.testing.assert_allclose(size[is_jump], [0.5, 0.5])
    np.testing.assert_allclose(turn[is_jump], [0.1, 0.1])


def test_drift_grows_to_its_share_of_the_way(motion):
    """The sums of the steps' errors are compared, because an error of the heading would turn all
    that follow.
    """
    drifting = replace(PERFECT, rate=5.0, drift=0.01, heading_drift=0.004)
    ends = []
    for seed in range(100):
        _, poses, true = measure(drifting, motion, seed)
        steps = se2.steps(true)
        errors = se2.steps(poses) - steps
        ends.append(errors.sum(axis=0))
    way = np.hypot(steps[:, 0], steps[:, 1]).sum()
    x, y, heading = np.sqrt(np.square(ends).mean(axis=0))
    assert np.hypot(x, y) == pytest.approx(0.01 * way, rel=0.2)
    assert heading == pytest.approx(0.004 * np.sqrt(way), rel=0.25)


def test_times_noise_and_reach_of_scans(robot):
    time = np.linspace(0.0, 20.0, 401)
    ahead = np.stack([0.5 + time, 0 * time, 0 * time], axis=-1)  # away from the scanner, end on
    scanner = LaserScanner(rate=50.0, noise=0.01, max_range=10.0)
    motion = Motion(time, se2.compose(robot.lrf_mount, ahead))
    seen, scan = plate_scans(scanner, robot, motion, np.random.default_rng(0))
    np.testing.assert_allclose(np.diff(seen), 0.02)
    assert 0 <= seen[0] < 0.02
    straight_ahead = len(scan.bearings) // 2
    ranges = scan.ranges[:, straight_ahead]
    end = 0.5 + seen - robot.plate.length / 2
    error = (ranges - end)[end < 9.8]
    assert np.isnan(ranges[end > 10.0]).all()
    assert abs(np.std(error) / 0.01 - 1) < 4 / np.sqrt(2 * len(error))
    assert abs(np.mean(error)) < 4 * 0.01 / np.sqrt(len(error))
