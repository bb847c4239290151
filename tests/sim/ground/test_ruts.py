from dataclasses import replace

import numpy as np
import pytest

from sim import Fleet, Ground, Pull, RobotParameters, open_loop
from sim.env import PathTrackingVectorEnv
from sim.fleet.fleet import RunSetup
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import Drive, Motor, tireless
from sim.robot.parameters import SINK
from sim.runs.run_recorder import SINKING, Sinking
from trackslip.errors import InvalidValueError
from trackslip.logs.logfile import read_runs, write_parquet
from trackslip.logs.table import TRUTH, column_names
from trackslip.skid_theory import Tracks, drawbar_curve

SAND = NAMED_GROUNDS["dry_sand"]
SNOW = NAMED_GROUNDS["soft_snow"]
REGOLITH = NAMED_GROUNDS["regolith"]
ROBOT = RobotParameters()
WEIGHT = 25 * 9.81
WIDTH = ROBOT.track_width
TRACKS = Tracks(ROBOT.contact_length, WIDTH, WEIGHT, 0.0, ROBOT.com_height, SINK)
RADIUS = ROBOT.sprocket_radius
OF_SOIL = {*TRUTH["sinkage"], *TRUTH["resistance"]}
"""Columns that only logs of runs on soft soil have."""


def without_slip_sinkage(ground):
    return replace(ground, soil=replace(ground.soil, n1=0.0))


def sinkage(ground):
    return float(ground.soil.sinkage(TRACKS.pressure, WIDTH))


def resistance(ground):
    return 2 * WIDTH * float(ground.soil.work(sinkage(ground), WIDTH))


def fleet_on(robot, *grounds, **options):
    return Fleet(robot, np.zeros((len(grounds), 3)), list(grounds), 0.0, tireless(), **options)


def drive(fleet, omega, seconds):
    fleet.command(omega)
    for _ in range(round(seconds / 0.1)):
        fleet.advance(0.1)


def test_robots_at_rest_stand_as_deep_as_bekkers_equation(robot):
    grounds = (SAND, SNOW, REGOLITH)
    fleet = fleet_on(robot, *grounds)
    expected = [sinkage(ground) for ground in grounds]
    np.testing.assert_allclose(fleet.ruts.deepest.mean(axis=1), expected, rtol=1e-3)
    np.testing.assert_allclose(fleet.attitude()[:, 0] - SINK, expected, atol=5e-5)
    fleet.advance(1.0)
    np.testing.assert_allclose(fleet.ruts.resistance, 0.0, atol=1e-3)
    np.testing.assert_allclose(fleet.pose(), 0.0, atol=1e-5)


def test_resistance_and_depth_while_driving_are_theorys(robot):
    grounds = [without_slip_sinkage(ground) for ground in (SAND, SNOW, REGOLITH)]
    fleet = fleet_on(robot, *grounds)
    drive(fleet, [2.0, 2.0], 6.0)
    depth = [sinkage(ground) for ground in grounds]
    force = [resistance(ground) for ground in grounds]
    np.testing.assert_allclose(fleet.ruts.deepest.mean(axis=1), depth, rtol=0.01)
    np.testing.assert_allclose(-fleet.ruts.resistance.sum(axis=1), force, rtol=0.015)
    np.testing.assert_allclose(fleet.mean_traction.sum(axis=1), force, rtol=0.02)


def test_the_pull_at_a_slip_is_theorys(robot):
    pull = 0.15 * WEIGHT
    fleet = fleet_on(robot, SAND, REGOLITH, pull=Pull(pull, 0.1))
    drive(fleet, [2.0, 2.0], 9.0)
    before = fleet.pose()[:, 0]
    fleet.advance(0.5)
    slip = 1 - (fleet.pose()[:, 0] - before) / (0.5 * 2.0 * RADIUS)
    for ground, its_slip in zip((SAND, REGOLITH), slip, strict=True):
        theory = drawbar_curve(ground.soil, TRACKS, [its_slip], hitch_height=0.1)
        assert theory.pull[0] == pytest.approx(pull, abs=0.002 * WEIGHT)


def test_the_rut_of_a_first_pass_resists_no_more(robot):
    fleet = fleet_on(robot, SNOW)
    drive(fleet, [3.0, 3.0], 5.0)
    drive(fleet, [-3.0, -3.0], 3.0)  # back over its own rut
    assert -fleet.ruts.resistance.sum() < 0.02 * resistance(SNOW)
    drive(fleet, [3.0, 3.0], 1.5)  # past where its front dips as it speeds up
    assert abs(fleet.ruts.resistance.sum()) < 0.02 * resistance(SNOW)


def test_a_robot_that_spins_on_the_spot_meets_resistance_only_at_first(robot):
    fleet = fleet_on(robot, SAND)
    drive(fleet, [-2.0, 2.0], 20.0)
    turned = fleet.pose()[0, 2]
    assert turned > 2 * np.pi
    assert np.abs(fleet.ruts.resistance).sum() < 0.2 * resistance(SAND)


def test_restart_clears_the_ruts(robot):
    fleet = fleet_on(robot, SNOW, SNOW)
    drive(fleet, [3.0, 3.0], 4.0)
    fresh = fleet_on(robot, SNOW)
    fleet.restart([0], [RunSetup((0.0, 0.0, 0.0), SNOW, radius_error=0.0)])
    drive(fleet, [3.0, 3.0], 3.0)
    drive(fresh, [3.0, 3.0], 3.0)
    np.testing.assert_allclose(fleet.ruts.resistance[0], fresh.ruts.resistance[0], rtol=1e-3)
    assert fleet.ruts.resistance[0].sum() < -0.9 * resistance(SNOW)


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


WEAK = Drive(motor=Motor(stall_torque=0.05, gear=43.0), torque_limit=3.0)


@pytest.mark.parametrize("motors", [tireless(), WEAK])
def test_bits_do_not_depend_on_threads_or_splits(robot, motors):
    """Weak motors try periods again, which undoes ruts."""
    start = np.zeros((4, 3))
    grounds = [SAND, SNOW, REGOLITH, Ground(shear=0.01)]
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
    grounds = [SAND, Ground(shear=0.01), SNOW]
    fleet = fleet_on(robot, *grounds)
    drive(fleet, [3.0, 2.0], 2.0)
    for k, ground in enumerate(grounds):
        alone = fleet_on(robot, ground)
        drive(alone, [3.0, 2.0], 2.0)
        np.testing.assert_array_equal(alone.pose()[0], fleet.pose()[k])


def test_a_restored_state_continues_bit_by_bit(robot):
    fleet = fleet_on(robot, SAND, SNOW)
    random_drive(fleet)
    state = fleet.get_state()
    random_drive(fleet)
    other = fleet_on(robot, SAND, SNOW)
    other.set_state(state)
    random_drive(other)
    assert_equal(state_of(fleet), state_of(other))


def test_windows_follow_robots_and_keep_their_ruts(robot):
    """A robot that has driven 1.5 m has moved its window, and drives back in its rut."""
    fleet = fleet_on(robot, without_slip_sinkage(SNOW))
    drive(fleet, [5.0, 5.0], 6.0)
    assert fleet.pose()[0, 0] > 1.5
    # until the soil that braking pressed deeper is behind the robot
    drive(fleet, [-3.0, -3.0], 5.0)
    assert abs(fleet.ruts.resistance.sum()) < 0.02 * resistance(SNOW)


def test_a_parked_robot_stays_on_a_slope(robot):
    fleet = fleet_on(robot, replace(SAND, slope=np.radians(10.0)))
    fleet.advance(2.0)
    before = fleet.pose()[0, :2]
    fleet.advance(5.0)
    assert np.hypot(*(fleet.pose()[0, :2] - before)) < 5 * 0.06e-3


def test_soft_soil_needs_a_fleet_for_it(robot):
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(shear=0.01))
    with pytest.raises(InvalidValueError, match=r"ground.soil .* say Fleet\(\.\.\., sinks=True\)"):
        fleet.set_ground(SAND)
    prepared = Fleet(robot, np.zeros((1, 3)), sinks=True)
    prepared.set_ground(SAND)
    prepared.advance(1.0)
    assert prepared.attitude()[0, 0] > 0.9 * sinkage(SAND)


def test_environments_drive_on_soft_soil_that_they_know_of():
    soft = PathTrackingVectorEnv(2, reference="circle", ground=("dry_sand", "stone"))
    soft.reset(seed=0, options={"ground": "soft_snow"})
    _, _, _, _, info = soft.step(np.zeros((2, *soft.single_action_space.shape)))
    assert np.isfinite(info["true_pose"]).all()
    firm = PathTrackingVectorEnv(1, reference="circle", ground="clay")
    with pytest.raises(InvalidValueError, match="made without soft soil"):
        firm.reset(seed=0, options={"ground": "dry_sand"})
    with pytest.raises(InvalidValueError, match="friction, patches and shear are drawn"):
        PathTrackingVectorEnv(1, ground="dry_sand", randomization="typical")


def test_runs_say_how_robots_sank_and_that_one_is_immobilised(robot):
    """On sand, theory's largest pull is 155 N."""
    notes = {}
    for pull in (50.0, 168.0):
        fleet = fleet_on(robot, SAND, pull=Pull(pull, 0.1, since=0.5))
        (log,) = open_loop(fleet, [2.0, 2.0], 15.0)
        sinking = Sinking(**log.metadata[SINKING])
        assert sinking.sinkage > sinkage(SAND)
        # a robot that stands still while it digs presses no new rut
        assert sinking.is_immobilised or sinking.resistance > resistance(SAND)
        notes[pull] = " ".join(sinking.notes)
    assert notes[50.0] == ""
    assert notes[168.0].startswith("immobilised: the tracks dig at a slip of ")


def test_runs_on_firm_ground_say_nothing_of_soil(robot):
    (log,) = open_loop(fleet_on(robot, Ground()), [2.0, 2.0], 1.0)
    assert SINKING not in log.metadata
    assert not OF_SOIL & set(column_names(log))


def test_logs_have_depth_and_resistance_in_every_row(robot, tmp_path):
    """A robot on firm ground in the same fleet has neither."""
    fleet = fleet_on(robot, without_slip_sinkage(SAND), Ground())
    logs = open_loop(fleet, [2.0, 2.0], 4.0)
    write_parquet(logs, tmp_path / "runs.parquet")
    on_sand, on_stone = read_runs(tmp_path / "runs.parquet")
    assert set(column_names(on_sand)) >= OF_SOIL
    assert not OF_SOIL & set(column_names(on_stone))
    truth = on_sand.truth
    np.testing.assert_array_equal(truth.sinkage, logs[0].truth.sinkage)
    np.testing.assert_allclose(truth.sinkage[-1], sinkage(SAND), rtol=0.01)
    np.testing.assert_allclose(truth.resistance[0], 0.0, atol=1e-3)  # at rest
    np.testing.assert_allclose(truth.resistance[-1].sum(), -resistance(SAND), rtol=0.015)
    sinking = Sinking(**on_sand.metadata[SINKING])
    assert sinking.sinkage == np.median(truth.sinkage.mean(axis=1))
