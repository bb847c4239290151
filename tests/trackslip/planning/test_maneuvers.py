"""Maneuvers keep to the limits, drive their ways exactly, and take no longer than they have to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackslip.planning.limits import DriveLimits
from trackslip.planning.route import RATE, TURNING, Maneuvers, longest_spin

LIMITS = DriveLimits(max_speed=0.3, acceleration=0.5, area=(3.0, 3.0), duration=60.0)
WAYS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=8)


@given(WAYS, st.floats(0.05, 3.0), st.floats(0.1, 5.0))
def test_speeds_and_accelerations_stay_within_the_limits(ways, speed, acceleration):
    limits = DriveLimits(speed, acceleration, (3.0, 3.0), 60.0)
    maneuvers = Maneuvers.of(np.array(ways), limits)
    if not len(maneuvers.way):
        return
    speeds = maneuvers.speeds(maneuvers.duration.sum() + 1.0)
    assert np.abs(speeds).max() <= speed * (1 + 1e-9)
    change = np.diff(speeds, axis=0, prepend=np.zeros((1, 2)), append=np.zeros((1, 2)))
    assert np.abs(change).max() * RATE <= acceleration * (1 + 1e-6)
    np.testing.assert_allclose(speeds.sum(axis=0) / RATE, maneuvers.way.sum(axis=0), atol=1e-9)
    np.testing.assert_array_equal(speeds[-1], 0.0)


def test_the_times_are_those_of_trapezoids_and_triangles():
    straight = Maneuvers.of(np.array([[3.0, 3.0], [0.1, 0.1]]), LIMITS)
    np.testing.assert_allclose(straight.duration, [3.0 / 0.3 + 0.3 / 0.5, 2 * np.sqrt(0.1 / 0.5)], atol=1 / RATE)
    assert (straight.duration >= [10.6, 2 * np.sqrt(0.2)]).all()


def test_yaw_rates_are_limited():
    spin = Maneuvers.of(np.array([[-3.0, 3.0]]), LIMITS).speeds(60.0)
    assert np.abs(spin).max() == pytest.approx(TURNING * 0.3, rel=1e-3)
    bend = Maneuvers.of(np.array([[2.0, 3.0]]), LIMITS).speeds(60.0)
    assert bend.max() == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize("duration", [0.1, 0.5, 1.0, 7.31])
def test_the_longest_spin_fits_and_none_longer_does(duration):
    way = longest_spin(duration, LIMITS)
    assert Maneuvers.of(np.array([[-way, way]]), LIMITS).duration.sum() <= duration + 1e-9
    longer = way + 0.3 / RATE
    assert Maneuvers.of(np.array([[-longer, longer]]), LIMITS).duration.sum() > duration
