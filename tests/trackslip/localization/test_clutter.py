"""Posts, walls and people in the field don't capture the track."""

from dataclasses import replace

import numpy as np
import pytest
from clutter import among, circle, cylinders, tracked, wall

from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Plate, extract_plate

MOUNT = (0.0, 0.0, np.pi / 2)
START = np.array([0.35, 2.05, 0.3])


def posts(scan, poses, radius):
    return [cylinders(scan, np.array(c), radius) for c in ((-0.5, 1.4), (0.9, 1.2), (-1.9, 3.0), (0.2, 5.0))]


def walls(scan, poses, behind):
    far = 4.4 + behind
    return [
        wall(scan, np.array([-3.0, far]), np.array([3.0, far])),
        wall(scan, np.array([-2.2, 0.0]), np.array([-2.2, far])),
        wall(scan, np.array([2.2, 0.5]), np.array([2.5, far])),
    ]


def walker(scan, poses, depth):
    """Through the field and back, in front of the circle or behind it."""
    way = np.abs(np.linspace(-1, 1, len(scan.ranges)))
    return [cylinders(scan, np.column_stack([5 * way - 2.5, np.full(len(way), depth)]), 0.25)]


def companion(scan, poses, bearing):
    """Beside, in front of or behind the robot."""
    away = poses[:, 2] + bearing
    return [cylinders(scan, poses[:, :2] + 0.75 * np.column_stack([np.cos(away), np.sin(away)]), 0.2)]


def rms_deviation(estimate, poses):
    """Root mean square errors (3,) in the estimates' own standard deviations."""
    error = estimate.pose - poses
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    return np.sqrt(np.mean(error**2 / np.einsum("sii->si", estimate.covariance), axis=0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("afterwards", "things", "where", "most_blind"),
    [
        (False, posts, 0.03, 0.03),
        (True, posts, 0.1, 0.3),
        (False, walls, 0.35, 0.03),
        (True, walker, 1.5, 0.15),
        (False, companion, 1.2, 0.15),
        (True, companion, np.pi, 0.15),
    ],
)
def test_clutter_does_not_capture_the_track(afterwards, things, where, most_blind, scan_rectangle):
    rng = np.random.default_rng(0)
    twist = 0.52 * np.array([1.2, 1.0])
    poses = circle(twist, START, 180)
    alone = scan_rectangle(poses, rng, mount=MOUNT)
    scan = among(alone, things(alone, poses, where), rng)
    estimate = tracked(scan, poses, twist, PlateLocator(), afterwards)
    error = estimate.pose - poses
    good = estimate.valid
    assert good.mean() > 1 - most_blind
    assert good[-30:].any(), "lost"
    assert np.abs(error[:, 2]).max() < np.radians(30), "flipped"
    assert np.abs(error[good, :2]).max() < 0.06
    assert np.abs(error[good, 2]).max() < np.radians(10)
    deviation = (np.abs(error) / np.sqrt(np.einsum("sii->si", estimate.covariance)))[good]
    assert np.quantile(deviation, 0.95, axis=0).max() < 3


def test_a_post_in_front_cuts_the_plate_in_two_and_both_parts_count(scan_rectangle):
    rng = np.random.default_rng(1)
    poses = np.column_stack([np.full(200, 3.0), rng.uniform(-0.05, 0.05, 200), np.full(200, np.pi / 2 + 0.2)])
    scan = scan_rectangle(poses, rng)
    cut = among(scan, [cylinders(scan, np.array([2.0, 0.03]), 0.03)], rng)
    cluster = extract_plate(cut, Plate(), poses)
    whole = extract_plate(scan, Plate(), poses)
    for ends, wide in zip(cluster.extremes(cluster.bearing), whole.extremes(whole.bearing), strict=True):
        assert np.abs(ends - wide).max() <= 1.01 * scan.beam_step
    assert np.all(cluster.count < whole.count)
    assert np.all(cluster.lost == 0), "what is hidden isn't missed"
    for predicted in (poses, None):
        estimate = PlateLocator().locate(cut, predicted)
        assert estimate.valid.all()
        assert rms_deviation(estimate, poses).max() < 1.2


def test_what_is_always_there_is_not_the_plate(scan_rectangle):
    """A box as large as the plate, with more returns: known as background, it isn't taken for it."""
    rng = np.random.default_rng(3)
    poses = np.column_stack([np.full(100, 4.0), rng.uniform(0.5, 1.0, 100), rng.uniform(0.5, 1.5, 100)])
    box = scan_rectangle(np.array([[2.0, -1.0, 1.0]]), rng, noise=0.0).ranges
    scan = scan_rectangle(poses, rng)
    both = among(scan, [np.nan_to_num(box, nan=np.inf)], rng)
    taken = PlateLocator().locate(both)
    assert np.hypot(*(taken.pose - poses)[:, :2].T).min() > 1
    found = PlateLocator().locate(replace(both, background=box[0]))
    assert found.valid.all()
    assert np.hypot(*(found.pose - poses)[:, :2].T).max() < 0.03
