"""What an inclinometer and a load cell would tell."""

import numpy as np
import pytest

from sim.drive.pull import Pull
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.instruments import needed_traction
from sim.runs import closed_loop, open_loop
from sim.steering import Pilot
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.slip.compensation import FixedLaw, LoadedLaw
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.icr_load import IcrLoad
from trackslip.trajectory.segmented import Segment, SegmentedReference


def test_it_is_the_slopes_component_and_the_pull(robot):
    slope, force = 0.15, 20.0
    headings = np.array([0.0, np.pi / 2, 0.7])
    start = np.column_stack([np.zeros((3, 2)), headings])
    fleet = Fleet(robot, start, Ground(slope=slope, uphill=np.pi / 2), pull=Pull(force))
    weight = robot.mass * np.linalg.norm(robot.model.opt.gravity)
    towed = force / (weight * np.cos(slope))
    expected = np.tan(slope) * np.column_stack([np.sin(headings), np.cos(headings)]) + [towed, 0.0]
    np.testing.assert_allclose(needed_traction(fleet), expected, rtol=1e-6, atol=1e-9)


def test_runs_tell_their_loads_on_ground_that_shears_only(robot):
    grounds = [Ground(slope=0.1), Ground(slope=0.1, shear=0.01)]
    first, second = open_loop(Fleet(robot, np.zeros((2, 3)), grounds), np.full(2, 2.0), 1.0)
    assert first.load is None
    np.testing.assert_allclose(second.load[:, 0], np.tan(0.1), rtol=1e-3)


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
