"""Whole circles, twice a turn edge-on: no track is lost, none flips."""

import numpy as np
import pytest
from driving import circles, track_afterwards, track_online

from trackslip.localization.plate import PlateLocator

MOUNT = (0.0, 0.0, np.pi / 2)


def drive_circles(rng, robots, rows):
    """Robots on circles of random radius, speed, sense and phase, in front of the scanner."""
    radius = rng.uniform(0.5, 1.8, robots)
    rate = rng.uniform(1.0, 1.5, robots) * 2 * np.pi / (rows * 0.05) * rng.choice([-1, 1], robots)
    phase = rng.uniform(-np.pi, np.pi, robots)
    centre = np.column_stack([rng.uniform(-0.5, 0.5, robots), radius + rng.uniform(1.2, 2.5, robots)])
    away = np.sign(rate) * radius
    start = np.column_stack(
        [centre[:, 0] + away * np.sin(phase), centre[:, 1] - away * np.cos(phase), phase],
    )
    return circles(radius, rate, start, rows)


def assert_on_track(estimate, drive, noise):
    error = estimate.pose.reshape(drive.pose.shape) - drive.pose
    valid = estimate.valid.reshape(drive.pose.shape[:2])
    assert valid.mean() > 0.97
    assert np.abs(error[..., 2]).max() < np.radians(12), "flipped, or lost"
    assert np.abs(error[..., :2]).max() < 0.1
    assert np.sqrt(np.mean(error[valid] ** 2, axis=0)).max() < 0.004 + 2 * noise
    # blind no longer than the plate is edge-on
    for robot in valid.T:
        assert np.diff(np.flatnonzero(np.concatenate([[True], robot, [True]]))).max() < 40


@pytest.mark.parametrize("track", [track_afterwards, track_online])
def test_a_few_circles(track, scan_rectangle):
    rng = np.random.default_rng(0)
    drive = drive_circles(rng, 5, 240)
    scan = scan_rectangle(drive.pose.reshape(-1, 3), rng, noise=0.005, mount=MOUNT)
    assert_on_track(track(scan, drive, PlateLocator()), drive, 0.005)
