"""Slopes, motors and what they leave in a log; what an inclinometer and a load cell would tell."""

import numpy as np
import pytest

from sim import Fleet, Ground, Pilot, Pull, RobotParameters, closed_loop, load_robot, open_loop
from sim.drive.drive import Motor
from trackslip.controllers.error_feedback import LinearTimeVarying
from trackslip.laws.icr import ConstantIcr
from trackslip.laws.icr_load import IcrLoad
from trackslip.online.compensation import FixedLaw, LoadedLaw
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.trajectory.segmented import Segment, SegmentedReference

TEN_DEGREES = float(np.radians(10.0))


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


def test_driving_uphill_takes_the_weight_and_the_motors_pay(robot):
    slope = 0.15
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(slope=slope), radius_error=0.01)
    fleet.command([3.0, 3.0])
    fleet.advance(3.0)
    weight = robot.mass * 9.81 * np.sin(slope)
    fleet.advance(fleet.period)
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


def test_a_robot_leans_to_its_heavier_side(robot):
    """By theory: the springs of the ground give way by 2 mm under the weight."""
    fleet = Fleet(load_robot(parameters=RobotParameters(com_y=0.04)), np.zeros((1, 3)))
    fleet.advance(0.5)
    roll = fleet.attitude()[0, 1]
    assert roll == pytest.approx(-0.04 * 0.002 / (0.168**2 - 0.12 * 0.002), rel=0.05)
    assert fleet.state.lean(robot.lrf_height)[0] == pytest.approx(-robot.lrf_height * np.sin(roll), rel=0.02)


def test_lateral_speed_is_in_the_truth_and_as_theory_says():
    fleet = Fleet(load_robot(parameters=RobotParameters(com_x=0.02)), np.zeros((1, 3)), radius_error=0.0)
    (log,) = open_loop(fleet, [2.0, 4.0], 3.0, period=0.05)
    ground = Ground()
    forwards = 0.02 + 0.12 * fleet.attitude()[0, 2]  # it leans forwards, and so does its weight
    contact = line_contact(0.168, 0.17, ground.along, ground.across, (forwards, 0.0, 0.12))
    expected = steady_twist(np.array([2.0, 4.0]) * 0.06, contact, 9.81)
    assert abs(expected[1]) > 5e-3
    # the grip's lag of 10 ms moves the centre of rotation forwards by 10 ms of way; see models/README.md
    expected[1] -= 0.01 * expected[0] * expected[2]
    np.testing.assert_allclose(log.truth.twist[-20:].mean(axis=0), expected, rtol=0.02)


def test_the_needed_traction_is_the_slopes_component_and_the_pull(robot):
    slope, force = 0.15, 20.0
    headings = np.array([0.0, np.pi / 2, 0.7])
    start = np.column_stack([np.zeros((3, 2)), headings])
    fleet = Fleet(robot, start, Ground(slope=slope, uphill=np.pi / 2), pull=Pull(force))
    weight = robot.mass * np.linalg.norm(robot.model.opt.gravity)
    towed = force / (weight * np.cos(slope))
    expected = np.tan(slope) * np.column_stack([np.sin(headings), np.cos(headings)]) + [towed, 0.0]
    np.testing.assert_allclose(fleet.needed_traction(), expected, rtol=1e-6, atol=1e-9)


def test_a_robot_that_knows_its_sideslip_keeps_to_a_line_across_the_slope(robot):
    """Straight across a slope of 10 deg, it crabs by C t; the heading that the controller holds must allow for it."""
    b = robot.geometry.half_gauge
    line = SegmentedReference((0.0, 0.0, 0.0), [Segment(8.0, 0.15, 0.0)])
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(slope=TEN_DEGREES, uphill=np.pi / 2, shear=0.01))
    laws = FixedLaw(ConstantIcr(0.035, b, 0.004)), LoadedLaw(IcrLoad(0.035, b, 0.004, 0.085, 0.2))
    pilots = [Pilot(LinearTimeVarying(), [k], law) for k, law in enumerate(laws)]
    aside = [abs(log.truth.pose[-1, 1]) for log in closed_loop(fleet, pilots, line)]
    assert aside[0] > 0.006
    assert aside[1] < aside[0] / 2
