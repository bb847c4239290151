import numpy as np
import pytest
from soft_soil import drive, fleet_on, without_slip_sinkage

from sim import Ground, Pull, RobotParameters, open_loop
from sim.ground.ground import NAMED_GROUNDS
from sim.robot.parameters import SINK
from sim.runs.run_recorder import SINKING, Sinking
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


def sinkage(ground):
    return float(ground.soil.sinkage(TRACKS.pressure, WIDTH))


def resistance(ground):
    return 2 * WIDTH * float(ground.soil.work(sinkage(ground), WIDTH))


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


@pytest.mark.parametrize("straight", [0.0, 4.0])
def test_a_spin_meets_resistance_only_at_first(robot, straight):
    """On fresh soil, and at the end of a rut, which has taken a part of the ring."""
    fleet = fleet_on(robot, SAND)
    drive(fleet, [3.0, 3.0], straight)
    drive(fleet, [0.0, 0.0], 1.0)
    before = fleet.pose()[0]
    drive(fleet, [-2.5, 2.5], 16.0)
    moved = fleet.pose()[0] - before
    assert moved[2] > 2 * np.pi
    assert np.hypot(*moved[:2]) < 0.01
    assert np.abs(fleet.ruts.resistance).sum() < 0.2 * resistance(SAND)


def test_windows_follow_robots_and_keep_their_ruts(robot):
    """A robot that has driven 1.5 m has moved its window, and drives back in its rut."""
    fleet = fleet_on(robot, without_slip_sinkage(SNOW))
    drive(fleet, [5.0, 5.0], 6.0)
    assert fleet.pose()[0, 0] > 1.5
    # until the soil that braking pressed deeper is behind the robot
    drive(fleet, [-3.0, -3.0], 5.0)
    assert abs(fleet.ruts.resistance.sum()) < 0.02 * resistance(SNOW)


def test_ruts_of_each_robot_can_be_undone_alone(robot):
    """Also where a robot's window has moved and what it pressed since lies in other cells."""
    fleet = fleet_on(robot, SAND, SAND)
    drive(fleet, [3.0, 2.0], 1.0)
    at_first = fleet.ruts.get_state()
    fleet.command([[5.0, 4.0], [4.0, 5.0]])
    fleet.advance(4.0)  # in one piece, all of which can be undone
    at_last = fleet.ruts.get_state()
    assert (np.ptp([at_first["_corner"], at_last["_corner"]], axis=0)[:, 0] > 0).all()

    def is_as(state):
        """Whether each robot's window lies and is as deep as in a state."""
        now = fleet.ruts.get_state()
        depth = (now["_depth"] == state["_depth"])[:-1].reshape(2, -1)
        corner = now["_corner"] == state["_corner"]
        return (depth.all(axis=1) & corner.all(axis=1)).tolist()

    assert is_as(at_last) == [True, True]
    fleet.ruts.undo(np.array([1]))
    assert is_as(at_last) == [True, False]
    assert is_as(at_first) == [False, True]
    fleet.ruts.undo(np.array([0]))
    assert is_as(at_first) == [True, True]


def test_runs_say_how_robots_sank_and_that_one_is_immobilised(robot):
    """On sand, theory's largest pull is 155 N."""
    notes = {}
    for pull in (50.0, 168.0):
        fleet = fleet_on(robot, SAND, pull=Pull(pull, 0.1, since=0.5))
        (log,) = open_loop(fleet, [2.0, 2.0], 9.0)
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
