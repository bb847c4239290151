from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_motion import LawMotion, SlipVariation

from trackslip.kinematics import RobotGeometry, advance, wrap_angle
from trackslip.laws.icr import ConstantIcr
from trackslip.planning.limits import DriveLimits, first_knowledge
from trackslip.planning.route import (
    BOW,
    GENES,
    RATE,
    WAYPOINTS,
    YAW_RATE_SHARE,
    Maneuvers,
    Route,
    extent,
    longest_spin,
    path,
    placed,
)

GEOMETRY = RobotGeometry(0.168, 0.06)
LIMITS = DriveLimits(0.3, 0.5, (3.0, 3.0), 60.0)
WAYS = np.array([[2.0, 2.0], [-0.5, 0.5], [1.0, 1.5], [-1.5, -1.5], [0.4, -0.4], [2.0, 2.0]])
MANEUVERS = Maneuvers.of(WAYS, LIMITS)
EXACT = replace(first_knowledge(GEOMETRY), reach_doubt=0.0, radius_doubt=0.0, pull=0.0)


def test_a_path_is_that_of_the_law():
    law = ConstantIcr(0.05, 0.168, 0.01)
    pose = np.array([0.0, 0.0, 0.3])
    ends = [pose]
    for way in MANEUVERS.distance:
        pose = advance(pose, law.twist(way / 0.06, GEOMETRY), 1.0)
        ends.append(pose)
    reach = 0.168 + 0.05
    x, y = path(MANEUVERS, 0.3, np.array([[reach, 1.01, 1.01]]))
    found = np.column_stack([x[0, ::8], y[0, ::8]])
    np.testing.assert_allclose(found, np.array(ends)[:, :2], atol=1e-12)


def test_the_margin_is_three_and_a_half_deviations_of_slip():
    """Of 150 robots that slip, against one that doesn't."""
    speeds = MANEUVERS.speeds(MANEUVERS.duration.sum())
    omega = np.concatenate([np.zeros((1, 2)), speeds]) / 0.06
    slip = (0.004, 0.004, 0.01)
    robot = LawMotion(ConstantIcr(EXACT.offset, 0.168), GEOMETRY, SlipVariation(*slip))
    rng = np.random.default_rng(0)
    places = []
    for _ in range(150):
        motion, _ = robot.drive(omega, RATE, rng)
        places.append(motion.pose[:, :2])
    spread = np.std(places, axis=0)
    mean = np.mean(places, axis=0)
    least = (1e-9, 1e-9, 1e-9)
    low, high = extent(MANEUVERS, 0.0, replace(EXACT, slip=slip))
    exact_low, exact_high = extent(MANEUVERS, 0.0, replace(EXACT, slip=least))
    margin_above = (mean + 3.5 * spread).max(axis=0) - mean.max(axis=0)
    margin_below = mean.min(axis=0) - (mean - 3.5 * spread).min(axis=0)
    np.testing.assert_allclose(high - exact_high, margin_above, rtol=0.2, atol=0.005)
    np.testing.assert_allclose(exact_low - low, margin_below, rtol=0.2, atol=0.005)


@pytest.mark.parametrize("index", [0, 1, 4, 6, 8])
def test_every_law_that_the_robot_may_have_stays_inside(index):
    """By arcs driven bit by bit, and it would not if the area were the expected law's."""
    known = replace(first_knowledge(GEOMETRY), pull=0.01, slip=(1e-9, 1e-9, 1e-9))
    reach, *scale = known.extremes[index]
    pose = np.zeros(3)
    reached = []
    for way in MANEUVERS.distance:
        left, right = way * scale / 20
        bit = np.array([(left + right) / 2, (right - left) / (2 * reach)])
        for _ in range(20):
            pose = advance(pose, bit, 1.0)
            reached.append(pose[:2])
    lowest = np.min(reached, axis=0)
    highest = np.max(reached, axis=0)
    low, high = extent(MANEUVERS, 0.0, known)
    assert (low <= lowest + 1e-3).all()
    assert (highest <= high + 1e-3).all()
    if index:
        certain = replace(known, reach_doubt=0.0, radius_doubt=0.0, pull=0.0)
        expected_low, expected_high = extent(MANEUVERS, 0.0, certain)
        assert (lowest < expected_low).any() or (highest > expected_high).any()


LISTS_OF_WAYS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=8)


@given(LISTS_OF_WAYS, st.floats(0.05, 3.0), st.floats(0.1, 5.0))
def test_speeds_and_accelerations_stay_within_the_limits(ways, speed, acceleration):
    limits = DriveLimits(speed, acceleration, (3.0, 3.0), 60.0)
    maneuvers = Maneuvers.of(np.array(ways), limits)
    if not len(maneuvers.distance):
        return
    speeds = maneuvers.speeds(maneuvers.duration.sum() + 1.0)
    assert np.abs(speeds).max() <= speed * (1 + 1e-9)
    rest = np.zeros((1, 2))
    change = np.diff(speeds, axis=0, prepend=rest, append=rest)
    assert np.abs(change).max() * RATE <= acceleration * (1 + 1e-6)
    distance = speeds.sum(axis=0) / RATE
    np.testing.assert_allclose(distance, maneuvers.distance.sum(axis=0), atol=1e-9)
    np.testing.assert_array_equal(speeds[-1], 0.0)


def test_times_are_those_of_trapezoids_and_triangles():
    straight = Maneuvers.of(np.array([[3.0, 3.0], [0.1, 0.1]]), LIMITS)
    trapezoid = 3.0 / 0.3 + 0.3 / 0.5
    triangle = 2 * np.sqrt(0.1 / 0.5)
    np.testing.assert_allclose(straight.duration, [trapezoid, triangle], atol=1 / RATE)
    assert (straight.duration >= [10.6, 2 * np.sqrt(0.2)]).all()


def test_in_an_open_field_two_legs_take_all_the_way():
    """Out to the opposite side and back, at top speed all the time: 2 x 9 m of 18 m."""
    field = replace(LIMITS, area=(1000.0, 1000.0))
    to_the_opposite_side = Route(1, 7, (False, False), (0, 0), spinning=0.02, stretches=1)
    ways = placed(to_the_opposite_side, field, EXACT).maneuvers.distance.mean(axis=1)
    assert ways.max() == pytest.approx(LIMITS.max_speed * LIMITS.duration / 2)


def test_yaw_rates_are_limited():
    spin = Maneuvers.of(np.array([[-3.0, 3.0]]), LIMITS).speeds(60.0)
    assert np.abs(spin).max() == pytest.approx(YAW_RATE_SHARE * 0.3, rel=1e-3)
    bend = Maneuvers.of(np.array([[2.0, 3.0]]), LIMITS).speeds(60.0)
    assert bend.max() == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize("duration", [0.1, 0.5, 1.0, 7.31])
def test_the_longest_spin_fits_and_none_longer_does(duration):
    def spin(way):
        return Maneuvers.of(np.array([[-way, way]]), LIMITS).duration.sum()

    way = longest_spin(duration, LIMITS)
    assert spin(way) <= duration + 1e-9
    assert spin(way + 0.3 / RATE) > duration


@pytest.mark.parametrize("seed", range(5))
def test_a_route_and_its_genes_are_the_same(seed):
    rng = np.random.default_rng(seed)
    genes = np.array([rng.uniform(gene.low, gene.high) for gene in GENES])
    whole = np.array([gene.whole for gene in GENES])
    genes = np.where(whole, np.round(genes), genes)
    route = Route.of(genes)
    np.testing.assert_array_equal(route.genes, genes)
    assert Route.of(route.genes) == route


# of a quarter of the room, 0.375 m, forwards to the one place and in reverse back
ROUTE = Route(
    start=0,
    end=5,
    backwards=(False, True),
    bow=(1, -2),
    spinning=0.3,
    stretches=2,
    size=0.25,
    shrink=0.05,
)


@pytest.fixture(scope="module")
def poses_of_route():
    """The placed route, and the poses (n + 1, 3) at the ends of its maneuvers by the law."""
    found = placed(ROUTE, LIMITS, replace(EXACT, slip=(1e-9, 1e-9, 1e-9)))
    law = ConstantIcr(EXACT.offset, 0.168)
    poses = [found.start]
    for way in found.maneuvers.distance:
        poses.append(advance(poses[-1], law.twist(way / 0.06, GEOMETRY), 1.0))
    return found, np.array(poses)


def test_the_legs_of_a_route_are_arcs_between_its_places(poses_of_route):
    found, poses = poses_of_route
    is_leg = np.abs(found.maneuvers.distance.sum(axis=1)) > 1e-9
    begins = poses[:-1][is_leg]
    ends = poses[1:][is_leg]
    count = len(ends)
    assert count > 4

    # each place is nearer to the centre by 5 % than the one before
    shrinkage = 0.95 ** np.arange(count + 1)
    indices = np.resize([ROUTE.start, ROUTE.end], count + 1)
    places = 0.375 * shrinkage[:, None] * WAYPOINTS[indices]
    np.testing.assert_allclose(begins[1:, :2], ends[:-1, :2], atol=1e-12)
    np.testing.assert_allclose((ends - begins)[:, :2], np.diff(places, axis=0), atol=1e-12)

    # out and back have a bow of 30 and -60 deg; in reverse, the robot points against the chord
    chord = np.diff(places, axis=0)
    is_back = np.arange(count) % 2 == 1
    along = np.arctan2(chord[:, 1], chord[:, 0]) + np.where(is_back, np.pi, 0.0)
    bow = np.where(is_back, -2 * BOW, BOW)
    np.testing.assert_allclose(wrap_angle(begins[:, 2] - along + bow), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrap_angle(ends[:, 2] - along - bow), 0.0, atol=1e-9)
    driven = found.maneuvers.distance[is_leg].sum(axis=1)
    np.testing.assert_array_equal(driven < 0, is_back)


def test_the_middle_of_a_route_is_that_of_the_area(poses_of_route):
    found, _ = poses_of_route
    x, y = path(found.maneuvers, found.start[2], EXACT.extremes[:1])
    points = np.stack([x[0], y[0]]) + found.start[:2, None]
    np.testing.assert_allclose(points.min(axis=1), -points.max(axis=1), atol=1e-6)
    np.testing.assert_allclose(found.places, [points.min(axis=1), points.max(axis=1)], atol=1e-6)


def test_pairs_of_spins_to_both_sides_share_the_time(poses_of_route):
    """Of two stretches: one pair before, one between that is twice as long, one after."""
    found, _ = poses_of_route
    distance = found.maneuvers.distance
    time = found.maneuvers.duration
    legs = np.flatnonzero(np.abs(distance.sum(axis=1)) > 1e-9)
    before = slice(0, 2)
    after = slice(len(distance) - 2, len(distance))
    middle = legs[len(legs) // 2 - 1] + 1
    between = slice(middle, middle + 2)
    for pair, side in ((before, 1), (between, -1), (after, 1)):
        right = distance[pair, 1]
        np.testing.assert_allclose(distance[pair, 0], -right)
        assert right[0] == -right[1]
        assert np.sign(right[0]) == side
    first = time[before].sum()
    second = time[between].sum()
    third = time[after].sum()
    assert first == third
    # speeds that are reached and lost again take time in which whole periods count
    assert second == pytest.approx(2 * first, abs=4 / RATE)
    assert time.sum() == pytest.approx(60.0, abs=6 / RATE)

    # no leg more would fit into the rest
    of_spins = first + second + third
    longest_leg = np.diff(np.cumsum(time)[legs]).max()
    assert 0.3 * 60 - 1e-9 <= of_spins < 0.3 * 60 + longest_leg


def test_with_one_stretch_both_pairs_of_spins_are_alike():
    """Whatever `ends`: there is none between them. Each lasts a quarter of the time, and half of
    what is too short for a leg more, here of less than 15 s.
    """
    route = replace(ROUTE, stretches=1, ends=0.1, spinning=0.5)
    maneuvers = placed(route, LIMITS, replace(EXACT, slip=(1e-9, 1e-9, 1e-9))).maneuvers
    first = maneuvers.duration[:2].sum()
    last = maneuvers.duration[-2:].sum()
    assert first == last
    assert 15.0 - 2 / RATE <= first < 15.0 + 15.0 / 2
    np.testing.assert_allclose(maneuvers.distance[:2], -maneuvers.distance[-2:])


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_a_route_too_large_for_the_area_is_made_to_fill_it(size):
    found = placed(replace(ROUTE, size=size), LIMITS, EXACT)
    filled = (np.ptp(found.places, axis=0) / LIMITS.room).max()
    assert filled <= 1
    assert (filled > 0.9) == (size == 1.0)


def test_a_route_without_length_has_no_place():
    assert placed(replace(ROUTE, end=ROUTE.start), LIMITS, EXACT) is None
    assert placed(replace(ROUTE, size=0.019), LIMITS, EXACT) is None
