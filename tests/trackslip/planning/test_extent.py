from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_motion import LawMotion, SlipVariation

from trackslip.kinematics import RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr
from trackslip.planning.limits import DriveLimits, first_knowledge
from trackslip.planning.route import (
    GENES,
    RATE,
    YAW_RATE_SHARE,
    Maneuvers,
    Route,
    extent,
    longest_spin,
    path,
)

GEOMETRY = RobotGeometry(0.168, 0.06)
LIMITS = DriveLimits(0.3, 0.5, (3.0, 3.0), 60.0)
MANEUVERS = Maneuvers.of(
    np.array([[2.0, 2.0], [-0.5, 0.5], [1.0, 1.5], [-1.5, -1.5], [0.4, -0.4], [2.0, 2.0]]), LIMITS
)
EXACT = replace(first_knowledge(GEOMETRY), reach_doubt=0.0, radius_doubt=0.0, pull=0.0)


def test_a_path_is_that_of_the_law():
    law = ConstantIcr(0.05, 0.168, 0.01)
    pose = np.array([0.0, 0.0, 0.3])
    ends = [pose]
    for way in MANEUVERS.distance:
        pose = advance(pose, law.twist(way / 0.06, GEOMETRY), 1.0)
        ends.append(pose)
    x, y = path(MANEUVERS, 0.3, np.array([[0.218, 1.01, 1.01]]))
    np.testing.assert_allclose(
        np.column_stack([x[0, ::8], y[0, ::8]]), np.array(ends)[:, :2], atol=1e-12
    )


def test_the_margin_is_three_and_a_half_deviations_of_slip():
    omega = np.concatenate([np.zeros((1, 2)), MANEUVERS.speeds(MANEUVERS.duration.sum())]) / 0.06
    law = ConstantIcr(EXACT.offset, 0.168)
    rng = np.random.default_rng(0)
    slip = (0.004, 0.004, 0.01)
    known = replace(EXACT, slip=slip)
    ends = []
    for _ in range(150):
        moves = LawMotion(law, GEOMETRY, SlipVariation(*slip))
        motion, _ = moves.drive(omega, RATE, rng)
        ends.append(motion.pose[:, :2])
    real = np.array(ends)
    spread, mean = real.std(axis=0), real.mean(axis=0)
    exactly = extent(MANEUVERS, 0.0, replace(EXACT, slip=(1e-9, 1e-9, 1e-9)))
    found = extent(MANEUVERS, 0.0, known)
    for side, sign in ((1, 1), (0, -1)):
        margin = sign * (found[side] - exactly[side])
        real = (sign * mean + 3.5 * spread).max(axis=0) - (sign * mean).max(axis=0)
        np.testing.assert_allclose(margin, real, rtol=0.2, atol=0.005)


@pytest.mark.parametrize("index", [0, 1, 4, 6, 8])
def test_every_law_that_the_robot_may_have_stays_inside(index):
    """By arcs driven bit by bit, and it would not if the area were the expected law's."""
    known = replace(first_knowledge(GEOMETRY), pull=0.01, slip=(1e-9, 1e-9, 1e-9))
    reach, *scale = known.extremes[index]
    pose, reached = np.zeros(3), []
    for way in MANEUVERS.distance:
        left, right = way * scale / 20
        for _ in range(20):
            pose = advance(pose, np.array([(left + right) / 2, (right - left) / (2 * reach)]), 1.0)
            reached.append(pose[:2])
    at = np.array(reached)
    found = extent(MANEUVERS, 0.0, known)
    assert (found[0] <= at.min(axis=0) + 1e-3).all()
    assert (at.max(axis=0) <= found[1] + 1e-3).all()
    if index:
        expected = extent(
            MANEUVERS, 0.0, replace(known, reach_doubt=0.0, radius_doubt=0.0, pull=0.0)
        )
        assert (at.min(axis=0) < expected[0]).any() or (at.max(axis=0) > expected[1]).any()


WAYS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=8)


@given(WAYS, st.floats(0.05, 3.0), st.floats(0.1, 5.0))
def test_speeds_and_accelerations_stay_within_the_limits(ways, speed, acceleration):
    limits = DriveLimits(speed, acceleration, (3.0, 3.0), 60.0)
    maneuvers = Maneuvers.of(np.array(ways), limits)
    if not len(maneuvers.distance):
        return
    speeds = maneuvers.speeds(maneuvers.duration.sum() + 1.0)
    assert np.abs(speeds).max() <= speed * (1 + 1e-9)
    change = np.diff(speeds, axis=0, prepend=np.zeros((1, 2)), append=np.zeros((1, 2)))
    assert np.abs(change).max() * RATE <= acceleration * (1 + 1e-6)
    np.testing.assert_allclose(speeds.sum(axis=0) / RATE, maneuvers.distance.sum(axis=0), atol=1e-9)
    np.testing.assert_array_equal(speeds[-1], 0.0)


def test_times_are_those_of_trapezoids_and_triangles():
    straight = Maneuvers.of(np.array([[3.0, 3.0], [0.1, 0.1]]), LIMITS)
    np.testing.assert_allclose(
        straight.duration, [3.0 / 0.3 + 0.3 / 0.5, 2 * np.sqrt(0.1 / 0.5)], atol=1 / RATE
    )
    assert (straight.duration >= [10.6, 2 * np.sqrt(0.2)]).all()


def test_yaw_rates_are_limited():
    spin = Maneuvers.of(np.array([[-3.0, 3.0]]), LIMITS).speeds(60.0)
    assert np.abs(spin).max() == pytest.approx(YAW_RATE_SHARE * 0.3, rel=1e-3)
    bend = Maneuvers.of(np.array([[2.0, 3.0]]), LIMITS).speeds(60.0)
    assert bend.max() == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize("duration", [0.1, 0.5, 1.0, 7.31])
def test_the_longest_spin_fits_and_none_longer_does(duration):
    way = longest_spin(duration, LIMITS)
    assert Maneuvers.of(np.array([[-way, way]]), LIMITS).duration.sum() <= duration + 1e-9
    longer = way + 0.3 / RATE
    assert Maneuvers.of(np.array([[-longer, longer]]), LIMITS).duration.sum() > duration


@pytest.mark.parametrize("seed", range(5))
def test_a_route_and_its_genes_are_the_same(seed):
    rng = np.random.default_rng(seed)
    genes = np.array([rng.uniform(gene.low, gene.high) for gene in GENES])
    whole = np.array([gene.whole for gene in GENES])
    genes = np.where(whole, np.round(genes), genes)
    route = Route.of(genes)
    np.testing.assert_array_equal(route.genes, genes)
    assert Route.of(route.genes) == route
