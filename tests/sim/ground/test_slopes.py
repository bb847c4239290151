"""Slopes, motors and what they leave in a log; what an inclinometer and a load cell would tell."""

import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.drive.motor import Motor
from sim.drive.pull import Pull
from sim.fleet import Fleet
from sim.ground.ground import Ground, friction_angle
from sim.loop import closed_loop, open_loop
from sim.pilot import Pilot
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from trackslip.controllers.error_feedback import LinearTimeVarying
from trackslip.laws.icr import ConstantIcr
from trackslip.laws.icr_load import IcrLoad
from trackslip.localization.plate import PlateLocator
from trackslip.online.compensation import FixedLaw, LoadedLaw
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.trajectory.segmented import Segment, SegmentedReference

TEN_DEGREES = float(np.radians(10.0))


def test_a_parked_robot_hardly_creeps(robot):
    headings = np.linspace(0, np.pi, 7)
    fleet = Fleet(robot, [(0.0, 0.0, h) for h in headings], Ground(slope=TEN_DEGREES))
    fleet.advance(1.0)
    before = fleet.pose()
    fleet.advance(10.0)
    assert np.hypot(*(fleet.pose() - before)[:, :2].T).max() / 10.0 < 0.05e-3


@pytest.mark.parametrize("heading", [0.0, np.pi / 2])
def test_beyond_the_friction_angle_it_slides_as_coulomb_says(robot, heading):
    """On slippery ground, whose friction angle is so small that no pad lifts."""
    ground = Ground(0.2, 0.25)
    mu = ground.along if heading == 0 else ground.across
    fleet = Fleet(robot, [(0.0, 0.0, heading)], ground)
    for slope in np.arctan(mu) * np.array([0.95, 1.3]):
        fleet.set_ground(Ground(ground.along, ground.across, slope=float(slope)))
        fleet.advance(0.5)
    before = fleet.batch.qvel[0, 0]
    fleet.advance(0.5)
    acceleration = (fleet.batch.qvel[0, 0] - before) / 0.5
    assert acceleration == pytest.approx(-9.81 * (np.sin(slope) - mu * np.cos(slope)), rel=0.02)


def test_the_friction_angle_is_that_of_the_ellipse():
    assert friction_angle((0.7, 0.9), 0.0) == pytest.approx(np.arctan(0.7))
    assert friction_angle((0.7, 0.9), -np.pi / 2) == pytest.approx(np.arctan(0.9))
    c = np.sqrt(0.5)
    assert np.tan(friction_angle((0.7, 0.9), 3 * np.pi / 4)) == pytest.approx(1 / np.hypot(c / 0.7, c / 0.9))


def test_driving_uphill_takes_the_weight_and_the_motors_pay(robot):
    slope = 0.15
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(slope=slope), radius_error=0.01)
    fleet.command([3.0, 3.0])
    fleet.advance(3.0)
    weight = robot.mass * 9.81 * np.sin(slope)
    assert fleet.mean_traction.sum() == pytest.approx(weight, rel=0.01)
    torque = fleet.drive.torque
    motor = Motor()
    # at its sprocket: the pull at the real radius, and what the gear loses
    np.testing.assert_allclose(torque, weight / 2 * 0.06 * 1.01 + motor.friction, rtol=0.01)
    before = fleet.drive.energy.copy()
    fleet.advance(2.0)
    lifted = weight * fleet.twist()[0, 0]  # power against gravity
    lost = (motor.friction * 3.0 + motor.resistance * (torque / motor.gear / motor.torque_constant) ** 2).sum()
    assert (fleet.drive.energy - before).sum() / 2.0 == pytest.approx(lifted + lost, rel=0.01)


def log_of(robot, fleet, omega):
    (log,) = open_loop(fleet, omega, 3.0, ScannerFeed(LaserScanner(), fleet), PlateLocator(robot.plate))
    return log


def test_logs_tell_power_and_saturation(robot):
    start = [(-1.5, 0.0, 0.0)]
    strong, weak = (
        log_of(robot, Fleet(robot, start, drive=Drive(torque_limit=limit)), [-2.0, 2.0]) for limit in (8.0, 1.5)
    )
    assert strong.truth.saturated.max() == 0
    np.testing.assert_allclose(weak.truth.saturated[5:], 1.0)
    assert np.all(weak.truth.power[0] == 0)
    motor = Motor()
    stalled = motor.resistance * (1.5 / motor.gear / motor.torque_constant) ** 2
    np.testing.assert_allclose(weak.truth.power[-1], stalled, rtol=0.02)
    # a turn in place is all friction: the motors pay for what the ground and they themselves lose
    torque, omega = strong.truth.torque[-1], strong.omega[-1]
    np.testing.assert_allclose(strong.truth.power[-1], motor.power(torque, omega), rtol=0.02)


def test_the_plate_leans_with_the_robot_and_the_scanner_sees_it(robot):
    """A weight to the left presses the left track deeper; the plate, half a metre up, goes with it."""
    leaning = load_robot(parameters=RobotParameters(com_y=0.04))
    start = np.array([[-1.5, 0.5, 0.0]])
    seen = []
    for model in (robot, leaning):
        fleet = Fleet(model, start)
        fleet.advance(0.5)
        feed = ScannerFeed(LaserScanner(noise=0.0, resolution=float(np.radians(0.05))), fleet)
        seen.append(PlateLocator(model.plate).locate(feed.scan(feed.true_ranges())).pose[0] - fleet.pose()[0])
    roll = fleet.attitude()[0, 1]
    # by theory: the springs of the ground give way by 2 mm under the weight
    assert roll == pytest.approx(-0.04 * 0.002 / (0.168**2 - 0.12 * 0.002), rel=0.05)
    assert seen[1][1] - seen[0][1] == pytest.approx(-0.5 * np.sin(roll), rel=0.1)
    assert fleet.state.lean(robot.lrf_height)[0] == pytest.approx(-robot.lrf_height * np.sin(roll), rel=0.02)


def test_lateral_speed_is_in_the_truth_and_as_theory_says():
    parameters = RobotParameters(com_x=0.02)
    robot = load_robot(parameters=parameters)
    fleet = Fleet(robot, [(-1.5, 0.0, 0.0)], radius_error=0.0)
    log = log_of(robot, fleet, [2.0, 4.0])
    ground = Ground()
    forwards = 0.02 + 0.12 * fleet.attitude()[0, 2]  # it leans forwards, and so does its weight
    contact = line_contact(0.168, 0.17, ground.along, ground.across, (forwards, 0.0, 0.12))
    expected = steady_twist(np.array([2.0, 4.0]) * 0.06, contact, 9.81)
    assert abs(expected[1]) > 5e-3
    # the grip's lag of 10 ms moves the centre of rotation forwards by 10 ms of way; see models/README.md
    expected[1] -= 0.01 * expected[0] * expected[2]
    np.testing.assert_allclose(log.truth.twist[-20:].mean(axis=0), expected, rtol=0.02)


def test_it_is_the_slopes_component_and_the_pull(robot):
    slope, force = 0.15, 20.0
    headings = np.array([0.0, np.pi / 2, 0.7])
    start = np.column_stack([np.zeros((3, 2)), headings])
    fleet = Fleet(robot, start, Ground(slope=slope, uphill=np.pi / 2), pull=Pull(force))
    weight = robot.mass * np.linalg.norm(robot.model.opt.gravity)
    towed = force / (weight * np.cos(slope))
    expected = np.tan(slope) * np.column_stack([np.sin(headings), np.cos(headings)]) + [towed, 0.0]
    np.testing.assert_allclose(fleet.needed_traction(), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("uphill", [np.pi / 2, -np.pi / 2])
def test_a_robot_that_knows_its_sideslip_keeps_to_a_line_across_the_slope(robot, uphill):
    """Straight across a slope of 10 deg, it crabs by C t; the heading that the controller holds must allow for it."""
    b = robot.geometry.half_gauge
    line = SegmentedReference((0.0, 0.0, 0.0), [Segment(8.0, 0.15, 0.0)])
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(slope=np.radians(10), uphill=uphill, shear=0.01))
    known = LoadedLaw(IcrLoad(0.035, b, 0.004, 0.085, 0.2))
    pilots = [
        Pilot(LinearTimeVarying(), [0], FixedLaw(ConstantIcr(0.035, b, 0.004))),
        Pilot(LinearTimeVarying(), [1], known),
    ]
    aside = [abs(log.truth.pose[-1, 1]) for log in closed_loop(fleet, pilots, line)]
    assert aside[0] > 0.006
    assert aside[1] < aside[0] / 2
