from dataclasses import replace

import numpy as np
import pytest

from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.localization.base import PoseEstimate
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

PLATE = PlateLocator()


def on_circles(rng, turns=20, per_turn=360, mount=(0.0, 0.0, 0.0)):
    """Poses whose headings go all the way round, at places all over the field."""
    heading = np.tile(np.linspace(-np.pi, np.pi, per_turn, endpoint=False), turns)
    distance, bearing = rng.uniform(1.5, 5.0, heading.size), rng.uniform(-0.8, 0.8, heading.size)
    local = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), heading])
    return Scan(np.zeros(2), np.empty((0, 2)), 0.0, np.array(mount)).to_world(local)


def viewing_angle(poses, mount=(0.0, 0.0)):
    """Angle between plate and line of sight, 0 edge-on to 90 broadside [deg]."""
    sight = np.arctan2(poses[:, 1] - mount[1], poses[:, 0] - mount[0])
    return np.degrees(np.abs(half_turn(poses[:, 2] - sight)))


def half_turn(angle):
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def test_plate_against_truth_at_every_viewing_angle(scan_rectangle):
    rng = np.random.default_rng(1)
    poses = on_circles(rng, turns=12)
    estimate = PLATE.locate(scan_rectangle(poses, rng))
    error = estimate.pose - poses
    error[:, 2] = half_turn(error[:, 2])
    good = estimate.valid
    assert good.mean() > 0.97
    assert np.sqrt(np.mean(error[good, :2] ** 2, axis=0)).max() < 0.003
    assert np.degrees(np.sqrt(np.mean(error[good, 2] ** 2))) < 0.35
    angle = viewing_angle(poses)
    deviation = error / np.sqrt(np.einsum("sii->si", estimate.covariance))
    for low, high in ((4, 10), (10, 30), (30, 60), (60, 90)):
        band = good & (angle >= low) & (angle < high)
        assert good[(angle >= low) & (angle < high)].all()
        assert np.abs(error[band, :2]).max() < 0.02
        assert np.abs(np.degrees(error[band, 2])).max() < 3
        # the stated covariance is the scatter; broadside, where the edges' error rules, less well
        spread = np.sqrt(np.mean(deviation[band] ** 2, axis=0))
        assert np.all(np.abs(spread - 1) < (0.12 if high <= 60 else 0.4)), (low, spread)
        assert np.all(np.abs(np.mean(deviation[band], axis=0)) < 0.25)
    # nearly edge-on it may decline, but what it does say is near
    edge_on = good & (angle < 4)
    assert edge_on.sum() > 50
    assert np.abs(np.degrees(error[edge_on, 2])).max() < 5
    assert np.degrees(np.sqrt(np.mean(error[edge_on, 2] ** 2))) < 1


def test_line_is_unbiased_where_one_face_is_seen_knows_its_errors_and_declines_edge_on(scan_rectangle):
    rng = np.random.default_rng(2)
    poses = on_circles(rng, turns=10)
    estimate = LineLocator().locate(scan_rectangle(poses, rng))
    error = estimate.pose - poses
    error[:, 2] = half_turn(error[:, 2])
    deviation = (error / np.sqrt(np.einsum("sii->si", estimate.covariance)))[estimate.valid]
    spread = np.sqrt(np.mean(deviation**2, axis=0))
    assert np.all((spread > 0.4) & (spread < 2.5))
    angle = viewing_angle(poses)
    broadside = angle > 75
    assert estimate.valid[broadside].all()
    # the thickness is accounted for: 2 cm else
    assert np.abs(error[broadside, :2].mean(axis=0)).max() < 0.002
    assert np.degrees(np.sqrt(np.mean(error[broadside, 2] ** 2))) < 0.4
    assert not estimate.valid[angle < 0.3].any()
    assert np.isnan(estimate.covariance[~estimate.valid]).all()


@pytest.mark.parametrize("locator", [PLATE, LineLocator()])
def test_where_the_scanner_stands_does_not_matter(locator, scan_rectangle):
    poses = on_circles(np.random.default_rng(3), turns=1, per_turn=60)
    here = locator.locate(scan_rectangle(poses, np.random.default_rng(4)))
    mount = (-1.5, -1.5, np.pi / 2)
    frame = Scan(np.zeros(2), np.empty((0, 2)), 0.0, np.array(mount))
    there = locator.locate(scan_rectangle(frame.to_world(poses), np.random.default_rng(4), mount=mount))
    np.testing.assert_array_equal(there.valid, here.valid)
    good = here.valid
    np.testing.assert_allclose(frame.from_world(there.pose)[good], here.pose[good], atol=1e-6)
    np.testing.assert_allclose(there.covariance[good], frame.covariance_to_world(here.covariance)[good], atol=1e-7)


def test_dropouts_cost_accuracy_and_the_covariance_says_so(scan_rectangle):
    rng, dropout = np.random.default_rng(8), 0.1
    poses = on_circles(rng, turns=8)
    scan = scan_rectangle(poses, rng)
    scan.ranges[rng.random(scan.ranges.shape) < dropout] = np.nan
    estimate = PLATE.locate(replace(scan, dropout=dropout))
    error = estimate.pose - poses
    error[:, 2] = half_turn(error[:, 2])
    rows = estimate.valid & (viewing_angle(poses) > 10)
    assert rows.sum() > 0.85 * len(poses)
    deviation = (error / np.sqrt(np.einsum("sii->si", estimate.covariance)))[rows]
    # the tails are geometric, not normal: longer; a normal variable's median size is 0.67
    np.testing.assert_allclose(np.median(np.abs(deviation), axis=0), 0.67, atol=0.16)
    assert np.sqrt(np.mean(deviation**2, axis=0)).max() < 1.7
    assert np.abs(error[rows, :2]).max() < 0.1


def test_a_plate_cut_by_the_field_of_view_is_not_placed_by_the_cut(scan_rectangle):
    rng = np.random.default_rng(9)
    bearing = np.radians(rng.uniform(82, 92, 600))
    distance = rng.uniform(1.5, 4.0, 600)
    poses = np.column_stack(
        [distance * np.cos(bearing), distance * np.sin(bearing), bearing + np.radians(rng.uniform(10, 170, 600))]
    )
    scan = scan_rectangle(poses, rng)
    cut = np.isfinite(scan.ranges[:, -1])
    assert cut.sum() > 100
    estimate = PLATE.locate(scan)
    placed = estimate.valid & cut
    error = estimate.pose - poses
    error[:, 2] = half_turn(error[:, 2])
    deviation = (error / np.sqrt(np.einsum("sii->si", estimate.covariance)))[placed]
    assert np.median(np.hypot(*error[placed, :2].T)) < 0.006
    assert np.sqrt(np.mean(deviation**2, axis=0)).max() < 1.6


def drive_blind(tracker, omega, steps, dt=0.05):
    for _ in range(steps):
        pose = tracker.predict(omega, dt)
    return pose


def test_tracker_resolves_half_turns_and_bridges_gaps():
    geometry = RobotGeometry(0.168, 0.06)
    omega = np.array([[2.0, 3.0]])
    tracker = Tracker(np.array([[0.0, 0.0, 3.0]]), geometry)
    turned = drive_blind(tracker, omega, 40)
    assert turned[0, 2] == pytest.approx(3.0 + 2.0 * body_twist(omega, 0.0, geometry)[0, 1])

    def measured(pose, valid=True):
        return PoseEstimate(np.array([pose]), np.eye(3)[None] * 1e-6, np.array([valid]))

    x, y, phi = turned[0]
    found = tracker.update(measured([x + 0.01, y, phi - np.pi + 0.02]))
    assert found.valid.all()
    np.testing.assert_allclose(found.pose[0], [x + 0.01, y, phi + 0.02])
    wild = tracker.update(measured([x + 1.0, y, phi]))
    assert not wild.valid.any()
    np.testing.assert_allclose(wild.pose[0], [x + 0.01, y, phi + 0.02])
    sideways = tracker.update(measured([x, y, phi + np.pi / 2]))
    assert not sideways.valid.any()
    grown = drive_blind(tracker, omega, 20)
    after = tracker.update(measured(grown[0], valid=False))
    assert after.covariance[0, 0, 0] > found.covariance[0, 0, 0]
