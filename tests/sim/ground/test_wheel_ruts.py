import numpy as np
import pytest
from soft_soil import drive, fleet_on, without_slip_sinkage

from sim import Fleet, Pull, load_robot, open_loop
from sim.ground.ground import NAMED_GROUNDS
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK
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


@pytest.fixture(scope="module")
def robot():
    return load_robot(HUSKY)


def slip_of(fleet, omega, seconds=1.0):
    before = fleet.pose()[:, 0]
    fleet.advance(seconds)
    travel = omega * HUSKY.sprocket_radius * seconds
    return 1 - (fleet.pose()[:, 0] - before) / travel


@pytest.mark.parametrize("rut", [0.0, 0.005, 0.02])
def test_springs_and_soil_bear_the_same(robot, rut):
    """Equation (1), up to three times a wheel's share of the weight, under which the springs yield
    by SINK.
    """
    grounds = (SAND, NAMED_GROUNDS["lete_sand"], LOAM, REGOLITH)
    fleet = fleet_on(robot, *grounds)
    rows = np.arange(len(grounds))
    ahead, _ = fleet.ruts.by_robot[-2:]
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], (len(grounds), 1))  # upright
    for share, error in ((0.1, 1e-3), (0.5, 1e-3), (1.0, 1e-3), (3.0, 2e-3)):
        load = share * WEIGHT / 4
        depth = np.array([roll(ground.soil, WHEELS, load, rut).rut for ground in grounds])
        fleet.ruts.forget(rows, np.zeros((len(grounds), 2)))
        ahead[:] = rut
        pose[:, 2:3] = -(depth + share * SINK)
        pressed = fleet.ruts.press(rows, pose)
        np.testing.assert_allclose(pressed, depth.repeat(4, axis=1), rtol=error)


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


def test_wheels_that_spin_deepen_their_ring_more_and_more_slowly(robot):
    fleet = fleet_on(robot, without_slip_sinkage(SAND))
    drive(fleet, [-2.0, 2.0], 3.0)
    fresh = np.abs(fleet.ruts.resistance).sum()
    drive(fleet, [-2.0, 2.0], 12.0)
    assert fleet.pose()[0, 2] > np.pi
    assert np.abs(fleet.ruts.resistance).sum() < 0.7 * fresh


def test_soil_that_does_not_bear_the_wheels_is_refused(robot):
    with pytest.raises(InvalidValueError, match=r"ground.soil .* sink in up to their axles"):
        Fleet(robot, np.zeros((1, 3)), NAMED_GROUNDS["soft_snow"])


def test_runs_say_that_wheels_are_immobilised(robot):
    """On loam, theory's largest pull is 349 N."""
    notes = {}
    for pull in (100.0, 420.0):
        fleet = fleet_on(robot, LOAM, pull=Pull(pull, 0.2, since=0.5))
        (log,) = open_loop(fleet, [2.0, 2.0], 9.0)
        notes[pull] = " ".join(Sinking(**log.metadata[SINKING]).notes)
    assert notes[100.0] == ""
    assert notes[420.0].startswith("immobilised: the wheels dig at a slip of ")
