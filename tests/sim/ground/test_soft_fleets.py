"""What holds for fleets on soft soil alike, on tracks and on wheels."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from soft_soil import drive, fleet_on

from sim import Fleet, Ground, Pull, load_robot
from sim.env import PathTrackingVectorEnv
from sim.fleet.fleet import RunSetup
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import Drive, Motor, tireless
from sim.path_tracking.config import EnvConfig
from sim.path_tracking.randomization import Randomization
from sim.robot.named import load_parameters
from sim.robot.robot import Robot
from trackslip.errors import InvalidValueError

SAND = NAMED_GROUNDS["dry_sand"]
REGOLITH = NAMED_GROUNDS["regolith"]
CREEP = 0.06e-3
"""Bound on the speed of parked robots [m/s]."""


@dataclass(frozen=True)
class Gear:
    """A robot, and what suits it."""

    robot: Robot
    soft: Ground
    """The softest ground that bears it."""
    weak: Drive
    """Motors too weak for this ground."""


def tracks():
    weak = Drive(motor=Motor(stall_torque=0.05, gear=43.0), torque_limit=3.0)
    return Gear(load_robot(), NAMED_GROUNDS["soft_snow"], weak)


def wheels():
    weak = Drive(motor=Motor(stall_torque=0.3, gear=79.0), torque_limit=20.0)
    husky, _ = load_parameters("husky")
    return Gear(load_robot(husky), NAMED_GROUNDS["upland_loam"], weak)


@pytest.fixture(scope="module", params=[tracks, wheels])
def gear(request):
    return request.param()


def random_drive(fleet, splits=1):
    generator = np.random.default_rng(1)
    for _ in range(2):
        fleet.command(generator.uniform(-4.0, 4.0, (fleet.size, 2)))
        for _ in range(splits):
            fleet.advance(0.4 / splits)


def assert_equal(fleet, other):
    np.testing.assert_array_equal(fleet.batch.state, other.batch.state)
    state = other.ruts.get_state()
    for name, value in fleet.ruts.get_state().items():
        np.testing.assert_array_equal(value, state[name], err_msg=name)


@pytest.mark.parametrize("is_weak", [False, True])
def test_bits_do_not_depend_on_threads_or_splits(gear, is_weak):
    """Weak motors try periods again, which undoes ruts."""
    grounds = [SAND, gear.soft, REGOLITH, Ground(shear=0.01)]
    motors = gear.weak if is_weak else tireless()
    fleets = []
    for threads, splits in ((1, 1), (2, 10)):
        fleet = Fleet(gear.robot, np.zeros((4, 3)), grounds, 0.0, motors, threads)
        random_drive(fleet, splits)
        assert bool(fleet.drive.saturated_time.any()) == is_weak
        fleets.append(fleet)
    assert_equal(*fleets)


def test_a_robot_in_a_fleet_moves_as_it_does_alone(gear):
    grounds = [SAND, Ground(shear=0.01), gear.soft]
    fleet = fleet_on(gear.robot, *grounds)
    drive(fleet, [3.0, 2.0], 1.0)
    for k, ground in enumerate(grounds):
        alone = fleet_on(gear.robot, ground)
        drive(alone, [3.0, 2.0], 1.0)
        np.testing.assert_array_equal(alone.pose()[0], fleet.pose()[k])


def test_a_restored_state_continues_bit_by_bit(gear):
    fleet = fleet_on(gear.robot, SAND, gear.soft)
    random_drive(fleet)
    state = fleet.get_state()
    random_drive(fleet)
    other = fleet_on(gear.robot, SAND, gear.soft)
    other.set_state(state)
    random_drive(other)
    assert_equal(fleet, other)


def test_restart_clears_the_ruts(gear):
    ground = gear.soft
    fleet = fleet_on(gear.robot, ground, ground)
    drive(fleet, [3.0, 3.0], 2.0)
    fleet.restart([0], [RunSetup((0.0, 0.0, 0.0), ground, radius_error=0.0)])
    fresh = fleet_on(gear.robot, ground)
    drive(fleet, [3.0, 3.0], 1.0)
    drive(fresh, [3.0, 3.0], 1.0)
    np.testing.assert_allclose(fleet.ruts.resistance[0], fresh.ruts.resistance[0], rtol=1e-3)
    assert (fresh.ruts.resistance < 0).all()


def test_forces_on_the_chassis_have_the_moments_of_their_places(gear):
    """The pull acts at the hitch, a side's resistance under its track or at its wheels' axles."""
    shape = replace(gear.robot.parameters, com_x=0.01, com_y=0.02)
    pull = Pull(20.0, height=0.1)
    heading = 0.5
    fleet = Fleet(
        load_robot(shape), np.array([[0.0, 0.0, heading]]), SAND, 0.0, tireless(), pull=pull
    )
    fleet.advance(fleet.period)
    fleet.ruts.resistance[:] = [[-3.0, -5.0]]
    fleet.ruts.traction[:] = 0.0
    fleet.advance(fleet.period)

    lever = shape.sprocket_radius if shape.axles else 0.0
    half_gauge = shape.half_gauge
    forces = {(0.0, 0.0, 0.1): 20.0, (0, half_gauge, lever): 3.0, (0, -half_gauge, lever): 5.0}
    total = np.zeros(6)
    for place, backwards in forces.items():
        force = np.array([-backwards, 0.0, 0.0])
        total[:3] += force
        total[3:] += np.cross(np.array(place) - shape.centre_of_mass, force)
    turn = Rotation.from_euler("z", heading)
    applied = fleet.batch.bind("xfrc_applied")[0, fleet.robot.model.body("chassis").id]
    expected = [*turn.apply(total[:3]), *turn.apply(total[3:])]
    np.testing.assert_allclose(applied, expected, rtol=1e-3, atol=1e-4)


def test_a_parked_robot_stays_on_a_slope(gear):
    fleet = fleet_on(gear.robot, replace(SAND, slope=np.radians(10.0)))
    fleet.advance(2.0)
    before = fleet.pose()[0, :2]
    fleet.advance(5.0)
    assert np.hypot(*(fleet.pose()[0, :2] - before)) < 5 * CREEP


def test_soft_soil_needs_a_fleet_for_it(gear):
    fleet = Fleet(gear.robot, np.zeros((1, 3)), Ground(shear=0.01))
    with pytest.raises(InvalidValueError, match=r"ground.soil .* say Fleet\(\.\.\., sinks=True\)"):
        fleet.set_ground(SAND)
    began_there = fleet_on(gear.robot, SAND)
    prepared = Fleet(gear.robot, np.zeros((1, 3)), sinks=True)
    prepared.set_ground(SAND)
    prepared.advance(2.0)
    assert prepared.attitude()[0, 0] == pytest.approx(began_there.attitude()[0, 0], rel=0.1)


def test_robots_on_firm_ground_keep_their_digits(gear):
    poses = []
    for options in ({"shears": True}, {"sinks": True}):
        fleet = fleet_on(gear.robot, Ground(), **options)
        drive(fleet, [3.0, 2.0], 1.0)
        poses.append(fleet.pose())
    np.testing.assert_array_equal(*poses)


@pytest.mark.parametrize(("robot", "ground"), [("shipped", "soft_snow"), ("husky", "upland_loam")])
def test_environments_drive_on_soft_soil(robot, ground):
    soft = PathTrackingVectorEnv(2, reference="circle", robot=robot, ground=("stone", "dry_sand"))
    soft.reset(seed=0, options={"ground": ground})
    _, _, _, _, info = soft.step(np.zeros((2, *soft.single_action_space.shape)))
    assert np.isfinite(info["true_pose"]).all()


def test_environments_refuse_soft_soil_that_they_do_not_know_of():
    firm = PathTrackingVectorEnv(1, reference="circle", ground="clay")
    with pytest.raises(InvalidValueError, match="made without soft soil"):
        firm.reset(seed=0, options={"ground": "dry_sand"})
    patchy = Randomization(patches=(1, 2))
    with pytest.raises(InvalidValueError, match="without friction_ratio, patches and shear"):
        PathTrackingVectorEnv(1, ground="dry_sand", randomization=patchy)


def test_friction_is_drawn_on_firm_ground_only():
    grounds = ("dry_sand", "stone")
    drawn = Randomization(friction_ratio=(1.5, 2.0), com_x=(-0.02, 0.02))
    config = EnvConfig(ground=grounds, randomization=drawn)
    ratios = {}
    for name in grounds:
        base = config.load_ground(name)
        setup = drawn.setup(np.random.default_rng(0), config.parameters, base, np.zeros((9, 3)))
        ratios[name] = setup.ground.across / base.across
        assert setup.com_offset[0] != 0
    assert ratios["dry_sand"] == 1
    assert 1.5 < ratios["stone"] < 2
