import numpy as np
import pytest

from trackslip.errors import LogError
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
