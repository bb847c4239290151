import numpy as np
import pytest

from sim.fleet import Fleet
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.trajectory.named import REFERENCES

POSES = np.array([[-1.5, 0.5, 0.3], [0.0, 1.0, 2.0], [-3.0, 3.0, -1.0], [-1.5, 1.0, np.pi / 2]])


def feed(robot, scanner=None, seed=0, poses=POSES):
    fleet = Fleet(robot, poses)
    return ScannerFeed(scanner or LaserScanner(), fleet, [generator(seed, f"{k}") for k in range(len(poses))])


def test_rays_are_those_of_a_rectangle(robot, scan_rectangle):
    expected = scan_rectangle(POSES, np.random.default_rng(0), noise=0.0, mount=tuple(robot.lrf_mount))
    ranges = feed(robot).true_ranges()
    assert ranges.shape == expected.ranges.shape == (4, 721)
    np.testing.assert_array_equal(np.isnan(ranges), np.isnan(expected.ranges))
    np.testing.assert_allclose(ranges, expected.ranges, atol=3e-5)  # it leans by 7e-6 rad until it has settled


def test_a_stream_of_scans_is_the_same_in_one_piece_or_many(robot):
    whole, pieces = feed(robot), feed(robot)
    true = np.repeat(whole.true_ranges()[:, None], 6, axis=1)
    parts = [pieces.measure(true[:, k : k + 2]) for k in (0, 2, 4)]
    np.testing.assert_array_equal(whole.measure(true), np.concatenate(parts, axis=1))


def test_dropouts_and_range_limit(robot):
    f = feed(robot, LaserScanner(dropout=0.25))
    true = np.repeat(f.true_ranges()[:, None], 100, axis=1)
    lost = np.isnan(f.measure(true))[np.isfinite(true)]
    assert lost.mean() == pytest.approx(0.25, abs=0.02)
    near = measured(robot, max_range=2.5)[1][:, 0]
    assert np.isfinite(near[0]).any()
    assert np.isnan(near[2]).all()


def test_a_seed_gives_each_robot_its_own_noise(robot):
    fleet = Fleet(robot, POSES[[0, 0]])
    true = ScannerFeed(LaserScanner(), fleet).true_ranges()[:, None]
    one, again, other = (ScannerFeed(LaserScanner(), fleet, seed).measure(true) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    for two in (other, one[::-1]):
        assert not np.array_equal(one, two, equal_nan=True)


def measured(robot, **options):
    """True ranges and measured ones (4, 100, B) of a scanner with some options."""
    f = feed(robot, LaserScanner(**options))
    true = np.repeat(f.true_ranges()[:, None], 100, axis=1)
    return true, f.measure(true)


def test_quantised_ranges_are_the_nearest_multiples_and_a_bias_is_added_to_all(robot):
    _, plain = measured(robot)
    _, rounded = measured(robot, quantisation=0.01)
    np.testing.assert_allclose(rounded / 0.01, np.round(rounded / 0.01), atol=1e-9)
    assert np.nanmax(np.abs(rounded - plain)) <= 0.005 + 1e-12
    stated = feed(robot, LaserScanner(quantisation=0.01)).scan(np.zeros((1, 721))).noise
    assert stated == pytest.approx(np.sqrt(LaserScanner().noise ** 2 + 0.01**2 / 12))
    np.testing.assert_array_equal(measured(robot, range_bias=-0.02)[1], plain - 0.02)


TRACKING_ERROR = 0.4  # m, to any side


def test_the_plate_stays_in_view_and_clear_of_the_scanner_on_every_reference(robot):
    for make in REFERENCES.values():
        reference = make()
        x, y, phi = reference.pose(np.linspace(0, reference.duration, 1001)).T
        ends = (x + 1j * y) + robot.plate_radius * np.array([[-1], [1]]) * np.exp(1j * phi)  # of the plate
        seen = (ends - complex(*robot.lrf_mount[:2])) * np.exp(-1j * robot.lrf_mount[2])  # forwards, to the left
        distance = np.abs(seen)
        assert distance.min() - TRACKING_ERROR > 1.0
        assert distance.max() + TRACKING_ERROR < 6.0
        bearing = np.abs(np.angle(seen)) + np.arcsin(TRACKING_ERROR / distance)
        assert bearing.max() < LaserScanner().field_of_view / 2 - np.radians(3)
