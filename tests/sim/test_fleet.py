import itertools

import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.fleet import Fleet
from sim.ground.ground import Ground
from trackslip.errors import InvalidValueError
from trackslip.kinematics import sprocket_speeds, track_speeds
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import line_contact, steady_twist

FAST = Drive(top_speed=0.4)  # the tightest, fastest run of the grid asks 0.334 m/s of the outer track


def grid_commands(robot, radii=COMMANDED_RADII, speeds=SPEEDS):
    radius, speed = np.array(list(itertools.product(radii, speeds))).T
    return sprocket_speeds(np.column_stack([speed, speed / radius]), 0.0, robot.geometry)


def drive(robot, omega, seconds=4.0, **options):
    fleet = Fleet(robot, np.zeros((len(omega), 3)), drive=options.pop("drive", FAST), **options)
    fleet.command(omega)
    fleet.advance(seconds)
    return fleet


@pytest.mark.parametrize("ratio", [0.7, 1.0, 0.775 / 0.7, 1.4])
def test_turning_agrees_with_theory_over_the_grid(robot, ratio):
    omega = grid_commands(robot)
    fleet = drive(robot, omega, ground=Ground(0.7, 0.7 * ratio), radius_error=0.0067)
    surface = omega * robot.geometry.sprocket_radius * 1.0067
    geometry = robot.geometry
    theory = steady_twist(surface, line_contact(geometry.half_gauge, robot.contact_half_length, 0.7, 0.7 * ratio))
    twist = fleet.twist()
    spread = surface[:, 1] - surface[:, 0]
    np.testing.assert_allclose(spread / twist[:, 2], spread / theory[:, 2], rtol=0.01)  # 2 (b + D)
    np.testing.assert_allclose(twist[:, 0], theory[:, 0], rtol=0.01)
    slip, expected = (1 - track_speeds(t[:, [0, 2]], 0.168) / surface for t in (twist, theory))
    np.testing.assert_allclose(slip, expected, atol=0.004)
    slow = np.abs(theory[:, 2]) < 0.2
    np.testing.assert_allclose(slip[slow], expected[slow], atol=0.001)


def test_turning_in_place_and_turning_right_agree_with_theory(robot):
    omega = np.array([[-2.0, 2.0], [3.0, 2.0], [-3.0, -2.0], [2.0, 2.0]])
    fleet = drive(robot, omega, radius_error=0.0)
    ground = Ground()
    contact = line_contact(0.168, robot.contact_half_length, ground.along, ground.across)
    theory = steady_twist(omega * 0.06, contact)
    np.testing.assert_allclose(fleet.twist()[:, [0, 2]], theory[:, [0, 2]], rtol=0.01, atol=1e-4)


def test_sink_roll_and_pitch(robot):
    fleet = drive(robot, grid_commands(robot))
    sink, roll, pitch = fleet.attitude().T
    np.testing.assert_allclose(sink, 0.002, rtol=0.05)
    assert np.abs(roll).max() < 1e-3
    assert np.abs(pitch).max() < 1e-3
    np.testing.assert_allclose(fleet.load().sum(axis=1), robot.mass * 9.81, rtol=1e-3)


def test_left_and_right_turns_mirror(robot):
    omega = grid_commands(robot, radii=(0.5, 2.0), speeds=(0.1, 0.2))
    left, right = drive(robot, omega), drive(robot, omega[:, ::-1])
    mirror = np.array([1, -1, -1])
    np.testing.assert_allclose(right.pose(), left.pose() * mirror, atol=2e-6)
    np.testing.assert_allclose(right.twist(), left.twist() * mirror, atol=2e-6)
    np.testing.assert_allclose(right.traction(), left.traction()[:, ::-1], atol=0.05)


def test_each_robot_has_its_own_ground_and_radius(robot):
    omega = np.tile([2.0, 3.0], (3, 1))
    fleet = drive(robot, omega, ground=[Ground(), Ground(across=1.2), Ground()], radius_error=[0.0, 0.0, 0.02])
    yaw_rate = fleet.twist()[:, 2]
    assert yaw_rate[1] < 0.9 * yaw_rate[0]
    assert yaw_rate[2] == pytest.approx(1.02 * yaw_rate[0], rel=1e-3)


def test_traction_on_straight_ground_is_what_accelerates(robot):
    fleet = Fleet(robot, np.zeros((1, 3)), drive=Drive(lag=0.5, period=0.005))  # slow, so that force is sampled well
    fleet.command([3.0, 3.0])
    impulse = 0.0
    for _ in range(300):
        fleet.advance(fleet.period)
        impulse += fleet.traction().sum() * fleet.period
    assert impulse == pytest.approx(robot.mass * fleet.twist()[0, 0], rel=0.02)


def test_default_drives_do_not_saturate_in_the_grid(robot):
    fleet = Fleet(robot, np.zeros((25, 3)))
    fleet.command(grid_commands(robot))
    for _ in range(200):
        fleet.advance(fleet.period)
        assert np.abs(fleet.drive.torque).max() < 0.99 * Drive().torque_limit


def test_headings_are_unwrapped(robot):
    fleet = Fleet(robot, [[0.0, 0.0, 7.0], [0.0, 0.0, -4.0]])
    np.testing.assert_allclose(fleet.pose()[:, 2], [7.0, -4.0], atol=1e-9)
    fleet.command([[-4.0, 4.0], [4.0, -4.0]])
    before = fleet.pose()[:, 2]
    fleet.advance(10.0)
    turned = fleet.pose()[:, 2] - before
    assert turned[0] == pytest.approx(10 * fleet.twist()[0, 2], rel=0.02)
    assert turned[0] > 2 * np.pi
    assert turned[0] == pytest.approx(-turned[1], rel=1e-6)


def test_starts_where_asked_at_rest(robot):
    start = [[1.0, -2.0, 0.7], [0.0, 0.0, -3.0]]
    fleet = Fleet(robot, start)
    np.testing.assert_allclose(fleet.pose(), start, atol=1e-9)
    fleet.advance(5.0)
    np.testing.assert_allclose(fleet.pose(), start, atol=1e-5)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"start": [[0.0, np.nan, 0.0]]}, "start"),
        ({"start": [[0.0, 0.0]]}, "start"),
        ({"ground": [Ground()] * 3}, "ground"),
        ({"drive": Drive(period=0.007)}, "drive.period"),
        ({"threads": -1}, "threads"),
    ],
)
def test_impossible_fleets_are_refused(robot, options, field):
    with pytest.raises(InvalidValueError, match=field):
        Fleet(robot, **{"start": np.zeros((2, 3)), **options})
