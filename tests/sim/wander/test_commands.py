"""What a driver commands: within limits, from rest, to both sides, with stops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.wander.commands import DRIVING, Driver, track_commands
from sim.wander.motion import arc_steps, joined
from trackslip.kinematics import twist_of_tracks

RATE = 50.0


def commands(driving: str, seed: int = 0, duration: float = 120.0, driver: Driver | None = None) -> np.ndarray:
    return track_commands(driving, duration, RATE, driver or Driver(), np.random.default_rng(seed))


@settings(max_examples=40)
@given(
    st.sampled_from(list(DRIVING)), st.integers(0, 10**6), st.floats(0.05, 2.0), st.floats(0.1, 5.0), st.floats(0.03, 1)
)
def test_speeds_and_accelerations_stay_within_their_limits(driving, seed, max_speed, acceleration, half_gauge):
    speeds = commands(driving, seed, 30.0, Driver(max_speed, acceleration, half_gauge))
    assert np.abs(speeds).max() <= max_speed * (1 + 1e-12)
    assert np.abs(np.diff(speeds, axis=0)).max() * RATE <= acceleration * (1 + 1e-9)
    np.testing.assert_array_equal(speeds[0], 0.0)
    assert len(speeds) == 1501


@pytest.mark.parametrize("driving", DRIVING)
def test_the_seed_decides(driving):
    np.testing.assert_array_equal(commands(driving, 3), commands(driving, 3))
    drives = [commands(driving, seed) for seed in range(8)]
    assert any(not np.array_equal(drives[0], other) for other in drives[1:])


@pytest.mark.parametrize("seed", range(5))
def test_random_driving_has_straights_turns_both_ways_stops_and_reversals(seed):
    left, right = commands("random", seed, 240.0).T
    moving = np.abs(left) + np.abs(right) > 0.05
    for kind in (
        moving & (left == right),
        left > right + 0.05,
        right > left + 0.05,
        (left < 0) & (right < 0),
        left * right < -1e-3,
        (left == 0) & (right == 0),
    ):
        assert kind.mean() > 0.01


def test_stop_and_go_holds_constant_speeds_between_stops():
    speeds = commands("stop_and_go", 1)
    changes = np.abs(np.diff(speeds, axis=0)).max(axis=1)
    begins = np.flatnonzero(np.diff(np.r_[1, changes > 0, 1]) == -1)
    ends = np.flatnonzero(np.diff(np.r_[1, changes > 0, 1]) == 1)
    held = speeds[begins]
    stops = ~held.any(axis=1)
    assert stops[1::2].all()
    assert not stops[::2].any()
    assert ((ends - begins)[:-1][~stops[:-1]] / RATE > 3.4).all()


@pytest.mark.parametrize(("driving", "rounds"), [("eights", 2), ("loop", 2)])
def test_figures_close_for_the_half_gauge_that_the_driver_reckons_with(driving, rounds):
    driver = Driver(half_gauge=0.213, acceleration=100.0)  # a short ramp, which would shift the figure
    twist = twist_of_tracks(commands(driving, 0, 200.0, driver), driver.half_gauge)
    pose = joined(np.zeros(3), arc_steps(np.insert(twist[1:], 1, 0.0, axis=-1), 1 / RATE))
    begin = 100
    away = np.hypot(*(pose[begin:, :2] - pose[begin, :2]).T)
    leaves = np.flatnonzero(away > 0.5)[0]
    turned = np.abs(pose[begin:, 2] - pose[begin, 2]) % (2 * np.pi)
    same_heading = np.minimum(turned, 2 * np.pi - turned) < 0.1
    again = np.flatnonzero((away < 0.02) & same_heading & (np.arange(len(away)) > leaves))
    assert len(again) >= rounds
