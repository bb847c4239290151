import numpy as np
import pytest

from trackslip.rangefinder.background import background_of

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
