from dataclasses import replace

import numpy as np
import pytest

from sim import Fleet, Ground, Pull, load_robot, open_loop
from sim.env import PathTrackingVectorEnv
from sim.fleet.fleet import RunSetup
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import Drive, Motor, tireless
from sim.robot.named import load_parameters
from sim.runs.run_recorder import SINKING, Sinking
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Wheels, drawbar_curve, roll, slip_for

SAND = NAMED_GROUNDS["dry_sand"]
LOAM = NAMED_GROUNDS["upland_loam"]
REGOLITH = NAMED_GROUNDS["regolith"]
HUSKY, _ = load_parameters("husky")
WEIGHT = HUSKY.mass * 9.81
WHEELS = Wheels(
    length=HUSKY.axles[1] - HUSKY.axles[0],
    radius=HUSKY.sprocket_radius,
    width=HUSKY.track_width,
    weight=WEIGHT,
    com_height=HUSKY.com_height,
)
WEAK = Drive(motor=Motor(stall_torque=0.3, gear=79.0), torque_limit=20.0)


@pytest.fixture(scope="module")
def robot():
    return load_robot(HUSKY)


def without_slip_sinkage(ground):
    return replace(ground, soil=replace(ground.soil, n1=0.0))


def fleet_on(robot, *grounds, **options):
    return Fleet(robot, np.zeros((len(grounds), 3)), list(grounds), 0.0, tireless(), **options)


def drive(fleet, omega, seconds):
    fleet.command(omega)
    for _ in range(round(seconds / 0.1)):
        fleet.advance(0.1)


def slip_of(fleet, omega, seconds=1.0):
    before = fleet.pose()[:, 0]
    fleet.advance(seconds)
    travel = omega * HUSKY.sprocket_radius * seconds
    return 1 - (fleet.pose()[:, 0] - before) / travel


def resistance(fleet):
    return -fleet.ruts.resistance.sum(axis=1)


def test_wheels_at_rest_stand_as_deep_as_they_roll(robot):
    grounds = (SAND, LOAM, REGOLITH)
    fleet = fleet_on(robot, *grounds)
    expected = [roll(ground.soil, WHEELS, WEIGHT / 4).rut[0] for ground in grounds]
    np.testing.assert_allclose(fleet.ruts.wheel_depth.mean(axis=1), expected, rtol=1e-3)
    fleet.advance(1.0)
    np.testing.assert_allclose(resistance(fleet), 0.0, atol=4e-6 * WEIGHT)
    np.testing.assert_allclose(fleet.pose(), 0.0, atol=1e-5)


def test_front_and_rear_wheels_press_the_ruts_of_theory(robot):
    grounds = [without_slip_sinkage(ground) for ground in (SAND, LOAM, REGOLITH)]
    fleet = fleet_on(robot, *grounds)
    drive(fleet, [2.0, 2.0], 6.0)
    slip = slip_of(fleet, 2.0)
    for k, ground in enumerate(grounds):
        theory = drawbar_curve(ground.soil, WHEELS, [slip[k]])
        assert fleet.ruts.deepest[k] == pytest.approx(theory.sinkage.repeat(2), rel=0.01)
        assert resistance(fleet)[k] == pytest.approx(theory.resistance[0], rel=0.01)
        assert fleet.mean_traction[k].sum() == pytest.approx(theory.resistance[0], rel=0.01)


def test_slip_under_a_pull_is_theorys(robot):
    pull = 0.15 * WEIGHT
    fleet = fleet_on(robot, LOAM, REGOLITH, pull=Pull(pull, 0.2))
    drive(fleet, [1.5, 1.5], 9.0)
    expected = [slip_for(each.soil, WHEELS, pull, hitch_height=0.2) for each in (LOAM, REGOLITH)]
    np.testing.assert_allclose(slip_of(fleet, 1.5), expected, atol=0.001)


def test_a_wheel_that_turns_back_rolls_in_its_own_rut(robot):
    fleet = fleet_on(robot, without_slip_sinkage(SAND))
    drive(fleet, [2.0, 2.0], 6.0)
    fresh = resistance(fleet)[0]
    rut = fleet.ruts.wheel_depth[0, 0]
    drive(fleet, [-2.0, -2.0], 1.0)
    third = roll(SAND.soil, WHEELS, WEIGHT / 4, rut)
    assert fleet.ruts.wheel_depth[0, 0] == pytest.approx(third.rut[0], rel=0.03)
    assert -0.8 * fresh < resistance(fleet)[0] < 0


def test_wheels_that_spin_on_the_spot_deepen_their_ring_more_slowly(robot):
    fleet = fleet_on(robot, without_slip_sinkage(SAND))
    drive(fleet, [-2.0, 2.0], 3.0)
    fresh = np.abs(fleet.ruts.resistance).sum()
    drive(fleet, [-2.0, 2.0], 12.0)
    assert fleet.pose()[0, 2] > np.pi
    assert np.abs(fleet.ruts.resistance).sum() < 0.7 * fresh


def test_restart_clears_the_ruts(robot):
    fleet = fleet_on(robot, SAND, SAND)
    drive(fleet, [3.0, 3.0], 3.0)
    fresh = fleet_on(robot, SAND)
    fleet.restart([0], [RunSetup((0.0, 0.0, 0.0), SAND, radius_error=0.0)])
    drive(fleet, [3.0, 3.0], 2.0)
    drive(fresh, [3.0, 3.0], 2.0)
    np.testing.assert_allclose(fleet.ruts.resistance[0], fresh.ruts.resistance[0], rtol=1e-3)


def random_drive(fleet, splits=1, seconds=0.8):
    generator = np.random.default_rng(1)
    for _ in range(round(seconds / 0.4)):
        omega = generator.uniform(-4.0, 4.0, (fleet.size, 2))
        fleet.command(omega)
        for _ in range(splits):
            fleet.advance(0.4 / splits)


def state_of(fleet):
    return fleet.batch.state.copy(), fleet.ruts.get_state()


def assert_equal(first, second):
    np.testing.assert_array_equal(first[0], second[0])
    for name, value in first[1].items():
        np.testing.assert_array_equal(value, second[1][name], err_msg=name)


@pytest.mark.parametrize("motors", [tireless(), WEAK])
def test_bits_do_not_depend_on_threads_or_splits(robot, motors):
    """Weak motors try periods again, which undoes ruts."""
    start = np.zeros((4, 3))
    grounds = [SAND, LOAM, REGOLITH, Ground(shear=0.01)]
    states = []
    for threads, splits in ((1, 1), (2, 1), (1, 4), (2, 40)):
        fleet = Fleet(robot, start, grounds, 0.0, motors, threads)
        random_drive(fleet, splits)
        is_weak = motors is WEAK
        assert bool(fleet.drive.saturated_time.any()) == is_weak
        states.append(state_of(fleet))
    for other in states[1:]:
        assert_equal(states[0], other)


def test_a_robot_in_a_fleet_moves_as_it_does_alone(robot):
    grounds = [SAND, Ground(shear=0.01), LOAM]
    fleet = fleet_on(robot, *grounds)
    drive(fleet, [3.0, 2.0], 2.0)
    for k, ground in enumerate(grounds):
        alone = fleet_on(robot, ground)
        drive(alone, [3.0, 2.0], 2.0)
        np.testing.assert_array_equal(alone.pose()[0], fleet.pose()[k])


def test_a_restored_state_continues_bit_by_bit(robot):
    fleet = fleet_on(robot, SAND, LOAM)
    random_drive(fleet)
    state = fleet.get_state()
    random_drive(fleet)
    other = fleet_on(robot, SAND, LOAM)
    other.set_state(state)
    random_drive(other)
    assert_equal(state_of(fleet), state_of(other))


def test_a_parked_robot_stays_on_a_slope(robot):
    fleet = fleet_on(robot, replace(LOAM, slope=np.radians(10.0)))
    fleet.advance(2.0)
    before = fleet.pose()[0, :2]
    fleet.advance(5.0)
    assert np.hypot(*(fleet.pose()[0, :2] - before)) < 5 * 0.06e-3


def test_soft_soil_may_come_later(robot):
    prepared = Fleet(robot, np.zeros((1, 3)), sinks=True)
    prepared.set_ground(SAND)
    prepared.advance(2.0)
    expected = roll(SAND.soil, WHEELS, WEIGHT / 4).rut[0]
    assert prepared.attitude()[0, 0] > 0.9 * expected


def test_soil_that_does_not_bear_the_wheels_is_refused(robot):
    with pytest.raises(InvalidValueError, match=r"ground.soil .* sink in up to their axles"):
        Fleet(robot, np.zeros((1, 3)), NAMED_GROUNDS["soft_snow"])


def test_robots_on_firm_ground_keep_their_digits(robot):
    poses = []
    for options in ({"shears": True}, {"sinks": True}):
        fleet = Fleet(robot, np.zeros((1, 3)), Ground(), 0.0, tireless(), **options)
        drive(fleet, [3.0, 2.0], 2.0)
        poses.append(fleet.pose())
    np.testing.assert_array_equal(*poses)


def test_environments_drive_wheels_on_soft_soil():
    soft = PathTrackingVectorEnv(2, reference="circle", robot="husky", ground="upland_loam")
    soft.reset(seed=0)
    _, _, _, _, info = soft.step(np.zeros((2, *soft.single_action_space.shape)))
    assert np.isfinite(info["true_pose"]).all()


def test_runs_say_that_wheels_are_immobilised(robot):
    """On loam, theory's largest pull is 349 N."""
    notes = {}
    for pull in (100.0, 420.0):
        fleet = fleet_on(robot, LOAM, pull=Pull(pull, 0.2, since=0.5))
        (log,) = open_loop(fleet, [2.0, 2.0], 15.0)
        notes[pull] = " ".join(Sinking(**log.metadata[SINKING]).notes)
    assert notes[100.0] == ""
    assert notes[420.0].startswith("immobilised: the wheels dig at a slip of ")
