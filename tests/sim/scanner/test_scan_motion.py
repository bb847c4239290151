"""A scan that takes time, against scans of plates put where the robot is at each beam's moment."""

import numpy as np
import pytest
from scipy.linalg import expm

from sim.fleet import Fleet
from sim.scanner.feed import ScannerFeed
from sim.scanner.obstacles import Obstacles, Walker
from sim.scanner.scanner import LaserScanner

START = np.array([[-1.2, 0.3, 0.4], [-2.5, 0.8, 0.6]])
TWIST = np.array([[0.8, 0.1, 1.5], [-0.5, 0.0, 0.0]])  # forward, lateral, yaw rate


def ranges_of(fleet, scanner, obstacles=None):
    return ScannerFeed(scanner, fleet, obstacles=obstacles).true_ranges()


def moving(robot):
    fleet = Fleet(robot, START)
    cos, sin = np.cos(START[:, 2]), np.sin(START[:, 2])
    fleet.batch.qvel[:, 0] = cos * TWIST[:, 0] - sin * TWIST[:, 1]
    fleet.batch.qvel[:, 1] = sin * TWIST[:, 0] + cos * TWIST[:, 1]
    fleet.batch.qvel[:, 5] = TWIST[:, 2]
    np.testing.assert_allclose(fleet.twist(), TWIST, atol=1e-6)
    return fleet


def matrix(x, y, phi):
    return np.array([[np.cos(phi), -np.sin(phi), x], [np.sin(phi), np.cos(phi), y], [0, 0, 1.0]])


def moved(pose, twist, time):
    """The pose after `time`: the matrix exponential of SE(2)."""
    v, u, w = twist
    m = matrix(*pose) @ expm(time * np.array([[0, -w, v], [w, 0, u], [0, 0, 0]]))
    return np.array([m[0, 2], m[1, 2], pose[2] + w * time])


@pytest.mark.parametrize("divergence", [0.0, 0.0044])
def test_each_beam_sees_the_plate_at_its_own_time(robot, divergence):
    options = {"resolution": np.radians(1.0), "divergence": divergence}
    skewed = LaserScanner(scan_duration=0.05, **options)
    ranges, lag = ranges_of(moving(robot), skewed), skewed.lag
    assert lag[-1] - lag[0] == pytest.approx(0.05)
    assert lag[90] == 0.0  # the middle of the sweep is the scan's time
    for pose, twist, seen in zip(START, TWIST, ranges, strict=True):
        assert np.isfinite(seen).sum() > 5
        standing = Fleet(robot, [moved(pose, twist, time) for time in lag])
        expected = np.diag(ranges_of(standing, LaserScanner(**options)))
        np.testing.assert_allclose(seen, expected, atol=3e-5)  # standing, the plate leans by microradians
    assert np.nanmax(np.abs(ranges - ranges_of(moving(robot), LaserScanner(**options)))) > 1e-3


def test_a_person_is_seen_where_each_beam_finds_them(robot):
    scanner = LaserScanner(scan_duration=0.05)
    walker = Walker(-1.9, -0.5, 4.0, 0.0)
    ranges = ranges_of(Fleet(robot, [[5.0, 5.0, 0.0]]), scanner, Obstacles(walkers=(walker,)))[0]
    beams = np.flatnonzero(ranges < 2.0)
    direction = np.pi / 2 + scanner.bearings[beams]
    point = np.array([-1.5, -1.5]) + ranges[beams, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    assert len(beams) > 50
    np.testing.assert_allclose(np.hypot(*(point - walker.place(scanner.lag[beams])).T), walker.radius, atol=1e-9)
