from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_motion import LawMotion, driven_by_law
from scipy.integrate import cumulative_trapezoid
from scipy.special import jn_zeros

from sim.wander.motion import DRIVING, Driver, Motion, joined_log, track_commands
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr

RATE = 50.0


def commands(driving, seed=0, duration=120.0, driver=None):
    rng = np.random.default_rng(seed)
    return track_commands(driving, duration, RATE, driver or Driver(), rng)


@settings(max_examples=40)
@given(
    st.sampled_from(list(DRIVING)),
    st.integers(0, 10**6),
    st.floats(0.05, 2.0),
    st.floats(0.1, 5.0),
    st.floats(0.03, 1),
)
def test_speeds_and_accelerations_stay_within_their_limits(
    driving, seed, max_speed, acceleration, half_gauge
):
    speeds = commands(driving, seed, 30.0, Driver(max_speed, acceleration, half_gauge))
    assert np.abs(speeds).max() <= max_speed * (1 + 1e-12)
    rate_of_change = np.diff(speeds, axis=0) * RATE
    assert np.abs(rate_of_change).max() <= acceleration * (1 + 1e-9)
    np.testing.assert_array_equal(speeds[0], 0.0)
    assert len(speeds) == 1501


NIMBLE = Driver(max_speed=0.3, acceleration=5.0, half_gauge=0.2)
"""Turns as fast as its top speed allows."""
SLUGGISH = Driver(max_speed=2.0, acceleration=0.3, half_gauge=0.2)
"""Turns as fast as its acceleration allows."""


def twists(speeds, driver):
    """Speed ahead [m/s] and yaw rate [rad/s], each (T,), of a robot that doesn't slip."""
    left, right = speeds.T
    return (left + right) / 2, (right - left) / (2 * driver.half_gauge)


def stretches(is_inside):
    """First rows and ends of the stretches of rows in a mask (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_inside.astype(int), [0]])))
    return edges.reshape(-1, 2)


def held(speeds):
    """Speeds (K, 2) [m/s] that are held, one after another, and for how long (K,) [s]."""
    rows = stretches((np.diff(speeds, axis=0) == 0).all(axis=1))
    rows = rows[(rows[:, 1] - rows[:, 0]) > 0.3 * RATE]
    return speeds[rows[:, 0]], (rows[:, 1] - rows[:, 0]) / RATE


@pytest.mark.parametrize("driver", [NIMBLE, SLUGGISH], ids=["nimble", "sluggish"])
def test_a_loop_has_straights_of_4_s_and_right_angles(driver):
    ahead, rate = twists(commands("loop", driver=driver, duration=200.0), driver)
    begun = np.flatnonzero(ahead >= 0.6 * driver.max_speed * (1 - 1e-9))[0]
    np.testing.assert_allclose(ahead[begun:], 0.6 * driver.max_speed)
    corners = stretches(np.abs(rate) > 1e-9)
    corners = corners[(corners[:, 0] > begun) & (corners[:, 1] < len(rate))]
    turned = [np.sum(rate[first:end]) / RATE for first, end in corners]
    np.testing.assert_allclose(np.abs(turned), np.pi / 2, rtol=1e-3)
    assert abs(np.sum(np.sign(turned))) == len(turned) > 3
    straight = (corners[1:, 0] - corners[:-1, 1]) / RATE
    np.testing.assert_allclose(straight, 4.0, atol=2 / RATE)
    by_turning = np.abs(rate[begun:]) * driver.half_gauge
    change = np.abs(np.diff(rate[begun:])) * RATE * driver.half_gauge
    if driver is NIMBLE:
        assert by_turning.max() == pytest.approx(0.4 * driver.max_speed, rel=0.01)
    else:
        assert change.max() == pytest.approx(driver.acceleration / 2, rel=0.01)


@pytest.mark.parametrize("driver", [NIMBLE, SLUGGISH], ids=["nimble", "sluggish"])
def test_figure_eights_close(driver):
    """With a heading A sin(f t), J_0(A) = 0, the mean of cos(heading) over a period is 0."""
    ahead, rate = twists(commands("eights", driver=driver, duration=400.0), driver)
    begun = np.flatnonzero(ahead >= ahead.max() * (1 - 1e-9))[0]
    assert 0.5 <= ahead.max() / driver.max_speed <= 0.7
    heading = cumulative_trapezoid(rate[begun:], dx=1 / RATE, initial=0.0)
    (amplitude,) = jn_zeros(0, 1)
    assert np.ptp(heading) / 2 == pytest.approx(amplitude, rel=1e-3)
    period = 2 * np.pi * amplitude / np.abs(rate).max()
    place = cumulative_trapezoid(np.exp(1j * heading), dx=1 / RATE, initial=0.0)
    time = np.arange(len(place)) / RATE
    again = np.interp(period, time, place.real) + 1j * np.interp(period, time, place.imag)
    heading_again = np.interp(period, time, heading)
    assert heading_again == pytest.approx(heading[0], abs=0.01)
    assert abs(again) < 0.001 * period  # of the way of a period


def test_stop_and_go_has_stops_between_straights_and_turns():
    driver = Driver()
    speeds, duration = held(commands("stop_and_go", duration=1000.0))
    speeds /= driver.max_speed
    stops = (speeds == 0).all(axis=1)
    assert stops[1::2].all()
    assert not stops[::2].any()
    assert ((duration[1:-1:2] >= 0.45) & (duration[1:-1:2] <= 2.0)).all()
    assert ((duration[:-1:2] >= 3.45) & (duration[:-1:2] <= 6.0)).all()
    left, right = speeds[::2].T
    outer = np.maximum(left, right)
    assert ((outer >= 0.4) & (outer <= 1.0)).all()
    assert (np.minimum(left, right) >= 0).all()
    is_straight = left == right
    assert is_straight[::4].all()
    assert is_straight.sum() == len(is_straight[::4]) > 30
    to_the_left = np.mean(right[~is_straight] > left[~is_straight])
    assert 0.3 < to_the_left < 0.7


def test_random_levers_are_mostly_forwards_and_apart():
    """Of a hundred positions, both levers are equal in eight, reversed in six and at rest in six;
    the others are uniform numbers to the power of 0.6 from -0.3 to 1.
    """
    speeds, duration = held(commands("random", duration=20_000.0))
    levers = speeds / Driver().max_speed
    count = len(levers)
    at_rest = (levers == 0).all(axis=1)
    is_equal = np.isclose(levers[:, 0], levers[:, 1], rtol=1e-12) & ~at_rest
    is_reversed = (levers < -0.3).any(axis=1)
    assert (levers[is_equal] > 0).all()
    moving = duration[:-1][~at_rest[:-1]]
    assert ((moving >= 0.45) & (moving <= 1.5)).all()

    # two rests in a row are one; a reversed lever is above -0.3 for numbers below this
    once = 1 - 0.06**2
    shallow = (0.6 / 1.3) ** (1 / 0.6)
    for mask, share in (
        (at_rest, 0.06 * (1 - 0.06) / once),
        (is_equal, 0.08 / once),
        (is_reversed, 0.06 * (1 - shallow**2) / once),
    ):
        deviation = np.sqrt(share * (1 - share) / count)
        assert mask.mean() == pytest.approx(share, abs=4 * deviation)
    assert (levers[is_reversed] <= 0.3).all()
    kept = levers[~at_rest & ~is_equal & ~is_reversed]
    assert kept.max() == pytest.approx(1.0, abs=0.01)
    assert kept.min() == pytest.approx(-0.3, abs=0.01)


@pytest.mark.parametrize(
    ("driving", "duration", "rate", "said"),
    [
        ("spin", 1.0, 50.0, "driving = 'spin': must be one of random, eights, stop_and_go, loop"),
        ("loop", 0.0, 50.0, "duration = 0.0: must be a finite number > 0"),
        ("loop", 1.0, 0.0, "rate = 0.0: must be a finite number > 0"),
        ("loop", 0.019, 50.0, "duration = 0.019: must be at least a period .*, 0.02 s"),
    ],
)
def test_driving_that_cannot_be_is_refused(driving, duration, rate, said):
    with pytest.raises(InvalidValueError, match=said):
        track_commands(driving, duration, rate, Driver(), np.random.default_rng(0))


def test_rows_go_up_to_the_duration():
    """Also where it isn't a multiple of the period, or only nearly one in binary numbers."""
    for duration, rate, rows in ((0.02, 50.0, 2), (0.039, 50.0, 2), (0.3, 10.0, 4)):
        speeds = track_commands("loop", duration, rate, Driver(), np.random.default_rng(0))
        assert len(speeds) == rows


GEOMETRY = RobotGeometry(0.168, 0.06)


@pytest.fixture
def encoders():
    rng = np.random.default_rng(0)
    omega = track_commands("random", 20.0, RATE, Driver(), rng) / GEOMETRY.sprocket_radius
    robot = LawMotion(ConstantIcr(0.045, 0.168, 0.0066), GEOMETRY)
    log, _ = driven_by_law("drive", robot, omega, RATE, rng)
    return log


def test_rows_are_those_of_both_clocks(encoders):
    stamps = np.array([-0.01, 0.0, 0.013, 0.02, 0.5, 20.0, 20.001])
    poses = np.arange(21.0).reshape(7, 3)
    log = joined_log(encoders, stamps, poses)
    assert len(log.time) == len(encoders.time) + 1  # 0, 0.02, 0.5 and 20 s are the encoders', too
    assert (np.diff(log.time) > 0).all()
    np.testing.assert_allclose(log.time[log.valid], stamps[1:6])
    np.testing.assert_array_equal(log.pose[log.valid], poses[1:6])
    assert np.isnan(log.pose[~log.valid]).all()


def test_sprockets_and_truth_are_those_of_the_encoders_rows(encoders):
    stamps = np.sort(np.random.default_rng(1).uniform(0, 20, 200))
    log = joined_log(encoders, stamps, np.zeros((200, 3)))
    angle = np.cumsum(log.omega[1:] * np.diff(log.time)[:, None], axis=0)
    rows = np.isin(log.time, encoders.time)
    expected = np.cumsum(encoders.omega[1:] / RATE, axis=0)
    np.testing.assert_allclose(angle[rows[1:]], expected, atol=1e-9)
    np.testing.assert_allclose(log.truth.pose[rows], encoders.truth.pose, atol=1e-12)
    np.testing.assert_allclose(log.truth.twist[rows], encoders.truth.twist, atol=1e-12)


def test_a_row_with_only_a_pose_has_the_command_in_force(encoders):
    """That of the reading before, until the next reading."""
    command = np.arange(2.0 * len(encoders.time)).reshape(-1, 2)
    commanded = replace(encoders, command=command)
    log = joined_log(commanded, np.array([0.013, 0.5, 19.99]), np.zeros((3, 3)))
    np.testing.assert_array_equal(log.command[log.read], command)
    np.testing.assert_array_equal(log.command[log.valid], command[[0, 25, 999]])


RNG = np.random.default_rng(4)


def test_poses_between_rows_lie_on_the_arc():
    twist = np.array([0.2, 0.9])
    time = np.cumsum(RNG.uniform(0.05, 0.2, 40))
    start = np.array([1.0, -2.0, 3.0])
    at = RNG.uniform(time[0], time[-1], 100)
    motion = Motion(time, advance(start, twist, time))
    np.testing.assert_allclose(motion.at(at), advance(start, twist, at), atol=1e-12)
    np.testing.assert_allclose(motion.at(time), motion.pose, atol=1e-12)
