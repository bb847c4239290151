"""Errors of measurement, each against its definition; the ranges without them must not change by a bit."""

import numpy as np
import pytest

from sim.fleet import Fleet
from sim.scanner.feed import ScannerFeed
from sim.scanner.obstacles import NAMED_OBSTACLES
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.errors import InvalidValueError

POSES = np.array([[-1.5, 0.5, 0.3], [0.0, 1.0, 2.0], [-3.0, 3.0, -1.0]])
EVERYTHING = LaserScanner(dropout=0.1, quantisation=0.01, range_bias=0.01, divergence=0.0044, scan_duration=0.0133)


def feed(robot, scanner, rows=(0, 1, 2), threads=1):
    fleet = Fleet(robot, POSES[list(rows)], threads=threads)
    return ScannerFeed(scanner, fleet, [generator(0, f"{k}") for k in rows], NAMED_OBSTACLES["walker"]), fleet


def measured(robot, scanner, scans=100):
    """True ranges and measured ones, both (3, scans, B)."""
    f, _ = feed(robot, scanner)
    true = np.repeat(f.true_ranges()[:, None], scans, axis=1)
    return true, f.measure(true).ranges


def test_with_everything_off_only_noise_and_dropouts_are_drawn(robot):
    scanner = LaserScanner(dropout=0.2)
    true, ranges = measured(robot, scanner, 5)
    for k in range(3):
        noise, dropout = generator(0, f"{k}").spawn(2)
        expected = scanner.noise * noise.standard_normal(true[k].shape) + true[k]
        expected[dropout.random(true[k].shape) < 0.2] = np.nan
        np.testing.assert_array_equal(ranges[k], expected)


def test_quantised_ranges_are_multiples_nearest_to_the_noisy_ones(robot):
    _, plain = measured(robot, LaserScanner())
    _, rounded = measured(robot, LaserScanner(quantisation=0.01))
    np.testing.assert_allclose(rounded / 0.01, np.round(rounded / 0.01), atol=1e-9)
    assert np.nanmax(np.abs(rounded - plain)) <= 0.005 + 1e-12


def test_the_locator_is_told_of_noise_and_rounding(robot):
    f, _ = feed(robot, LaserScanner(noise=0.003, quantisation=0.01))
    assert f.scan(np.zeros((1, 721))).noise == pytest.approx(np.sqrt(0.003**2 + 0.01**2 / 12))
    true, ranges = measured(robot, LaserScanner(noise=0.003, quantisation=0.01))
    assert np.nanstd(ranges - true) == pytest.approx(LaserScanner(noise=0.003, quantisation=0.01).range_std, rel=0.02)
    assert LaserScanner().range_std == LaserScanner().noise


def test_a_bias_is_added_to_every_range(robot):
    _, plain = measured(robot, LaserScanner())
    _, biased = measured(robot, LaserScanner(range_bias=-0.02))
    np.testing.assert_array_equal(biased, plain - 0.02)


def test_a_robots_scans_do_not_depend_on_neighbours_or_threads(robot):
    def scans(rows, threads):
        f, fleet = feed(robot, EVERYTHING, rows, threads)
        fleet.command([2.0, 3.0])
        taken = []
        for _ in range(4):
            fleet.advance(0.5)
            taken.append(f.measure(f.true_ranges()[:, None]).ranges)
        return np.concatenate(taken, axis=1)

    together = scans((0, 1, 2), 1)
    assert np.isfinite(together).any(axis=2).all()
    np.testing.assert_array_equal(together, scans((0, 1, 2), 2))
    for k in range(3):
        np.testing.assert_array_equal(together[k], scans((k,), 1)[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantisation": -0.01}, "quantisation = -0.01: must be a finite number >= 0"),
        ({"quantisation": 1.0}, "quantisation = 1.0: must be at most 0.5 m"),
        ({"quantisation": 1e-320}, "quantisation = 1e-320: must be 0, or at least 1e-06 m"),
        ({"range_bias": np.nan}, "range_bias = nan: must be from -0.5 to 0.5 m"),
        ({"divergence": 0.2}, "divergence = 0.2: must be at most 0.1 rad"),
        ({"scan_duration": 0.06}, "scan_duration = 0.06: must be at most 0.05 s, the time between scans"),
        ({"scan_duration": -0.01}, "scan_duration = -0.01: must be a finite number >= 0"),
    ],
)
def test_impossible_errors_are_refused(options, message):
    with pytest.raises(InvalidValueError, match=message):
        LaserScanner(**options)
