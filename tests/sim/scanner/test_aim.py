"""Only the beams that can meet the plate are cast; the ranges must be those of casting all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.drive.drive import Drive
from sim.drive.motor import Motor
from sim.fleet import Fleet
from sim.robot.parameters import RobotParameters
from sim.robot.robot import SCANNED_GROUP, load_robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner

SCANNERS = {
    "half circle": LaserScanner(),
    "narrow": LaserScanner(field_of_view=float(np.radians(40.0))),
    "wide": LaserScanner(field_of_view=float(np.radians(330.0)), resolution=float(np.radians(0.5))),
    "all around": LaserScanner(field_of_view=2 * np.pi, resolution=float(np.radians(1.0))),
    "coarse and short-sighted": LaserScanner(resolution=0.5, max_range=1.5),
}


def all_beams(scanner, fleet):
    """Ranges (N, B) of every beam of the scanner, cast without regard to where the plates are."""
    x, y, heading = fleet.robot.lrf_mount
    direction = heading + scanner.bearings
    rays = np.column_stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)])
    ranges, _ = fleet.batch.ray(
        np.array([x, y, fleet.robot.lrf_height]),
        rays,
        geomgroup=np.arange(6) == SCANNED_GROUP,
        bodyexclude=fleet.robot.model.body("lrf").id,
    )
    ranges[ranges < 0] = np.nan
    return ranges


def around_the_scanner(robot, distance, bearing, heading):
    x, y, mount = robot.lrf_mount
    return np.stack([x + distance * np.cos(mount + bearing), y + distance * np.sin(mount + bearing), heading], axis=-1)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(sorted(SCANNERS)), reach=st.sampled_from([0.4, 2.0, 25.0]))
def test_ranges_are_those_of_casting_every_beam(robot, seed, name, reach):
    """Near and far, in front and behind, and with the scanner inside the plate's sphere."""
    rng = np.random.default_rng(seed)
    distance, bearing, heading = rng.uniform([[0.0], [-np.pi], [-np.pi]], [[reach], [np.pi], [np.pi]], (3, 12))
    fleet = Fleet(robot, around_the_scanner(robot, distance, bearing, heading))
    np.testing.assert_array_equal(ScannerFeed(SCANNERS[name], fleet).true_ranges(), all_beams(SCANNERS[name], fleet))


@pytest.mark.parametrize("name", sorted(SCANNERS))
def test_the_seam_behind_the_scanner_and_its_edges(robot, name):
    bearing = np.radians([-180.0, -179.0, -166.0, -164.0, -91.0, -90.0, -20.0, 0.0, 19.0, 90.0, 165.0, 179.9])
    distance = np.full(12, 1.0)
    fleet = Fleet(robot, around_the_scanner(robot, distance, bearing, bearing))
    ranges = ScannerFeed(SCANNERS[name], fleet).true_ranges()
    np.testing.assert_array_equal(ranges, all_beams(SCANNERS[name], fleet))
    assert np.isfinite(ranges[7]).any()  # straight ahead


@pytest.mark.parametrize("name", ["half circle", "all around"])
def test_while_robots_drive_past_fast(robot, name):
    """The beams are chosen by where the plate was a physics step ago; at 2 m/s it has moved on by a centimetre."""
    scanner = SCANNERS[name]
    drive = Drive(top_speed=2.0, torque_limit=1e3, motor=Motor(stall_torque=1e3, no_load_speed=1e5))
    start = around_the_scanner(robot, np.array([0.8, 1.0, 1.5]), np.array([1.0, -0.5, 3.0]), np.array([0.0, 1.0, 2.0]))
    fleet = Fleet(robot, start, drive=drive)
    feed = ScannerFeed(scanner, fleet)
    fleet.command([[33.0, 33.0], [-33.0, -30.0], [15.0, 33.0]])
    seen = 0
    for _ in range(30):
        fleet.advance(scanner.period)
        ranges = feed.true_ranges()
        np.testing.assert_array_equal(ranges, all_beams(scanner, fleet))
        seen += np.isfinite(ranges).any(axis=1).sum()
    assert seen > 30


def test_a_plate_that_leans(robot):
    """On a slope, with the weight off the middle, the plate's middle isn't above the robot's."""
    leaning = load_robot(parameters=RobotParameters(com_x=0.04, com_y=0.04))
    fleet = Fleet(
        leaning, around_the_scanner(robot, np.array([0.35, 3.0]), np.array([0.3, -0.4]), np.array([1.0, 2.0]))
    )
    for scanner in SCANNERS.values():
        np.testing.assert_array_equal(ScannerFeed(scanner, fleet).true_ranges(), all_beams(scanner, fleet))
