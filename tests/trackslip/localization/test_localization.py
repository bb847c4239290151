from dataclasses import replace

import numpy as np
import pytest
from beside import post
from bound import pose_bound, ratio_to_bound

from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.localization.likelihood import PlateBeams, PlateLikelihood, viewing_angle
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Plate, Scan, extract_plate

LOCATOR, PLATE = PlateLocator(), Plate()
STEP = np.radians(0.25)
BEARINGS = np.arange(-360, 361) * STEP


def on_circles(rng, turns=20, per_turn=360, mount=(0.0, 0.0, 0.0)):
    """Poses whose headings go all the way round, at places all over the field."""
    heading = np.tile(np.linspace(-np.pi, np.pi, per_turn, endpoint=False), turns)
    distance, bearing = rng.uniform(1.5, 5.0, heading.size), rng.uniform(-0.8, 0.8, heading.size)
    local = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), heading])
    return Scan(np.zeros(2), np.empty((0, 2)), 0.0, np.array(mount)).to_world(local)


def errors_of(estimate, poses):
    """Errors (S, 3), of headings but for half turns, and the same in the estimates' own standard
    deviations.
    """
    error = estimate.pose - poses
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    return error, error / np.sqrt(np.einsum("sii->si", estimate.covariance))


def test_lines_know_their_errors_and_decline_edge_on(
    scan_rectangle,
):
    rng = np.random.default_rng(2)
    poses = on_circles(rng, turns=10)
    estimate = LineLocator().locate(scan_rectangle(poses, rng))
    error, deviation = errors_of(estimate, poses)
    spread = np.sqrt(np.mean(deviation[estimate.valid] ** 2, axis=0))
    assert np.all((spread > 0.4) & (spread < 2.5))
    angle = np.degrees(viewing_angle(poses))
    broadside = angle > 75
    assert estimate.valid[broadside].all()
    # the thickness is accounted for: 2 cm else
    assert np.abs(error[broadside, :2].mean(axis=0)).max() < 0.002
    assert np.degrees(np.sqrt(np.mean(error[broadside, 2] ** 2))) < 0.4
    assert not estimate.valid[angle < 0.3].any()
    assert np.isnan(estimate.covariance[~estimate.valid]).all()


def test_where_the_scanner_stands_does_not_matter(scan_rectangle):
    poses = on_circles(np.random.default_rng(3), turns=1, per_turn=60)
    here = LOCATOR.locate(scan_rectangle(poses, np.random.default_rng(4)))
    mount = (-1.5, -1.5, np.pi / 2)
    frame = Scan(np.zeros(2), np.empty((0, 2)), 0.0, np.array(mount))
    there = LOCATOR.locate(
        scan_rectangle(frame.to_world(poses), np.random.default_rng(4), mount=mount)
    )
    np.testing.assert_array_equal(there.valid, here.valid)
    good = here.valid
    np.testing.assert_allclose(frame.from_world(there.pose)[good], here.pose[good], atol=1e-6)
    np.testing.assert_allclose(
        there.covariance[good], frame.covariance_to_world(here.covariance)[good], atol=1e-7
    )


def test_dropouts_cost_accuracy_and_the_covariance_says_so(scan_rectangle):
    rng, dropout = np.random.default_rng(8), 0.1
    poses = on_circles(rng, turns=8)
    scan = scan_rectangle(poses, rng)
    scan.ranges[rng.random(scan.ranges.shape) < dropout] = np.nan
    estimate = LOCATOR.locate(replace(scan, dropout=dropout))
    rows = estimate.valid & (np.degrees(viewing_angle(poses)) > 10)
    assert rows.sum() > 0.85 * len(poses)
    error, deviation = (values[rows] for values in errors_of(estimate, poses))
    # the tails are geometric, not normal: longer; a normal variable's median size is 0.67
    np.testing.assert_allclose(np.median(np.abs(deviation), axis=0), 0.67, atol=0.16)
    assert np.sqrt(np.mean(deviation**2, axis=0)).max() < 1.7
    assert np.abs(error[:, :2]).max() < 0.1


def test_the_edge_of_the_field_of_view_does_not_place_a_plate(scan_rectangle):
    rng = np.random.default_rng(9)
    bearing = np.radians(rng.uniform(82, 92, 600))
    distance = rng.uniform(1.5, 4.0, 600)
    poses = np.column_stack(
        [
            distance * np.cos(bearing),
            distance * np.sin(bearing),
            bearing + np.radians(rng.uniform(10, 170, 600)),
        ]
    )
    scan = scan_rectangle(poses, rng)
    cut = np.isfinite(scan.ranges[:, -1])
    assert cut.sum() > 100
    estimate = LOCATOR.locate(scan)
    error, deviation = (values[estimate.valid & cut] for values in errors_of(estimate, poses))
    assert np.median(np.hypot(*error[:, :2].T)) < 0.006
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


def seen_at(angle, rng, n, distance=(1.5, 6.0)):
    """Poses (n, 3) in the LRF's frame, seen at angles (low, high) [deg] from edge-on, and the other
    way round.
    """
    off = np.radians(rng.uniform(*angle, n)) * rng.choice([-1, 1], n)
    distance, bearing = rng.uniform(*distance, n), rng.uniform(-1.0, 1.0, n)
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), bearing + off])


def test_plate_locator_is_within_a_tenth_of_the_bound(scan_rectangle):
    rng, noise = np.random.default_rng(3), 0.010
    everywhere = []
    for angle, share in (((3, 10), 0.94), ((10, 30), 0.99), ((30, 60), 0.99), ((60, 90), 0.99)):
        poses = seen_at(angle, rng, 800)
        estimate = LOCATOR.locate(scan_rectangle(poses, rng, noise=noise))
        good = estimate.valid
        assert good.mean() > share
        error, deviation = (values[good] for values in errors_of(estimate, poses))
        bound = pose_bound(poses[good], PLATE, BEARINGS, noise)
        ratio = ratio_to_bound(error, bound)
        assert ratio.max() < 1.1, (angle, ratio)
        everywhere.append((error, bound))
        spread = np.sqrt(np.mean(deviation**2, axis=0))
        assert (spread > 0.8).all()
        assert (spread < 1.15).all()
    error, bound = (np.concatenate(parts) for parts in zip(*everywhere, strict=True))
    assert ratio_to_bound(error, bound).max() < 1.1


def off_the_plate(scan_rectangle):
    """Poses (5, 3) that are slightly wrong, and the beams of the scans."""
    rng = np.random.default_rng(0)
    heading = np.radians([20.0, 55.0, 90.0, 130.0, 170.0])
    poses = np.column_stack([rng.uniform(1.5, 3.0, 5), rng.uniform(-1.0, 1.0, 5), heading])
    scan = scan_rectangle(poses, rng)
    beams = PlateBeams.of(scan, extract_plate(scan, PLATE))
    return poses + rng.normal(size=poses.shape) * [0.004, 0.004, 0.01], beams


def test_gradient_by_finite_differences(scan_rectangle):
    pose, beams = off_the_plate(scan_rectangle)
    likelihood = PlateLikelihood(PLATE, huber=3.0)
    gradient = likelihood.evaluate(beams, pose).in_lrf_frame().gradient
    h = 1e-7
    for k in range(3):
        up, down = (
            likelihood.evaluate(beams, pose + sign * h * np.eye(3)[k]).cost for sign in (1, -1)
        )
        np.testing.assert_allclose(gradient[:, k], (up - down) / (2 * h), rtol=1e-4, atol=1e-2)


def test_hessian_is_the_information_of_the_gradient(scan_rectangle):
    """At the true pose the gradient's scatter over noise is its mean Hessian, which is Fisher's
    information.
    """
    rng = np.random.default_rng(1)
    pose = np.tile([2.0, 0.3, 1.2], (2000, 1))
    scan = scan_rectangle(pose, rng)
    beams = PlateBeams.of(scan, extract_plate(scan, PLATE))
    fit = PlateLikelihood(PLATE, huber=100.0).evaluate(beams, pose).in_lrf_frame()
    ranges_only = fit.gradient - fit.gradient.mean(axis=0)  # the edges are the same in every scan
    scatter = ranges_only.T @ ranges_only / len(pose)
    no_edges = replace(beams, edges=replace(beams.edges, weight=0 * beams.edges.weight))
    information = (
        PlateLikelihood(PLATE, huber=100.0)
        .evaluate(no_edges, pose)
        .in_lrf_frame()
        .hessian.mean(axis=0)
    )
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(
        scatter / np.outer(scale, scale), information / np.outer(scale, scale), atol=0.1
    )


def with_ranges(scan, others, rng):
    """The scan with other ranges (B,), inf where there is nothing, merged into its nearest
    returns.
    """
    seen = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)
    nearest = np.where(others < seen, others + rng.normal(0.0, scan.noise, seen.shape), seen)
    return replace(scan, ranges=np.where(np.isfinite(nearest), nearest, np.nan))


def test_both_parts_of_a_plate_behind_a_post_count(scan_rectangle):
    rng = np.random.default_rng(1)
    poses = np.column_stack(
        [np.full(200, 3.0), rng.uniform(-0.05, 0.05, 200), np.full(200, np.pi / 2 + 0.2)]
    )
    scan = scan_rectangle(poses, rng)
    beams = np.stack([np.cos(scan.bearings), np.sin(scan.bearings)], axis=-1)
    cut = with_ranges(scan, post(2.0, 0.03, 0.03)(np.zeros(2), beams, np.zeros(1)), rng)
    cluster, whole = (extract_plate(seen, PLATE, poses) for seen in (cut, scan))
    for ends, wide in zip(
        cluster.extremes(cluster.bearing), whole.extremes(whole.bearing), strict=True
    ):
        assert np.abs(ends - wide).max() <= 1.01 * scan.beam_step
    assert np.all(cluster.count < whole.count)
    assert np.all(cluster.lost == 0), "what is hidden isn't missed"
    for predicted in (poses, None):
        estimate = LOCATOR.locate(cut, predicted)
        assert estimate.valid.all()
        assert np.sqrt(np.mean(errors_of(estimate, poses)[1] ** 2, axis=0)).max() < 1.2


def test_what_is_always_there_is_not_the_plate(scan_rectangle):
    """A box as large as the plate, with more returns: known as background, it isn't taken for
    it.
    """
    rng = np.random.default_rng(3)
    poses = np.column_stack(
        [np.full(100, 4.0), rng.uniform(0.5, 1.0, 100), rng.uniform(0.5, 1.5, 100)]
    )
    box = scan_rectangle(np.array([[2.0, -1.0, 1.0]]), rng, noise=0.0).ranges
    both = with_ranges(scan_rectangle(poses, rng), np.nan_to_num(box[0], nan=np.inf), rng)
    taken = LOCATOR.locate(both)
    assert np.hypot(*(taken.pose - poses)[:, :2].T).min() > 1
    found = LOCATOR.locate(replace(both, background=box[0]))
    assert found.valid.all()
    assert np.hypot(*(found.pose - poses)[:, :2].T).max() < 0.03
