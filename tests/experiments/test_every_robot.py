"""Every robot in every entry point: the numbers of its file, and no other robot's."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark.config import Config as BenchmarkConfig
from experiments.benchmark.drive import ClosedLoops
from experiments.calibrate.calibration import first_candidate
from experiments.drive.config import Config as DriveConfig
from experiments.drive.world import driver, make_world
from experiments.evaluate.config import Config as EvaluateConfig
from experiments.evaluate.models import notes_on_motors
from experiments.predict import Config as PredictConfig
from experiments.predict import predicted_world
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_summary import saturation_warnings
from experiments.simulate.motors import without_motors
from experiments.simulate.options import GroundOptions
from experiments.simulate.world import World
from experiments.track import Config as TrackConfig
from experiments.train.config import Config as TrainConfig
from experiments.train.tasks import learning_task
from experiments.tune import Config as TuneConfig
from experiments.validate.measurements import Setup, paper_turns
from experiments.wander.config import Config as WanderConfig
from sim import Drive, Fleet, Ground, RobotParameters, Traverse, load_robot, load_tracked, open_loop
from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.motors.motor import TOP_SPEED, UNLIMITED, Motor, or_tireless, tireless
from sim.robot.named import load_parameters
from sim.robot.parameters import RADIUS_ERROR, robot_file_text
from sim.runs.log_replay import Replayer
from sim.runs.run_recorder import Saturation
from sim.terrain import Course, Flat
from sim.traverse.policy import scripted
from trackslip.errors import InvalidValueError
from trackslip.logs.runlog import RunLog
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
BODY = """half_gauge = 0.25
contact_length = 0.5
sprocket_radius = 0.08
radius_error = 0.01
radius_split = -0.004
mass = 40.0
com_x = 0.02
com_y = -0.01
com_height = 0.15
inertia = [1.0, 1.5, 2.0, 0.0, 0.0, 0.0]
plate_height = 0.7
looks = "rescue"
"""
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


OF_FILE = replace(
    tireless(0.45),
    lag=0.2,
    torque_limit=12.0,
    motor=replace(tireless().motor, gear=30.0, no_load_speed=300.0, stall_torque=0.7),
)
"""What OWN states; what it leaves out is no limit."""
OF_LIMIT = replace(tireless(), torque_limit=8.0)
NUMBERS = {
    "shipped": (Drive(), RADIUS_ERROR, 0.0),
    "box": (None, 0.0, 0.0),
    "heavy": (None, 0.0, 0.0),
    "heavy_eight": (OF_LIMIT, 0.0, 0.0),
    "heavy_own": (OF_FILE, 0.0, 0.0),
    "plain": (None, 0.02, 0.0),
    "plain_eight": (OF_LIMIT, RADIUS_ERROR, 0.0),
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


def fleet_of_track(robot):
    return World.of(TrackConfig(robot=robot)).fleet(np.zeros((1, 3)))


def fleet_of_wander(robot):
    return World.of(WanderConfig(robot=robot)).fleet(np.zeros((1, 3)))


def fleet_of_benchmark(robot):
    return ClosedLoops(BenchmarkConfig(robot=robot)).world.fleet(np.zeros((1, 3)))


def fleet_of_tune(robot):
    return ClosedLoops(TuneConfig(robot=robot), "drawn").world.fleet(np.zeros((1, 3)))


def fleet_of_calibrate(robot):
    base = first_candidate(robot, GroundOptions(), None, None)
    return Fleet(load_robot(base.robot), np.zeros((1, 3)))


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
    "enter",
    [
        fleet_of_api,
        fleet_of_command,
        fleet_of_track,
        fleet_of_wander,
        fleet_of_benchmark,
        fleet_of_tune,
        fleet_of_calibrate,
        fleet_of_environment,
    ],
    ids=["API", "grid", "track", "wander", "benchmark", "tune", "calibrate and evaluate", "env"],
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


@FLEETS
def test_on_flat_ground_a_robot_has_the_body_of_its_file(enter, tmp_path):
    """Every field of a parameter file, with a value of its own."""
    path = tmp_path / "robot.toml"
    path.write_text(BODY)
    fleet = enter(str(path))
    parameters = fleet.robot.parameters
    for name, value in tomllib.loads(BODY).items():
        found = getattr(parameters, name)
        assert (list(found) if isinstance(found, tuple) else found) == value, name
    chassis = fleet.robot.model.body("chassis")
    assert chassis.mass == pytest.approx(40.0)
    np.testing.assert_allclose(chassis.ipos, [0.02, -0.01, 0.15])
    np.testing.assert_allclose(np.sort(chassis.inertia), [1.0, 1.5, 2.0])
    assert fleet.robot.geometry.half_gauge == 0.25
    assert np.abs(fleet.robot.contact_points[:, 1]).max() == 0.25


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


SLOW = "[drive]\ntop_speed = 0.2\n"


@pytest.fixture
def slow(tmp_path):
    """A robot slower than the usual speeds."""
    path = tmp_path / "slow.toml"
    path.write_text(SLOW)
    return str(path)


def test_a_slow_robot_drives_at_its_top_speed(slow):
    config = DriveConfig(robot=slow, course="flat")
    world = make_world(config)
    command = driver(config, world)(world)
    np.testing.assert_array_equal(command.speed, 0.2)
    world = World.of(WanderConfig(robot=slow))
    assert world.config.fastest(world.drive) == 0.2


def test_a_slow_robot_is_scripted_within_its_top_speed(slow):
    """Else both belts are at their top speed, and it can't steer."""
    world = traverse_of_api(slow)
    world.begin([0], start=[[world.footprint.start(LEVEL), 0.1, 0.0]])
    speed = scripted(world).speed[0]
    assert speed[0] == pytest.approx(0.2 + 0.03)
    assert speed[1] == pytest.approx(0.2 - 0.03)


@pytest.mark.parametrize(
    ("robot", "fastest"),
    [("shipped", 0.3), ("maxxii", 0.4), ("warthog", 0.3 * (0.54 / 0.168) ** 0.5), ("slow", 0.2)],
)
def test_robots_are_validated_at_speeds_of_their_own(robot, fastest, slow):
    """In proportion to the paper's, by the root of the width, and up to their top speed."""
    parameters, ground = load_parameters(slow if robot == "slow" else robot)
    setup = Setup(parameters, ground)
    assert setup.drive.top_speed == pytest.approx(fastest)
    _, speed, omega = paper_turns(parameters)
    assert speed.max() == pytest.approx(fastest * 0.25 / 0.3)
    assert omega.max() * parameters.sprocket_radius <= fastest * (1 + 1e-9)


def test_theory_has_the_numbers_of_the_robots_file(tmp_path, capsys):
    path = tmp_path / "robot.toml"
    path.write_text(BODY)
    robot, _, _ = predicted_world(PredictConfig(robot=str(path)))
    assert robot == replace(load_parameters(path)[0], com_y=0.0)
    assert "com_y = -0.01 m" in capsys.readouterr().out
    robot, _, _ = predicted_world(PredictConfig(robot=str(path), radius_error=0.0))
    assert robot.radius_error == 0.0


@pytest.mark.parametrize(
    "command",
    [
        "grid --radii 1 --speeds 0.1 --duration 4 --executor inline",
        "track --controller feedforward --compensation none --reference circle --circle-duration 2",
        "wander --duration 2",
        "drive --course flat --duration 0.2 --pictures 0",
    ],
)
def test_every_command_says_that_a_robot_has_no_motors(command, files, trackslip):
    robot = source("plain", files)
    said = f"{robot} has no motors: its torque is unlimited, and its top speed 0.6 m/s"
    assert said in trackslip(*command.split(), "--robot", robot).printed
    assert "has no motors" not in trackslip(*command.split()).printed


def test_drive_says_that_it_exceeds_the_usual_top_speed(files, trackslip):
    robot = source("plain", files)
    short = ("--course", "flat", "--duration", "0.2", "--pictures", "0")
    drive = ("drive", *short, "--robot", robot, "--speed")
    said = "a robot without motors is as fast as `drive` is told"
    assert f"{said}, 0.7 m/s here; in all other commands" in trackslip(*drive, "0.7").printed
    assert said not in trackslip(*drive, "0.6").printed


def test_commands_to_a_robot_without_motors_are_replayed_in_full(files):
    """Up to 1 m/s, although its usual top speed is 0.6 m/s."""
    time = np.arange(0.0, 4.0, 0.05)
    omega = np.full((len(time), 2), 1.0 / 0.06)
    pose = np.column_stack([time, 0 * time, 0 * time])
    log = RunLog(run="straight", time=time, omega=omega, pose=pose, command=omega)
    parameters, _ = load_parameters(source("plain", files))
    replay = Replayer([log], "commands").run(parameters, Ground())
    under_way = len(replay.twist) // 2
    assert replay.twist[under_way, 0, 0] == pytest.approx(1.02, rel=0.005)


def test_drive_warns_of_a_weak_motor_as_grid_does(tmp_path, trackslip):
    robot = tmp_path / "weak.toml"
    robot.write_text("half_gauge = 0.2\n[drive]\ntorque_limit = 2.0\n")
    turn = ("--course", "flat", "--turn", "1.5", "--speed", "0", "--duration", "2")
    drove = ("drive", *turn, "--pictures", "0")
    grid = ("grid", "--radii", "0.21", "--speeds", "0.1", "--duration", "4")
    pattern = r"motor is at its limit for (\S+)% of the time: 2 N m at hand, (\S+) N m needed"
    for command in (drove, grid):
        found = re.search(pattern, trackslip(*command, "--robot", str(robot)).printed)
        assert found is not None, command
        assert float(found[1]) > 90
        assert 2.5 < float(found[2]) < 0.8 * 25.0 * 9.81 * 0.06 / 2


def test_a_motor_in_the_middle_is_named_too():
    share = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0]])
    torque = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, -2.0]])
    needed = np.array([[1.0, 1.0, 4.0], [1.0, 1.0, -4.0]])
    found = str(Saturation.of(share, torque, needed))
    assert found == (
        "the middle motor is at its limit for 75.0% of the time: 2 N m at hand, 4 N m needed"
    )


def test_a_peak_at_the_start_is_not_the_torque_needed():
    share = np.array([[1.0], [1.0], [1.0], [0.2], [0.0]])
    torque = np.array([[3.0], [2.0], [2.0], [1.0], [1.0]])
    needed = np.array([[9.0], [2.5], [-2.5], [1.0], [1.0]])
    found = Saturation.of(share, torque, needed)
    assert found == Saturation("left", pytest.approx(0.64), 2.0, 2.5)


@pytest.mark.parametrize(("share", "is_said"), [(0.0, False), (4e-4, False), (6e-4, True)])
def test_no_motor_is_at_its_limit_for_0_percent(share, is_said):
    saturated = np.array([[share, 0.0]])
    torque = np.array([[2.0, 0.0]])
    assert (Saturation.of(saturated, torque, 2 * torque) is not None) == is_said


def test_motors_without_a_limit_are_named_and_others_not():
    assert without_motors("mine", tireless(1.5)) == [
        "mine has no motors: its torque is unlimited, and its top speed 1.5 m/s; `torque_limit` or "
        "[drive.motor] in the table [drive] of its file limits it"
    ]
    assert without_motors("mine", replace(tireless(), torque_limit=100.0)) == []
    assert without_motors("mine", Drive()) == []


@pytest.mark.parametrize("name", ["plain_own", "heavy"])
def test_policies_learn_with_the_motors_of_the_robots_file(name, files):
    pytest.importorskip("stable_baselines3")
    robot = source(name, files)
    drive, error, _ = NUMBERS[name]
    task = learning_task(TrainConfig(robot=robot, robots=16, compensation="none"))
    assert (task.robot, task.drive) == (robot, or_tireless(drive))
    assert task.env.task.fleet.drive.drive == or_tireless(drive)
    low, high = task.env.task.config.drawn.radius_error
    assert (low + high) / 2 == pytest.approx(error)
    crossing = learning_task(TrainConfig(robot=robot, robots=16, env="traverse"))
    assert crossing.env.task.world.tracked.robot.drive == drive
    assert crossing.drive == or_tireless(drive)


def test_evaluate_names_robots_without_motors(files):
    robots = (source("plain", files), source("plain_own", files))
    config = EvaluateConfig(logs=(Path("log.csv"),), robot=robots, inputs="commands")
    assert notes_on_motors(config) == [
        f"{robots[0]} has no motors: its torque is unlimited, and it follows commands of any speed"
    ]
    assert notes_on_motors(replace(config, inputs="encoders")) == []
