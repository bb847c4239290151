"""Series of scans, and what they see behind what moves."""

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.rangefinder.background import background_of
from trackslip.rangefinder.series import ScanSeries


def series(ranges, first=-1.0, step=0.1, **limits):
    rows = np.tile(np.asarray(ranges, float), (20, 1))
    return ScanSeries.measured("a", np.arange(20) / 10, rows, first, step, **limits)


def test_what_is_a_return_follows_rep_117():
    ranges = [np.nan, np.inf, -np.inf, 0.0, 0.05, 0.1, 5.0, 9.99, 10.0, 11.0]
    found = series(ranges, range_min=0.1, range_max=10.0)
    np.testing.assert_array_equal(np.isfinite(found.ranges[0]), [0, 0, 0, 0, 0, 1, 1, 1, 0, 0])
    np.testing.assert_allclose(found.ranges[3, 5:8], [0.1, 5.0, 9.99], rtol=1e-7)


def test_beams_that_run_clockwise_are_turned_round_with_their_times():
    ranges = np.arange(1.0, 12.0)
    found = series(ranges, first=1.0, step=-0.1, time_increment=0.002)
    np.testing.assert_allclose(found.bearings, np.linspace(0.0, 1.0, 11), atol=1e-12)
    np.testing.assert_allclose(found.ranges[0], ranges[::-1])
    np.testing.assert_allclose(found.lag, 0.002 * np.arange(10, -1, -1))


def test_a_scanner_upside_down_sees_the_field_mirrored():
    found = series(np.arange(1.0, 12.0), first=-0.2).mirrored()
    np.testing.assert_allclose(found.bearings, np.linspace(-0.8, 0.2, 11), atol=1e-12)
    np.testing.assert_allclose(found.ranges[0], np.arange(11.0, 0.0, -1.0))


def test_a_full_circle_begins_where_it_is_told_to():
    beams = 360
    step = 2 * np.pi / beams
    found = series(np.arange(1.0, beams + 1), first=-np.pi, step=step)
    assert found.is_full_circle
    cut = found.from_beam(90)
    assert cut.ranges[0, 0] == 91
    x, y = cut.ranges[0] * np.cos(cut.bearings), cut.ranges[0] * np.sin(cut.bearings)
    back = np.argsort(cut.ranges[0])
    np.testing.assert_allclose(x[back], found.ranges[0] * np.cos(found.bearings), atol=1e-4)
    np.testing.assert_allclose(y[back], found.ranges[0] * np.sin(found.bearings), atol=1e-4)
    assert not series(np.ones(10)).is_full_circle


@pytest.mark.parametrize(
    ("ranges", "more", "said"),
    [
        (np.full(10, np.inf), {}, "no return"),
        (np.ones(5), {}, "of 5 beam"),
        (np.ones(10), {"step": 0.0}, "angle_increment = 0"),
        (np.ones(10), {"step": np.nan}, "angle_increment = nan"),
        (np.ones(100), {}, "at most a full circle"),
    ],
)
def test_scans_that_can_t_be_used(ranges, more, said):
    with pytest.raises(LogError, match=said):
        series(ranges, **more)


BEAMS, SCANS, NOISE = 200, 300, 0.008


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def scans(rng, wall=5.0, passing=20):
    """A wall, and something 30 beams wide that moves before it from side to side."""
    ranges = wall + rng.normal(0, NOISE, (SCANS, BEAMS))
    middle = (BEAMS - 30) * np.abs(np.linspace(-1, 1, SCANS))
    front = (np.arange(BEAMS) >= middle[:, None]) & (np.arange(BEAMS) < middle[:, None] + 30)
    ranges[front] = 2 + rng.uniform(0, 1, front.sum())
    return ranges, front


def test_level_and_noise_of_a_wall_behind_what_moves(rng):
    ranges, _ = scans(rng)
    found = background_of(ranges)
    assert found.beams == BEAMS
    np.testing.assert_allclose(found.level, 5.0, atol=4 * NOISE / np.sqrt(0.7 * SCANS))
    assert found.noise == pytest.approx(NOISE, rel=0.02)
    assert found.dropout == 0


def test_an_open_field_has_none(rng):
    ranges, front = scans(rng)
    assert background_of(np.where(front, ranges, np.nan)).beams == 0


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_beams_that_miss_now_and_then(rng, share):
    ranges, front = scans(rng)
    ranges[~front & (rng.random(ranges.shape) < share)] = np.nan
    found = background_of(ranges)
    assert found.beams == BEAMS
    assert found.dropout == pytest.approx(share, abs=0.01)


def test_what_stands_for_a_while_is_none(rng):
    """A person who stands in a third of the scans, before a wall and before nothing."""
    ranges, _ = scans(rng)
    ranges[:, : BEAMS // 2][ranges[:, : BEAMS // 2] > 4] = np.nan
    ranges[100:200, 60:140] = 1.5 + rng.normal(0, NOISE, (100, 80))
    found = background_of(ranges)
    assert np.isnan(found.level[: BEAMS // 2]).all()
    np.testing.assert_allclose(found.level[BEAMS // 2 :], 5.0, atol=0.01)


def test_what_is_hidden_tells_nothing(rng):
    """A robot that turns on the spot is always before some beams."""
    ranges, _ = scans(rng)
    ranges[:, 90:110] = 2.0 + rng.normal(0, NOISE, (SCANS, 20))
    assert np.isfinite(background_of(ranges).level[90:110]).all()
    hidden = np.zeros(ranges.shape, bool)
    hidden[:, 90:110] = True
    found = background_of(ranges, hidden)
    assert np.isnan(found.level[90:110]).all()
    assert np.isfinite(np.delete(found.level, np.s_[90:110])).all()


def test_a_beam_at_an_edge_may_meet_what_its_neighbours_meet(rng):
    ranges, front = scans(rng)
    ranges[:, 100:] = np.where(front[:, 100:], ranges[:, 100:], 3.0 + rng.normal(0, NOISE, (SCANS, 100)))
    found = background_of(ranges)
    np.testing.assert_allclose(sorted(found.levels[:2, 100]), [3.0, 5.0], atol=0.01)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_rounded_ranges(rng, step):
    ranges, _ = scans(rng)
    found = background_of(np.round(ranges / step) * step)
    assert found.noise == pytest.approx(np.hypot(NOISE, step / np.sqrt(12)), rel=0.05)
