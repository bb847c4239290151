"""Mixed pixels: echoes of a footprint, and the edges of a plate before a wall."""

import numpy as np
import pytest

from sim.fleet import Fleet
from sim.scanner.beams import MIN_SHARE, PULSE, SUBRAYS, echo
from sim.scanner.feed import ScannerFeed
from sim.scanner.obstacles import Obstacles, Wall
from sim.scanner.scanner import LaserScanner

LMS_200 = LaserScanner(divergence=0.0044)


def split(front, back, rays_in_front):
    return np.where(np.arange(SUBRAYS) < rays_in_front, front, back)


def test_overlapping_echoes_are_mixed_by_their_light():
    front, back = 2.0, 2.4
    for k in range(SUBRAYS + 1):
        light = np.array([k / front**2, (SUBRAYS - k) / back**2])
        assert echo(split(front, back, k)) == pytest.approx(light @ [front, back] / light.sum())


def test_of_distant_echoes_the_first_that_is_strong_enough_counts():
    for behind in (9.0, np.nan):
        for k in range(SUBRAYS + 1):
            strong = k / SUBRAYS >= MIN_SHARE
            np.testing.assert_allclose(echo(split(2.0, behind, k)), 2.0 if strong else behind, rtol=1e-12)


def test_echoes_too_weak_one_by_one_are_not_noticed():
    steps = 1.0 + 2 * PULSE * (np.arange(SUBRAYS) // 2)  # no two of them more than 2 / 9 of the footprint
    assert np.isnan(echo(steps))


def scan(robot, scanner, obstacles=None):
    fleet = Fleet(robot, [[-1.5, 0.5, 0.2]])
    return ScannerFeed(scanner, fleet, obstacles=obstacles).true_ranges()[0]


def test_pixels_are_mixed_at_edges_only(robot):
    wall = Obstacles(walls=(Wall(-4.0, 0.95, 1.0, 0.95),))
    sharp, mixed = scan(robot, LaserScanner(), wall), scan(robot, LMS_200, wall)
    edges = np.flatnonzero(np.diff(np.isfinite(scan(robot, LaserScanner()))))  # the beams before them
    assert len(edges) == 2
    ahead = np.abs(LaserScanner().bearings) < 0.6  # the wall has ends of its own, farther aside
    changed = ahead & (np.abs(mixed - sharp) > 1e-3)
    assert 1 <= changed.sum() <= 4
    for beam in np.flatnonzero(changed):
        assert np.abs(beam - edges - 0.5).min() <= 1.0
        assert sharp[beam - 1 : beam + 2].min() < mixed[beam] < sharp[beam - 1 : beam + 2].max()


def test_a_plate_before_nothing_looks_wider_by_half_a_beam_at_most(robot):
    sharp, mixed = np.isfinite(scan(robot, LaserScanner())), np.isfinite(scan(robot, LMS_200))
    assert np.all(mixed[sharp] | ~np.roll(sharp, 1)[sharp] | ~np.roll(sharp, -1)[sharp])
    finer = LaserScanner(field_of_view=1.0, resolution=1e-4)
    wider = LaserScanner(field_of_view=1.0, resolution=1e-4, divergence=0.0044)
    extra = np.isfinite(scan(robot, wider)).sum() - np.isfinite(scan(robot, finer)).sum()
    expected = 2 * (0.5 - MIN_SHARE) * 0.0044  # a side sees the plate until MIN_SHARE of its footprint is left
    assert extra * finer.resolution == pytest.approx(expected, abs=2 * 0.0044 / SUBRAYS)
