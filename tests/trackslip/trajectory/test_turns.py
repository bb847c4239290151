from math import pi
from typing import NamedTuple

import numpy as np
import pytest
from quadrature import integral_miss

from trackslip.errors import InvalidValueError
from trackslip.trajectory.path import LIMITS, MotionLimits
from trackslip.trajectory.turns import TurnOnTheSpot, turns_of
from trackslip.trajectory.waypoints import TOLERANCE, waypoints

YAW_ACCELERATION = LIMITS.yaw_rate * LIMITS.acceleration / LIMITS.speed


class Case(NamedTuple):
    """Waypoints, and the turns on the spot that they ask for."""

    points: list
    yaw: list | None
    turns: list  # place [m] and angle [rad] of each
    start: float  # first heading [rad]


AHEAD = [(0, 0), (0.5, 0), (1, 0)]
TO_THE_RIGHT = [(1, 0), (1, -0.5), (1, -1)]
ONWARD = [(1, 0), (1.5, 0), (2, 0)]
BACK = AHEAD[::-1]
CASES = {
    "turns left and reverses": Case(
        AHEAD + TO_THE_RIGHT, [0, 0, 0] + 3 * [pi / 2], [((1, 0), pi / 2)], 0.0
    ),
    "turns right and drives on": Case(
        AHEAD + TO_THE_RIGHT, [0, 0, 0] + 3 * [-pi / 2], [((1, 0), -pi / 2)], 0.0
    ),
    "turns round and reverses": Case(AHEAD + ONWARD, [0, 0, 0] + 3 * [pi], [((1, 0), pi)], 0.0),
    "turns round and drives back": Case(AHEAD + BACK, [0, 0, 0] + 3 * [pi], [((1, 0), pi)], 0.0),
    "turns at the start": Case(AHEAD, [pi / 2, 0, 0], [((0, 0), -pi / 2)], pi / 2),
    "turns at the goal": Case(AHEAD, [0, 0, 2], [((1, 0), 2)], 0.0),
    "turns at both": Case(AHEAD, [3, 0, pi], [((0, 0), -3), ((1, 0), pi)], 3.0),
    "turns at a corner": Case(
        [(0, 0), (1, 0), (1, -1), (1, -2)], [0, 0, -pi / 2, -pi / 2], [((1, 0), -pi / 2)], 0.0
    ),
    "turns the long way round": Case(
        [*AHEAD, (1, 0), (1, 0), (1, 0.5), (1, 1)],
        [0, 0, 0, -pi / 2, -pi, pi / 2, pi / 2],
        [((1, 0), -3 * pi / 2)],
        0.0,
    ),
    "looks to the left": Case(
        [(0, 0), (1, 0), (1, 0), (1, 0), (2, 0)],
        [0, 0, 1.5, 0, 0],
        [((1, 0), 1.5), ((1, 0), -1.5)],
        0.0,
    ),
    "only turns": Case([(2, 1)] * 3, [0, 1, 3], [((2, 1), 3)], 0.0),
    "corner given twice": Case(AHEAD + TO_THE_RIGHT, None, [((1, 0), -pi / 2)], 0.0),
    "tip given twice": Case(AHEAD + BACK, None, [((1, 0), pi)], 0.0),
}


def turned(reference):
    """Place and angle of each turn on the spot, from samples."""
    time = np.arange(0.0, reference.duration, 0.01)
    pose = reference.pose(time)
    v, w = reference.twist(time).T
    side = np.sign(w) * (v == 0)
    found = []
    for rows in np.split(np.arange(len(time)), np.flatnonzero(np.diff(side)) + 1):
        if side[rows[0]]:
            angle = np.trapezoid(w[rows], time[rows])
            found.append((pose[rows[0], :2], angle))
    return found


@pytest.mark.parametrize("name", CASES)
def test_it_turns_on_the_spot_where_headings_say_so(name):
    case = CASES[name]
    reference = waypoints(case.points, yaw=case.yaw)
    found = turned(reference)
    assert len(found) == len(case.turns)
    for (place, angle), (expected_place, expected_angle) in zip(found, case.turns, strict=True):
        np.testing.assert_allclose(place, expected_place, atol=1e-9)
        assert angle == pytest.approx(expected_angle, abs=2e-3)
    first, last = reference.pose([0.0, reference.duration])
    assert first[2] == pytest.approx(case.start, abs=1e-9)
    np.testing.assert_allclose(last[:2], case.points[-1], atol=1e-9)
    if case.yaw is not None:
        assert np.cos(last[2] - case.yaw[-1]) == pytest.approx(1)
    assert integral_miss(reference) < 1e-9


def test_a_forward_turn_and_reverse_takes_its_legs_and_its_turn():
    """Each leg of 1 m takes 1 m / 0.15 m/s + 3 s, the turn pi / 2 / 0.3 rad/s + 3 s."""
    case = CASES["turns left and reverses"]
    reference = waypoints(case.points, yaw=case.yaw)
    leg = 1.0 / LIMITS.speed + LIMITS.speed / LIMITS.acceleration
    turn = pi / 2 / LIMITS.yaw_rate + LIMITS.yaw_rate / YAW_ACCELERATION
    assert reference.duration == pytest.approx(2 * leg + turn, rel=1e-3)
    (found,) = turns_of(reference)
    assert found.time == pytest.approx(leg, abs=0.06)
    assert str(found) == "(1, 0) after 9.7 s"
    v, _ = reference.twist([leg / 2, leg + turn / 2, leg + turn + leg / 2]).T
    np.testing.assert_allclose(v, [0.15, 0.0, -0.15], atol=1e-9)


@pytest.mark.parametrize("angle", [0.01, -0.5, pi, -10.0])
def test_a_turn_accelerates_to_the_yaw_rate_and_brakes(angle):
    turn = TurnOnTheSpot((1.0, 2.0, 0.5), angle, LIMITS)
    ramp = LIMITS.yaw_rate / YAW_ACCELERATION
    duration = abs(angle) / LIMITS.yaw_rate + ramp
    if abs(angle) < LIMITS.yaw_rate * ramp:
        duration = 2 * np.sqrt(abs(angle) / YAW_ACCELERATION)
    assert turn.duration == pytest.approx(duration)
    np.testing.assert_allclose(turn.pose(turn.duration), [1.0, 2.0, 0.5 + angle])
    time = np.linspace(0, turn.duration, 1001)
    v, w = turn.twist(time).T
    np.testing.assert_array_equal(v, 0)
    assert np.abs(w).max() <= LIMITS.yaw_rate * (1 + 1e-12)
    assert np.abs(np.diff(w) / np.diff(time)).max() <= YAW_ACCELERATION * (1 + 1e-6)
    assert integral_miss(turn) < 1e-12


def test_wide_robots_turn_within_their_track_speed():
    limits = MotionLimits(half_gauge=3.0)
    turn = TurnOnTheSpot((0.0, 0.0, 0.0), pi, limits)
    _, w = turn.twist(np.linspace(0, turn.duration, 1001)).T
    assert w.max() * limits.half_gauge == pytest.approx(limits.track_speed)


@pytest.mark.parametrize(
    ("spacing", "sigma"), [(0.02, 0.0), (0.02, 0.002), (0.005, 0.002), (0.01, 0.004)]
)
def test_a_recorded_turn_is_one_turn(spacing, sigma):
    """Forwards, a turn recorded at 60 points that noise moves about, and reverse."""
    way = np.arange(0.0, 1.0, spacing)
    standing = np.linspace(0, pi / 2, 60)
    ahead = np.column_stack([way, 0 * way, 0 * way])
    turn = np.column_stack([0 * standing + 1, 0 * standing, standing])
    back = np.column_stack([0 * way + 1, -way, 0 * way + pi / 2])
    table = np.concatenate([ahead, turn, back])
    table += sigma * np.random.default_rng(0).standard_normal(table.shape) * [1, 1, 10]
    reference = waypoints(table[:, :2], yaw=table[:, 2])
    ((place, angle),) = turned(reference)
    np.testing.assert_allclose(place, [1, 0], atol=TOLERANCE)
    assert angle == pytest.approx(pi / 2, abs=0.2)
    exact = waypoints([*AHEAD, *TO_THE_RIGHT], yaw=[0, 0, 0] + 3 * [pi / 2])
    assert reference.duration == pytest.approx(exact.duration, rel=0.04)


def test_headings_of_a_grid_are_no_turns():
    """Steps of 5 cm, each with the heading of its step."""
    steps = np.arange(41)
    points = 0.05 * np.column_stack([(steps + 1) // 2, steps // 2])
    yaw = np.where(steps % 2, pi / 2, 0.0)
    yaw[-1] = yaw[-2]
    reference = waypoints(points, yaw=yaw)
    assert turns_of(reference) == []
    assert reference.duration < 50


def test_a_dense_corner_with_headings_turns_without_tolerance():
    leg = np.arange(0.0, 1.0, 0.02)
    east = np.column_stack([leg, 0 * leg])
    north = np.column_stack([0 * leg + 1, leg])
    points = np.concatenate([east, north])
    yaw = np.repeat([0.0, pi / 2], 50)
    assert turns_of(waypoints(points, yaw=yaw)) == []
    ((place, angle),) = turned(waypoints(points, yaw=yaw, tolerance=0.0))
    np.testing.assert_allclose(place, [1, 0], atol=1e-9)
    assert angle == pytest.approx(pi / 2, abs=2e-3)


@pytest.mark.parametrize(
    ("points", "yaw", "message"),
    [
        ([(1, 1)] * 3, [0.2, 0.2, 0.2], "points = 'all equal, with equal headings'"),
        ([(0, 0), (1, 0), (2, 0)], [pi / 2] * 3, "point 2, column yaw"),
        ([(0, 0), (1, 0), (2, 0)], [0, 1.6, 0], "point 2, column yaw = 1.6"),
        ([(0, 0), (1, 0), (1, -1), (2, -1)], [0] * 4, "point 3, column yaw"),
        ([(0, 0), (0.5, 0), (1, 0), (0.5, 0), (0, 0)], None, "turn on the spot where a column yaw"),
    ],
)
def test_what_no_turn_makes_drivable_is_refused(points, yaw, message):
    with pytest.raises(InvalidValueError, match=message):
        waypoints(points, yaw=yaw)
