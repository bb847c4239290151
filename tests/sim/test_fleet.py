import itertools

import mujoco
import numpy as np
import pytest

from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet, Setting
from sim.ground.ground import Change, Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import compiled, load_robot
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
    theory = steady_twist(
        surface, line_contact(geometry.half_gauge, robot.parameters.contact_length / 2, 0.7, 0.7 * ratio)
    )
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
    contact = line_contact(0.168, robot.parameters.contact_length / 2, ground.along, ground.across)
    theory = steady_twist(omega * 0.06, contact)
    np.testing.assert_allclose(fleet.twist()[:, [0, 2]], theory[:, [0, 2]], rtol=0.01, atol=1e-4)


def test_the_grid_is_driven_upright_with_drives_that_do_not_saturate(robot):
    fleet = Fleet(robot, np.zeros((25, 3)))
    fleet.command(grid_commands(robot))
    for _ in range(200):
        fleet.advance(fleet.period)
        assert np.abs(fleet.drive.torque).max() < 0.99 * Drive().torque_limit
    sink, roll, pitch = fleet.attitude().T
    np.testing.assert_allclose(sink, 0.002, rtol=0.05)
    assert np.abs([roll, pitch]).max() < 1e-3
    np.testing.assert_allclose(fleet.load().sum(axis=1), robot.mass * 9.81, rtol=1e-3)


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


def test_a_robot_begun_anew_drives_as_a_new_fleet_does(robot):
    """Set down in another way, it stands a little differently; after a while little of that is left."""
    start = (0.5, 0.2, 0.3)
    ground = Ground(0.6, 0.8, slope=0.1, uphill=1.0)
    leaning = load_robot(parameters=RobotParameters(com_x=0.03, com_y=-0.02))
    new = Fleet(leaning, [start], ground, 0.02, Drive(lag=0.1))
    old = Fleet(robot, np.zeros((1, 3)))
    old.command([2.0, 3.0])
    old.advance(1.0)
    old.restart([0], [Setting(start, ground, 0.02, 0.1, (0.03, -0.02))])
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-12)
    np.testing.assert_allclose(old.attitude(), new.attitude(), atol=5e-5)
    assert np.all(old.drive.encoder_angle() == 0)
    for fleet in (new, old):
        fleet.command([2.0, 3.0])
        fleet.advance(3.0)
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-4)


def test_a_ground_changes_in_the_time_of_the_run(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    fleet.advance(2.0)
    fleet.restart([1], [Setting((0.0, 0.0, 0.0), Ground(changes=(Change(0.5, 0.3, 0.4),)))])
    fleet.advance(0.5)
    assert fleet.friction()[1] == pytest.approx([0.7, 0.778])
    fleet.advance(0.05)
    assert fleet.friction() == pytest.approx(np.array([[0.7, 0.778], [0.3, 0.4]]))
    fleet.restart([1], [Setting((0.0, 0.0, 0.0))])
    fleet.advance(1.0)
    assert fleet.friction()[1] == pytest.approx([0.7, 0.778])


def test_a_robot_is_not_begun_anew_where_it_cannot_park(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    with pytest.raises(InvalidValueError, match="slope"):
        fleet.restart([0], [Setting((0.0, 0.0, 0.0), Ground(0.2, 0.2, slope=0.3))])
    with pytest.raises(InvalidValueError, match="start"):
        fleet.restart([0], [Setting((np.nan, 0.0, 0.0))])


def slid(parameters, friction, twist):
    """Final pose (3,) and model of a robot that is launched at a twist (3,) on locked tracks or wheels."""
    fleet = Fleet(compiled(parameters), np.zeros((1, 3)), Ground(friction, friction), 0.0, tireless(2.0), 1)
    fleet.launch(twist)
    for _ in range(300):
        fleet.follow(np.zeros((1, 1, 2)))
    return fleet.pose()[0], fleet.robot


def sliding_distance(speed, deceleration, step=0.005, rate=100.0):
    """Way (or angle) of a slide to rest at a constant deceleration.

    The engine integrates with the speed at the end of a step; grip decays at a finite rate.
    """
    return speed**2 / 2 / deceleration - speed * step / 2 + deceleration / rate * (1 / rate - step) / 2


@pytest.mark.parametrize("name", ["shipped", "husky", "warthog"])
@pytest.mark.parametrize("friction", [0.1, 0.6, 0.7])
@pytest.mark.parametrize("speed", [0.3, 1.5])
def test_a_robot_on_locked_tracks_slides_as_far_as_coulomb_friction_lets_it(name, friction, speed):
    """It also pitches on the springs under it, which sets back its pose on the ground."""
    parameters = load_parameters(name)[0]
    pose, robot = slid(parameters, friction, [speed, 0.0, 0.0])
    spread = np.mean(robot.contact_points[:, 0] ** 2)
    pitch = friction * parameters.com_height * SINK / spread
    expected = sliding_distance(speed, 9.81 * friction) - parameters.com_height * pitch
    harder = 5e-4 if name == "shipped" else 1e-4  # tracks that slide fast press harder at first
    assert pose[0] == pytest.approx(expected, abs=harder, rel=4e-3)
    np.testing.assert_allclose(pose[1:], 0.0, atol=1e-5)


@pytest.mark.parametrize("name", ["shipped", "husky", "warthog"])
@pytest.mark.parametrize("friction", [0.1, 0.6, 0.7])
@pytest.mark.parametrize("rate", [0.3, 1.5])
def test_a_turning_robot_on_locked_tracks_spins_down_by_coulomb_friction(name, friction, rate):
    pose, robot = slid(load_parameters(name)[0], friction, [0.0, 0.0, rate])
    chassis = robot.model.body("chassis")
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, chassis.iquat)
    inertia = axes[6:] ** 2 @ chassis.inertia
    moment = friction * robot.mass * 9.81 * np.hypot(*robot.contact_points.T).mean()
    harder = 4e-4 if name == "shipped" else 1e-4
    assert pose[2] == pytest.approx(sliding_distance(rate, moment / inertia), abs=harder, rel=1e-3)
    np.testing.assert_allclose(pose[:2], 0.0, atol=1e-5)
