"""Every robot in every entry point: the numbers of its file, and no other robot's."""

import re

import numpy as np
import pytest

from experiments.drive.config import Config as DriveConfig
from experiments.drive.world import make_world
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_summary import saturation_warnings
from experiments.simulate.world import World
from sim import Drive, Fleet, Ground, RobotParameters, Traverse, load_robot, load_tracked, open_loop
from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.motors.motor import TOP_SPEED, UNLIMITED, Motor
from sim.robot.named import load_parameters
from sim.robot.parameters import RADIUS_ERROR, robot_file_text
from sim.terrain import Course, Flat
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import line_contact, steady_twist

LEVEL = Course((Flat(3.0),))
HEAVY = """<robot name="heavy"><link name="base">
<inertial><origin xyz="0 0 0.35"/><mass value="100"/>
<inertia ixx="2.0833" iyy="9.0833" izz="9.6667" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.35"/><geometry><box size="1.0 0.4 0.3"/></geometry></collision>
</link></robot>"""
TRACKS = 'model = "heavy.urdf"\nhalf_gauge = 0.27\nhull = [[-0.5, 0.14, 0.14], [0.5, 0.14, 0.14]]\n'
EIGHT = "[drive]\ntorque_limit = 8.0\n"
LINE = "gear = 30.0\nno_load_speed = 300.0\nstall_torque = 0.7\n"
OWN = f"[drive]\nlag = 0.2\ntop_speed = 0.45\ntorque_limit = 12.0\n[drive.motor]\n{LINE}"
FILES = {
    "heavy": TRACKS,
    "heavy_eight": TRACKS + EIGHT,
    "heavy_own": TRACKS + OWN,
    "plain": "half_gauge = 0.2\nradius_error = 0.02\n",
    "plain_eight": "half_gauge = 0.2\n" + EIGHT,
    "plain_own": "half_gauge = 0.2\nradius_error = -0.03\nradius_split = 0.01\n" + OWN,
}
"""Robot files by name."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robots")
    (folder / "heavy.urdf").write_text(HEAVY)
    for name, text in FILES.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


OF_FILE = Drive(0.2, 0.45, 12.0, motor=Motor(gear=30.0))
NUMBERS = {
    "shipped": (Drive(), RADIUS_ERROR, 0.0),
    "box": (None, 0.0, 0.0),
    "heavy": (None, 0.0, 0.0),
    "heavy_eight": (Drive(torque_limit=8.0), 0.0, 0.0),
    "heavy_own": (OF_FILE, 0.0, 0.0),
    "plain": (None, 0.02, 0.0),
    "plain_eight": (Drive(torque_limit=8.0), RADIUS_ERROR, 0.0),
    "plain_own": (OF_FILE, -0.03, 0.01),
}
"""Drive, radius error and radius split of each robot."""
TOP_SPEEDS = {"rescue": 0.6, "husky": 1.1, "warthog": 4.1, "maxxii": 0.4}
"""Top speeds of the other shipped robots [m/s]."""


def source(name, files):
    return str(files / f"{name}.toml") if name in FILES else name


def fleet_of_api(robot):
    return Fleet(load_robot(load_parameters(robot)[0]), np.zeros((1, 3)))


def fleet_of_command(robot):
    return World.of(GridConfig(robot=robot)).fleet(np.zeros((1, 3)))


def fleet_of_environment(robot):
    env = PathTrackingVectorEnv(1, robot=robot)
    env.reset(seed=0)
    return env.task.fleet


def traverse_of_api(robot):
    return Traverse(load_tracked(robot), [LEVEL], threads=1)


def traverse_of_command(robot):
    return make_world(DriveConfig(robot=robot, course="flat"))


def traverse_of_environment(robot):
    return TraverseVectorEnv(1, robot=robot).task.world


FLEETS = pytest.mark.parametrize(
    "enter", [fleet_of_api, fleet_of_command, fleet_of_environment], ids=["API", "grid", "env"]
)
TRAVERSES = pytest.mark.parametrize(
    "enter",
    [traverse_of_api, traverse_of_command, traverse_of_environment],
    ids=["API", "drive", "env"],
)


@FLEETS
@pytest.mark.parametrize("name", NUMBERS)
def test_on_flat_ground_a_robot_has_the_numbers_of_its_file(name, enter, files):
    drive, error, split = NUMBERS[name]
    fleet = enter(source(name, files))
    found = fleet.drive.drive
    radius = fleet.robot.geometry.sprocket_radius
    expected = radius * (1 + error + split * np.array([-1.0, 1.0]))
    np.testing.assert_allclose(fleet.drive.radius[0], expected)
    if drive is None:
        assert (found.torque_limit, found.top_speed) == (UNLIMITED, TOP_SPEED)
    else:
        assert found == drive
    assert fleet.drive.limit == pytest.approx(found.top_speed / radius)


@TRAVERSES
@pytest.mark.parametrize("name", NUMBERS)
def test_on_terrain_a_robot_has_the_numbers_of_its_file(name, enter, files):
    drive = NUMBERS[name][0]
    world = enter(source(name, files))
    assert world.tracked.robot.drive == drive
    assert world.top_speed == (TOP_SPEED if drive is None else drive.top_speed)


@pytest.mark.parametrize("name", TOP_SPEEDS)
def test_a_shipped_robot_has_its_top_speed_in_both_worlds(name):
    top_speed = TOP_SPEEDS[name]
    fleet = fleet_of_api(name)
    assert fleet.drive.limit * fleet.robot.geometry.sprocket_radius == pytest.approx(top_speed)
    assert traverse_of_api(name).top_speed == traverse_of_command(name).top_speed == top_speed


def turned_radius(robot, **options):
    """Radius of a turn commanded with a radius of 1 m at 0.1 m/s [m]."""
    world = World.of(GridConfig(robot=robot, **options))
    fleet = world.fleet(np.zeros((1, 3)))
    half_gauge = world.robot.geometry.half_gauge
    surface = 0.1 * (1 + np.array([-1.0, 1.0]) * half_gauge)
    fleet.command(surface / world.robot.geometry.sprocket_radius)
    fleet.advance(3.0)
    twist = fleet.twist()[0]
    return twist[0] / twist[2], fleet.drive.saturated_time.max()


def test_a_heavy_robot_without_motors_turns_as_theory_says(files):
    """It isn't held by the motors of a robot of 25 kg."""
    radius, saturated = turned_radius(source("heavy", files))
    contact = line_contact(0.27, 0.5, 0.7, 0.778, (0.0, 0.0, 0.35))
    theory = steady_twist(0.1 * (1 + np.array([-0.27, 0.27])), contact)
    assert radius == pytest.approx(theory[0] / theory[2], rel=0.01)
    assert saturated == 0.0


@pytest.mark.parametrize("limit", [7.9999, 8.0, 8.0001])
def test_eight_newton_metres_are_a_limit_like_any_other(limit, files):
    """With them, 100 kg don't turn."""
    robot = files / f"limit_{limit}.toml"
    robot.write_text(TRACKS + f"[drive]\ntorque_limit = {limit}\n")
    radius, saturated = turned_radius(str(robot))
    assert radius > 100.0
    assert saturated > 2.5


def test_options_of_a_drive_begin_with_unlimited_motors(files):
    world = World.of(GridConfig(robot=source("heavy", files)))
    drive = world.config.drive
    assert world.drive.torque_limit == UNLIMITED
    limited = type(drive)(torque_limit=100.0).changed(None)
    np.testing.assert_allclose(limited.limits(np.array([0.0, 5.0])), [[-100.0] * 2, [100.0] * 2])
    of_motor = type(drive)(torque_limit=100.0, motor=type(drive.motor)(stall_torque=4.0))
    assert of_motor.changed(None).motor == Motor(stall_torque=4.0)


@pytest.mark.parametrize(
    ("robot", "options", "message"),
    [
        ("shipped", {"speed": 0.31}, "speed = 0.31: must be for belts of at most .* 0.3 m/s"),
        ("rescue", {"speed": 0.5, "turn": 1.0}, "speed, turn = .* top speed, 0.6 m/s"),
    ],
)
def test_speeds_beyond_a_robots_top_speed_are_refused(robot, options, message):
    with pytest.raises(InvalidValueError, match=message):
        make_world(DriveConfig(robot=robot, course="flat", **options))


def test_a_robot_file_written_by_calibrate_keeps_its_motors(tmp_path):
    """Also those of the shipped robot, although they are defaults, and those it hasn't."""
    for drive in (Drive(), OF_FILE, None):
        path = tmp_path / "robot.toml"
        parameters = RobotParameters(drive=drive)
        path.write_text(robot_file_text(parameters, Ground(), "a robot"))
        assert load_parameters(path)[0] == parameters


def test_the_warning_on_a_weak_motor_says_how_weak_it_is(robot):
    """Turning on the spot takes half the friction force times the radius, on either side."""
    fleet = Fleet(robot, np.zeros((2, 3)), radius_error=0.0, drive=Drive(torque_limit=1.0))
    commands = np.array([[-0.5, 3.0], [0.0, 0.0]])
    weak, idle = open_loop(fleet, commands, 1.0)
    assert saturation_warnings([idle]) == []
    (text,) = saturation_warnings([weak])
    found = re.fullmatch(
        r"run 'run 0': the (?:left|right) motor is at its limit for \d\d\.\d% of the time: "
        r"1 N m at hand, (\S+) N m needed",
        text,
    )
    assert found is not None, text
    assert 3.0 < float(found[1]) < 0.8 * 25.0 * 9.81 * 0.06 / 2
