"""Wide, short robots turn as theory says, since their tracks have as many points as that takes."""

import numpy as np
import pytest

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.errors import RobotWarning
from trackslip.skid_theory import line_contact, steady_twist


@pytest.mark.parametrize(("width", "shear", "within"), [(1.25, 0.0, 0.01), (3.0, 0.0, 0.01), (2.0, 0.01, 0.02)])
def test_the_icrs_of_a_wide_robot_are_where_theory_has_them(width, shear, within):
    half_length, half_gauge = 0.17, 0.17 * width
    yaw_rate = 0.1 / (np.array([2.4, 8.0]) * half_gauge)  # at 0.1 m/s
    spread = 2 * (half_gauge + 0.05 * half_length) * yaw_rate
    belts = 0.1 + np.stack([-spread, spread], axis=1) / 2
    robot = load_robot(parameters=RobotParameters(half_gauge=half_gauge))
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(shear=shear), 0.0, tireless())
    fleet.command(belts / robot.geometry.sprocket_radius)
    fleet.advance(20.0 if shear else 3.0)
    contact = line_contact(half_gauge, half_length, 0.7, 0.778, (0.0, 0.0, 0.12), points=800)
    expected = steady_twist(belts, contact, 9.81, shear)[:, 2]
    offset, by_theory = (spread / (2 * w) - half_gauge for w in (fleet.twist()[:, 2], expected))
    np.testing.assert_allclose(offset, by_theory, rtol=within)


def test_wide_robots_stand_and_creep_as_others_do(robot):
    wide = load_robot(RobotParameters(half_gauge=0.34))
    assert (len(robot.contact_points), len(wide.contact_points)) == (20, 64)
    assert len(wide.with_single_contacts().pad_side) == 64
    slope = Ground(slope=0.17)
    for name in ("attitude", "pose"):
        level, wider = (getattr(Fleet(each, np.zeros((1, 3)), slope), name)() for each in (robot, wide))
        np.testing.assert_allclose(level[0, 0], wider[0, 0], rtol=1e-3, atol=1e-5)


def test_a_robot_wider_than_verified_is_told_of():
    with pytest.warns(RobotWarning, match=r"half_gauge = 0\.6: turns are verified up to 0\.51 m, 1\.5 contact lengths"):
        wide = load_robot(RobotParameters(half_gauge=0.6))
    assert len(wide.contact_points) == len(load_robot(RobotParameters(half_gauge=0.51)).contact_points)
