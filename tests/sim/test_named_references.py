"""The named references are where the shipped scanner sees the robot."""

import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.scanner.scanner import LaserScanner
from trackslip.trajectory.named import REFERENCES
from trackslip.trajectory.profile import LIMITS

TRACKING_ERROR = 0.4  # m, to any side


@pytest.mark.parametrize("name", REFERENCES)
def test_the_plate_stays_in_view_and_clear_of_the_scanner(robot, name):
    reference = REFERENCES[name]()
    x, y, phi = reference.pose(np.linspace(0, reference.duration, 1001)).T
    ends = (x + 1j * y) + robot.plate_radius * np.array([[-1], [1]]) * np.exp(1j * phi)  # of the plate
    seen = (ends - complex(*robot.lrf_mount[:2])) * np.exp(-1j * robot.lrf_mount[2])  # forwards, to the left
    distance = np.abs(seen)
    assert distance.min() - TRACKING_ERROR > 1.0
    assert distance.max() + TRACKING_ERROR < 6.0
    bearing = np.abs(np.angle(seen)) + np.arcsin(TRACKING_ERROR / distance)
    assert bearing.max() < LaserScanner().field_of_view / 2 - np.radians(3)


@pytest.mark.parametrize("name", REFERENCES)
def test_it_is_of_a_size_for_the_field(name):
    reference = REFERENCES[name]()
    time = np.linspace(0, reference.duration, 2001)
    pose, twist = reference.pose(time), reference.twist(time)
    assert 30 <= reference.duration <= 60
    assert 1.5 <= np.ptp(pose[:, :2], axis=0).max() <= 4.0
    assert np.all(np.abs(twist[:, 0]) >= 0.35 * np.abs(twist[:, 1]) - 1e-12)  # radii of at least 0.35 m


def test_limits_leave_the_drives_a_margin():
    assert LIMITS.track_speed <= 0.9 * Drive().top_speed
