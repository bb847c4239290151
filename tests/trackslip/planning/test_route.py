"""Routes within limits: spins of the lengths asked for, and legs that shrink."""

from dataclasses import replace

import numpy as np
import pytest

from trackslip.kinematics import RobotGeometry
from trackslip.planning.limits import DriveLimits, first_knowledge
from trackslip.planning.route import Route, placed

LIMITS = DriveLimits(max_speed=0.3, acceleration=0.5, area=(3.0, 3.0), duration=90.0)
KNOWLEDGE = first_knowledge(RobotGeometry(0.168, 0.06))
BACK_AND_FORTH = Route(0, 8, (False, True), (0, 0), 0.4, 3)


def split(route):
    """Ways of the spins and of the legs, in order [m]."""
    way = placed(route, LIMITS, KNOWLEDGE).maneuvers.way
    straight = way[:, 0] == way[:, 1]
    return np.abs(way[~straight, 0]), np.abs(way[straight, 0])


@pytest.mark.parametrize("ends", [0.0, 0.3, 1.0])
def test_pairs_at_the_ends_are_shorter_as_asked_for(ends):
    spins, _ = split(replace(BACK_AND_FORTH, ends=ends))
    if not ends:
        assert len(spins) == 4
        return
    assert len(spins) == 8
    first, second = spins[0], spins[2]
    assert first < second or ends == 1.0
    assert first == pytest.approx(spins[-1], rel=0.05)
    ramp = 0.65 * 0.3 / 0.5  # time that speeding up and slowing down costs a spin [s]
    assert (first / 0.195 + ramp) / (second / 0.195 + ramp) == pytest.approx(ends, abs=0.02)


def test_a_single_pair_at_each_end_takes_all_the_time_for_spins():
    spins, _ = split(replace(BACK_AND_FORTH, pairs=1, ends=0.4))
    assert len(spins) == 4
    np.testing.assert_allclose(spins, spins[0])


def test_legs_shrink_and_a_route_to_where_it_began_is_none():
    _, legs = split(replace(BACK_AND_FORTH, shrink=0.03))
    np.testing.assert_allclose(legs[1:] / legs[:-1], 0.97)
    _, legs = split(BACK_AND_FORTH)
    np.testing.assert_allclose(legs, legs[0])
    assert placed(replace(BACK_AND_FORTH, end=0), LIMITS, KNOWLEDGE) is None
