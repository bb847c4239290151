from dataclasses import replace

import numpy as np
import pytest
from beside import post
from bound import pose_bound, ratio_to_bound

from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.localization.likelihood import PlateBeams, PlateLikelihood, viewing_angle
from trackslip.localization.line import LineLocator, place
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Cluster, Plate, Scan, extract_plate, gather

LOCATOR = PlateLocator()
PLATE = Plate()
STEP = np.radians(0.25)
BEARINGS = np.arange(-360, 361) * STEP


def in_plane(distance, bearing, heading):
    """Poses (S, 3) of plates at these distances and bearings."""
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), heading])


def mounted(mount):
    """A scanner without scans at this pose in the world."""
    return Scan(np.zeros(2), np.empty((0, 2)), 0.0, np.array(mount))


def on_circles(rng, turns=20, per_turn=360):
    """Poses whose headings go all the way round, at places all over the field."""
    heading = np.tile(np.linspace(-np.pi, np.pi, per_turn, endpoint=False), turns)
    distance = rng.uniform(1.5, 5.0, heading.size)
    bearing = rng.uniform(-0.8, 0.8, heading.size)
    return in_plane(distance, bearing, heading)


def errors_of(estimate, poses, rows=slice(None)):
    """Errors (S, 3) of these rows, of headings but for half turns, and the same in the estimates'
    own standard deviations.
    """
    error = estimate.pose - poses
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    variance = np.einsum("sii->si", estimate.covariance)
    deviation = error / np.sqrt(variance)
    return error[rows], deviation[rows]


def rms(values):
    """Root mean squares (3,) of values (S, 3)."""
    return np.sqrt(np.mean(values**2, axis=0))


def test_lines_know_their_errors_and_decline_edge_on(
    scan_rectangle,
):
    rng = np.random.default_rng(2)
    poses = on_circles(rng, turns=10)
    estimate = LineLocator().locate(scan_rectangle(poses, rng))
    error, deviation = errors_of(estimate, poses)
    spread = rms(deviation[estimate.valid])
    assert np.all((spread > 0.4) & (spread < 2.5))
    angle = np.degrees(viewing_angle(poses))
    broadside = angle > 75
    assert estimate.valid[broadside].all()
    # the thickness is accounted for: 2 cm else
    bias = error[broadside, :2].mean(axis=0)
    assert np.abs(bias).max() < 0.002
    heading_error = rms(error[broadside])[2]
    assert np.degrees(heading_error) < 0.4
    assert not estimate.valid[angle < 0.3].any()
    assert np.isnan(estimate.covariance[~estimate.valid]).all()


@pytest.mark.parametrize("heading", np.arange(-3, 4) + 0.1)
@pytest.mark.parametrize("near", [0.2, -0.2 - PLATE.length], ids=["ahead", "behind"])
@pytest.mark.parametrize("seen", [0.3, 1.0])
def test_a_plate_reaches_from_its_near_end_behind_its_face(heading, near, seen):
    """In the plate's axes, it lies ahead of the scanner or behind it, and 2 m to its left; seen
    is a share of its long side, which begins at the end towards the scanner.
    """
    ends = np.array([near, near + PLATE.length])
    centre = np.array([ends.mean(), 2.0 + PLATE.thickness / 2])
    begin, end = ends if near > 0 else ends[::-1]
    along = np.linspace(begin, begin + seen * (end - begin), 40)
    returns = (along + 2.0j) * np.exp(1j * heading)
    cluster = Cluster(
        np.angle(returns), np.abs(returns), np.array([40]), np.zeros(1), np.full((1, 2), np.inf)
    )
    middle = returns.mean()
    middles = np.array([[middle.real, middle.imag]])
    ((x, y, phi),) = place(cluster, np.array([heading]), middles, PLATE)
    expected = complex(*centre) * np.exp(1j * heading)
    np.testing.assert_allclose([x, y, phi], [expected.real, expected.imag, heading], atol=1e-9)


def test_where_the_scanner_stands_does_not_matter(scan_rectangle):
    poses = on_circles(np.random.default_rng(3), turns=1, per_turn=60)
    here = LOCATOR.locate(scan_rectangle(poses, np.random.default_rng(4)))
    mount = (-1.5, -1.5, np.pi / 2)
    frame = mounted(mount)
    moved = frame.to_world(poses)
    there = LOCATOR.locate(scan_rectangle(moved, np.random.default_rng(4), mount=mount))
    np.testing.assert_array_equal(there.valid, here.valid)
    good = here.valid
    np.testing.assert_allclose(frame.from_world(there.pose)[good], here.pose[good], atol=1e-6)
    turned = frame.covariance_to_world(here.covariance)
    np.testing.assert_allclose(there.covariance[good], turned[good], atol=1e-7)


def test_dropouts_cost_accuracy_and_the_covariance_says_so(scan_rectangle):
    rng = np.random.default_rng(8)
    dropout = 0.1
    poses = on_circles(rng, turns=8)
    scan = scan_rectangle(poses, rng)
    scan.ranges[rng.random(scan.ranges.shape) < dropout] = np.nan
    estimate = LOCATOR.locate(replace(scan, dropout=dropout))
    rows = estimate.valid & (np.degrees(viewing_angle(poses)) > 10)
    assert rows.sum() > 0.85 * len(poses)
    error, deviation = errors_of(estimate, poses, rows)
    # the tails are geometric, not normal: longer; a normal variable's median size is 0.67
    np.testing.assert_allclose(np.median(np.abs(deviation), axis=0), 0.67, atol=0.16)
    assert rms(deviation).max() < 1.7
    assert np.abs(error[:, :2]).max() < 0.1


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_errors_are_told_even_if_ranges_scatter_more_than_said(scan_rectangle, factor):
    """Residuals show it: the covariances grow with them, instead of being too small by `factor`."""
    rng = np.random.default_rng(1)
    poses = on_circles(rng, turns=2, per_turn=180)
    scan = replace(scan_rectangle(poses, rng, noise=factor * 0.005), noise=0.005)
    estimate = LOCATOR.locate(scan)
    assert estimate.valid.mean() > 0.9
    _, deviation = errors_of(estimate, poses, estimate.valid)
    spread = rms(deviation)
    assert 0.75 < spread.min() < spread.max() < 1.33


def test_ranges_far_from_any_pose_give_none(scan_rectangle):
    """With residuals of ten standard deviations, instead of up to three."""
    rng = np.random.default_rng(1)
    poses = on_circles(rng, turns=1, per_turn=180)
    scan = replace(scan_rectangle(poses, rng, noise=0.05), noise=0.005)
    assert LOCATOR.locate(scan).valid.mean() < 0.1


def test_a_plate_within_two_degrees_of_edge_on_has_no_pose(scan_rectangle):
    rng = np.random.default_rng(2)
    heading = np.radians(np.linspace(-8, 8, 161))
    poses = in_plane(np.full(161, 3.0), np.zeros(161), heading)
    estimate = LOCATOR.locate(scan_rectangle(poses, rng))
    angle = np.degrees(viewing_angle(poses))
    assert not estimate.valid[angle < 1.8].any()
    assert estimate.valid[angle > 2.2].all()


def test_the_edge_of_the_field_of_view_does_not_place_a_plate(scan_rectangle):
    rng = np.random.default_rng(9)
    bearing = np.radians(rng.uniform(82, 92, 600))
    distance = rng.uniform(1.5, 4.0, 600)
    heading = bearing + np.radians(rng.uniform(10, 170, 600))
    poses = in_plane(distance, bearing, heading)
    scan = scan_rectangle(poses, rng)
    cut = np.isfinite(scan.ranges[:, -1])
    assert cut.sum() > 100
    estimate = LOCATOR.locate(scan)
    error, deviation = errors_of(estimate, poses, estimate.valid & cut)
    distance = np.hypot(error[:, 0], error[:, 1])
    assert np.median(distance) < 0.006
    assert rms(deviation).max() < 1.6


def drive_blind(tracker, omega, steps, dt=0.05):
    for _ in range(steps):
        pose = tracker.predict(omega, dt)
    return pose


def test_tracker_resolves_half_turns_and_bridges_gaps():
    geometry = RobotGeometry(0.168, 0.06)
    omega = np.array([[2.0, 3.0]])
    tracker = Tracker(np.array([[0.0, 0.0, 3.0]]), geometry)
    turned = drive_blind(tracker, omega, 40)
    yaw_rate = body_twist(omega, 0.0, geometry)[0, 1]
    assert turned[0, 2] == pytest.approx(3.0 + 2.0 * yaw_rate)

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
    size = np.radians(rng.uniform(*angle, n))
    off = size * rng.choice([-1, 1], n)
    distance = rng.uniform(*distance, n)
    bearing = rng.uniform(-1.0, 1.0, n)
    return in_plane(distance, bearing, bearing + off)


def test_plate_locator_is_within_a_tenth_of_the_bound(scan_rectangle):
    rng = np.random.default_rng(3)
    noise = 0.010
    everywhere = []
    errors = []
    bounds = []
    # angles from edge-on [deg], and the least share of scans that are localized
    for angle, share in (((3, 10), 0.94), ((10, 30), 0.99), ((30, 60), 0.99), ((60, 90), 0.99)):
        poses = seen_at(angle, rng, 800)
        estimate = LOCATOR.locate(scan_rectangle(poses, rng, noise=noise))
        good = estimate.valid
        assert good.mean() > share
        error, deviation = errors_of(estimate, poses, good)
        bound = pose_bound(poses[good], PLATE, BEARINGS, noise)
        ratio = ratio_to_bound(error, bound)
        assert ratio.max() < 1.1, (angle, ratio)
        errors.append(error)
        bounds.append(bound)
        spread = rms(deviation)
        assert (spread > 0.8).all()
        assert (spread < 1.15).all()
    everywhere = ratio_to_bound(np.concatenate(errors), np.concatenate(bounds))
    assert everywhere.max() < 1.1


def test_a_mirrored_prediction_of_few_returns_changes_nothing(scan_rectangle):
    """Plates seen nearly edge-on look like their mirror images; from few returns, a fit may stay at
    one that was predicted.
    """
    rng = np.random.default_rng(5)
    poses = seen_at((2, 8), rng, 120, distance=(1.5, 4.0))
    scan = scan_rectangle(poses, rng, noise=0.002)
    bearing = np.arctan2(poses[:, 1], poses[:, 0])
    mirrored = np.column_stack([poses[:, :2], 2 * bearing - poses[:, 2]])
    is_few = extract_plate(scan, PLATE, mirrored).count < 8
    assert is_few.sum() > 40

    few = replace(scan, ranges=scan.ranges[is_few])
    alone = LOCATOR.locate(few)
    predicted = LOCATOR.locate(few, mirrored[is_few])
    np.testing.assert_array_equal(predicted.valid, alone.valid)
    np.testing.assert_allclose(predicted.pose[alone.valid], alone.pose[alone.valid], atol=1e-5)


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
    for k, step in enumerate(h * np.eye(3)):
        up = likelihood.evaluate(beams, pose + step).cost
        down = likelihood.evaluate(beams, pose - step).cost
        np.testing.assert_allclose(gradient[:, k], (up - down) / (2 * h), rtol=1e-4, atol=1e-2)


def test_hessian_is_the_information_of_the_gradient(scan_rectangle):
    """At the true pose the gradient's scatter over noise is its mean Hessian, which is Fisher's
    information.
    """
    rng = np.random.default_rng(1)
    pose = np.tile([2.0, 0.3, 1.2], (2000, 1))
    scan = scan_rectangle(pose, rng)
    beams = PlateBeams.of(scan, extract_plate(scan, PLATE))
    likelihood = PlateLikelihood(PLATE, huber=100.0)
    fit = likelihood.evaluate(beams, pose).in_lrf_frame()
    ranges_only = fit.gradient - fit.gradient.mean(axis=0)  # the edges are the same in every scan
    scatter = ranges_only.T @ ranges_only / len(pose)
    no_edges = replace(beams, edges=replace(beams.edges, weight=0 * beams.edges.weight))
    of_ranges = likelihood.evaluate(no_edges, pose).in_lrf_frame()
    information = of_ranges.hessian.mean(axis=0)
    root = np.sqrt(np.diag(information))
    scale = np.outer(root, root)
    np.testing.assert_allclose(scatter / scale, information / scale, atol=0.1)


def with_ranges(scan, others, rng):
    """The scan with other ranges (B,), inf where there is nothing, merged into its nearest
    returns.
    """
    seen = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)
    noisy = others + rng.normal(0.0, scan.noise, seen.shape)
    nearest = np.where(others < seen, noisy, seen)
    return replace(scan, ranges=np.where(np.isfinite(nearest), nearest, np.nan))


def test_both_parts_of_a_plate_behind_a_post_count(scan_rectangle):
    rng = np.random.default_rng(1)
    y = rng.uniform(-0.05, 0.05, 200)
    poses = np.column_stack([np.full(200, 3.0), y, np.full(200, np.pi / 2 + 0.2)])
    scan = scan_rectangle(poses, rng)
    directions = np.stack([np.cos(scan.bearings), np.sin(scan.bearings)], axis=-1)
    hidden_by_post = post(2.0, 0.03, 0.03)(np.zeros(2), directions, np.zeros(1))
    cut = with_ranges(scan, hidden_by_post, rng)
    cluster = extract_plate(cut, PLATE, poses)
    whole = extract_plate(scan, PLATE, poses)
    ends = cluster.extremes(cluster.bearing)
    whole_ends = whole.extremes(whole.bearing)
    for end, whole_end in zip(ends, whole_ends, strict=True):
        assert np.abs(end - whole_end).max() <= 1.01 * scan.beam_step
    assert np.all(cluster.count < whole.count)
    assert np.all(cluster.lost == 0), "what is hidden isn't missed"
    for predicted in (poses, None):
        estimate = LOCATOR.locate(cut, predicted)
        assert estimate.valid.all()
        _, deviation = errors_of(estimate, poses)
        assert rms(deviation).max() < 1.2


@pytest.mark.parametrize(
    ("beside", "hidden"),
    [
        pytest.param([], 0, id="nothing beside it"),
        pytest.param([8, 8], 0, id="wall far behind"),
        pytest.param([2, 2, 2, 8], 3, id="post in front of a wall"),
        pytest.param([2, 2, np.nan], 2, id="post in an open field"),
        pytest.param([2.94, 2.94, 8], 2, id="object 6 cm in front"),
        pytest.param([2.96, 2.96, 8], np.inf, id="corner 4 cm in front"),
        pytest.param([2, 2, 3.1], np.inf, id="plate goes on behind a post"),
        pytest.param([2] * 10, np.inf, id="post up to the edge of view"),
        pytest.param([3.1, 8], 0, id="one mixed return"),
        pytest.param([3.1, 3.6], np.inf, id="two returns as of the plate"),
    ],
)
def test_angles_hidden_beside_a_plate(beside, hidden):
    """Returns beside a plate at 3 m, by beam, on one side; none on the other. A plate may go on
    where nothing tells its end.
    """
    behind = np.full(10, np.nan)
    behind[: len(beside)] = beside
    step = 0.01
    right_of_it = np.concatenate([np.full(10, np.nan), np.full(10, 3.0), behind])
    left_of_it = right_of_it[::-1]
    bearings = step * np.arange(30)
    scan = Scan(bearings, np.array([right_of_it, left_of_it]), 0.005, np.zeros(3))
    cluster = gather(scan, np.arange(2), np.repeat([0, 1], 10), np.tile(np.arange(10, 20), 2))
    expected = np.array([[0, hidden], [hidden, 0]]) * step
    np.testing.assert_allclose(cluster.hidden, expected)


def test_one_return_beside_a_plate_suffices_with_a_background():
    """Without one, it may be a mixture of plate and wall."""
    ranges = np.array([[3.0, 3.0, 3.0, 3.1, 8.0, 8.0]])
    beams = np.arange(3)
    for background, hidden in ((None, 0.0), (np.full(6, 8.0), np.inf)):
        scan = Scan(0.01 * np.arange(6), ranges, 0.005, np.zeros(3), background=background)
        cluster = gather(scan, np.zeros(1, int), np.zeros(3, int), beams)
        assert cluster.hidden[0, 1] == hidden


def test_what_is_always_there_is_not_the_plate(scan_rectangle):
    """A box as large as the plate, with more returns: known as background, it isn't taken for
    it.
    """
    rng = np.random.default_rng(3)
    y = rng.uniform(0.5, 1.0, 100)
    heading = rng.uniform(0.5, 1.5, 100)
    poses = np.column_stack([np.full(100, 4.0), y, heading])
    box = scan_rectangle(np.array([[2.0, -1.0, 1.0]]), rng, noise=0.0).ranges[0]
    both = with_ranges(scan_rectangle(poses, rng), np.nan_to_num(box, nan=np.inf), rng)

    def distances(estimate):
        error = estimate.pose - poses
        return np.hypot(error[:, 0], error[:, 1])

    taken = LOCATOR.locate(both)
    assert distances(taken).min() > 1
    found = LOCATOR.locate(replace(both, background=box))
    assert found.valid.all()
    assert distances(found).max() < 0.03
