"""Scans of the plate in closed form."""

from __future__ import annotations

import numpy as np

from sim.fleet import Fleet
from sim.robot.robot import load_robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.wander.motion import Motion
from sim.wander.pose_source import plate_ranges, plate_scans
from trackslip.localization.scan import Plate

SCANNER = LaserScanner()


def test_ranges_are_those_that_mujoco_casts():
    robot = load_robot()
    start = np.array([[0.0, 0.0, 0.3], [1.0, 2.0, -1.2], [-1.5, 0.5, np.pi / 2], [-4.0, 6.0, 0.5]])
    fleet = Fleet(robot, start)
    feed = ScannerFeed(SCANNER, fleet)
    seen = feed.scan(feed.true_ranges())
    ranges = plate_ranges(robot.plate, seen.from_world(fleet.pose()), SCANNER.bearings)
    both = np.isfinite(ranges) & np.isfinite(seen.ranges)
    differ = np.isfinite(ranges) != np.isfinite(seen.ranges)
    assert (both.sum(axis=1) >= 5).all()
    assert differ.sum() <= 1  # at an edge
    np.testing.assert_allclose(ranges[both], seen.ranges[both], atol=2e-4)  # the robot leans a little on its tracks


def test_a_plate_around_or_behind_the_scanner_is_not_seen():
    poses = np.array([[0.0, 0.0, 0.4], [-1.0, 0.0, 0.0], [0.0, -3.0, 0.0]])
    ranges = plate_ranges(Plate(), poses, np.radians([-45.0, 0.0, 45.0]))
    assert np.isnan(ranges).all()


def test_a_beam_along_a_side():
    """Directions that are parallel to a side meet it nowhere, or everywhere."""
    plate = Plate(0.6, 0.04)
    ranges = plate_ranges(plate, np.array([[2.0, 0.0, 0.0], [2.0, 0.5, 0.0]]), np.zeros(1))
    np.testing.assert_allclose(ranges, [[1.7], [np.nan]])


def test_times_noise_and_reach():
    time = np.linspace(0.0, 20.0, 401)
    pose = np.stack([0.5 + time, 0 * time, 0 * time], axis=-1)  # away from the scanner, end on
    scanner = LaserScanner(rate=50.0, noise=0.01, max_range=10.0)
    mount = np.array([0.0, 0.0, 0.0])
    seen, scan = plate_scans(scanner, mount, Plate(), Motion(time, pose), np.random.default_rng(0))
    np.testing.assert_allclose(np.diff(seen), 0.02)
    assert 0 <= seen[0] < 0.02
    ahead = scan.ranges[:, len(scan.bearings) // 2]
    error = ahead - (0.5 + seen - 0.3)
    within = 0.2 + seen < 9.9
    assert np.isnan(ahead[seen > 9.9]).all()
    assert abs(np.std(error[within]) / 0.01 - 1) < 4 / np.sqrt(2 * within.sum())
    assert abs(np.mean(error[within])) < 4 * 0.01 / np.sqrt(within.sum())
