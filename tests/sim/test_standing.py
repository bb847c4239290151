"""Robots of odd shapes in odd places: those that stand, stand still and turn as theory says; the others are refused."""

import numpy as np
import pytest

from sim import Description, Drive, Fleet, LaserScanner, ScannerFeed, load_robot, open_loop
from sim.drive.drive import Motor
from sim.ground.ground import Ground, Patch
from sim.robot.parameters import SINK, RobotParameters
from trackslip.errors import InvalidValueError, RunFailedError
from trackslip.localization.plate import PlateLocator
from trackslip.skid_theory import line_contact, steady_twist

STRONG = Drive(top_speed=1.0, torque_limit=1e5, motor=Motor(stall_torque=1e4, no_load_speed=1e5))
POINTS = 10  # of contact under a track


def weight_offset(parameters):
    """Where the weight presses (x, y) [m], for the ground gives way by SINK and the robot leans to its heavier side."""
    height = parameters.com_height
    x = parameters.com_x / (1 - height * SINK / (parameters.contact_length**2 / 12))
    return x, parameters.com_y / (1 - height * SINK / parameters.half_gauge**2)


@pytest.mark.filterwarnings("ignore::trackslip.errors.RobotWarning")
@pytest.mark.parametrize(
    "shape",
    [
        dict(half_gauge=5.0, contact_length=8.0, com_height=1.0, mass=900.0),
        dict(half_gauge=2.0),
        dict(contact_length=2.0),
        dict(half_gauge=0.1, contact_length=0.17, com_height=0.05, mass=0.01),
        dict(com_x=0.05, sprocket_radius=0.01),
        dict(com_x=-0.03, com_y=0.05, sprocket_radius=1.0),
    ],
)
def test_robots_of_any_shape_have_their_numbers_stand_and_turn_as_theory_says(shape):
    """Large ones would fly off and small ones topple if the recipe of the contacts didn't suit them."""
    parameters = RobotParameters(**shape)
    robot, gauge = load_robot(parameters=parameters), 2 * parameters.half_gauge
    assert robot.geometry.half_gauge == pytest.approx(parameters.half_gauge)
    assert robot.geometry.sprocket_radius == parameters.sprocket_radius
    assert robot.mass == pytest.approx(parameters.mass)
    surface = 0.1 + np.array([[-0.1, 0.1], [0.2, -0.2]]) * min(gauge, 0.4)
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(0.6, 0.7), 0.0, STRONG)
    np.testing.assert_allclose(fleet.attitude()[:, 0], SINK, rtol=0.01)
    left = (1 + weight_offset(parameters)[1] / parameters.half_gauge) / 2
    weight = parameters.mass * 9.81
    np.testing.assert_allclose(fleet.load(), [[left * weight, (1 - left) * weight]] * 2, rtol=5e-3)
    fleet.command(surface / parameters.sprocket_radius)
    fleet.advance(4.0)
    # the contact points as they are, and the weight where it leans to
    centre = (*weight_offset(parameters), parameters.com_height)
    contact = line_contact(parameters.half_gauge, parameters.contact_length / 2, 0.6, 0.7, centre, POINTS)
    expected = steady_twist(surface, contact, 9.81)
    twist = fleet.twist()
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], rtol=3e-3)
    np.testing.assert_allclose(twist[:, 2], expected[:, 2], rtol=3e-3, atol=1e-5)


@pytest.mark.parametrize("heading", [0.0, np.pi, 0.1])
def test_robots_do_not_park_where_they_would_tip_over(robot, heading):
    """Rough ground would hold it, but its weight, 12 cm high, is beyond its rear contact points, 15.3 cm back."""
    tips = float(np.arctan(np.abs(robot.contact_points[:, 0]).max() / 0.12))
    with pytest.raises(InvalidValueError, match=r"slope = 1\.\d+: must be less, to park .* the robot tips over"):
        Fleet(robot, [(0.0, 0.0, heading)], Ground(8.0, 8.0, slope=1.15 * tips))
    Fleet(robot, [(0.0, 0.0, heading)], Ground(8.0, 8.0, slope=0.7 * tips))


def test_robots_do_not_park_where_one_track_slides(robot):
    """The mean of both sides' friction would hold it, but the pull of the good track turns it round the other."""
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.1, 0.1)
    ground = Ground(0.7, 0.7, slope=0.3, patches=(patch,))
    with pytest.raises(InvalidValueError, match=r"slope = 0\.3: must be less, to park .* the robot slides"):
        Fleet(robot, np.zeros((1, 3)), ground)
    Fleet(robot, np.zeros((1, 3)), Ground(0.7, 0.7, slope=0.15, patches=(patch,)))


def test_a_run_in_which_a_robot_tips_over_ends_with_its_name_and_keeps_its_rows(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    feed = ScannerFeed(LaserScanner(), fleet)
    fleet.set_ground([Ground(), Ground(8.0, 8.0, slope=1.4)])
    names = [Description("level"), Description("steep")]
    with pytest.raises(RunFailedError, match=r"^run 'steep': the robot tips over after \d\.\d+ s$") as failure:
        open_loop(fleet, [1.0, 1.0], 4.0, feed, PlateLocator(robot.plate), names)
    fallen = float(str(failure.value).split()[-2])
    level, steep = failure.value.logs
    for log in (level, steep):
        assert log.time[-1] == pytest.approx(fallen - feed.period)
        assert log.scans is not None
        assert len(log.scans.cluster.count) == len(log.time)
    assert level.is_valid.all()
    np.testing.assert_allclose(level.pose[:, :2], level.truth.pose[:, :2], atol=0.02)
