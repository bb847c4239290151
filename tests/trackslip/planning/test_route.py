"""Routes within limits."""

from dataclasses import replace

import numpy as np

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


def test_legs_shrink_and_a_route_to_where_it_began_is_none():
    _, legs = split(replace(BACK_AND_FORTH, shrink=0.03))
    np.testing.assert_allclose(legs[1:] / legs[:-1], 0.97)
    _, legs = split(BACK_AND_FORTH)
    np.testing.assert_allclose(legs, legs[0])
    assert placed(replace(BACK_AND_FORTH, end=0), LIMITS, KNOWLEDGE) is None
