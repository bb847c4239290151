"""New runs for some robots of a fleet, while the others' go on."""

import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.fleet import Fleet, Setting
from sim.ground.ground import Change, Ground, Patch
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.errors import InvalidValueError
from trackslip.metrics import body_errors

OMEGA = np.array([[2.0, 3.0], [-5.0, 5.0], [4.0, 1.0]])
PATCHED = Ground(0.5, 0.6, patches=(Patch((-1.0, 1.0), (0.1, 1.0), 0.3, 0.5),), changes=(Change(0.5, 0.6, 0.9),))


def drive(fleet, omega, seconds):
    fleet.command(omega)
    for _ in range(round(seconds / 0.05)):
        fleet.advance(0.05)


def test_it_drives_as_a_new_fleet_does(robot):
    """Set down in another way, it stands a little differently; after a while little of that is left."""
    start = (0.5, 0.2, 0.3)
    ground = Ground(0.6, 0.8, slope=0.1, uphill=1.0)
    leaning = load_robot(parameters=RobotParameters(com_x=0.03, com_y=-0.02))
    new = Fleet(leaning, [start], ground, 0.02, Drive(lag=0.1))
    old = Fleet(robot, np.zeros((1, 3)))
    drive(old, OMEGA[:1], 1.0)
    old.restart([0], [Setting(start, ground, 0.02, 0.1, (0.03, -0.02))])
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-12)
    np.testing.assert_allclose(old.attitude(), new.attitude(), atol=5e-5)
    assert np.all(old.drive.encoder_angle() == 0)
    for fleet in (new, old):
        drive(fleet, OMEGA[:1], 3.0)
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-4)


def test_it_stands_still_where_it_was_put(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    start = (1.0, -2.0, 0.7)
    fleet.restart([1], [Setting(start, Ground(slope=0.1), weight=(0.02, 0.03))])
    np.testing.assert_allclose(fleet.pose()[1], start, atol=1e-12)
    fleet.advance(2.0)
    assert np.abs(body_errors(fleet.pose()[1], start)).max() < 1e-4


def test_a_ground_changes_in_the_time_of_the_run(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    fleet.advance(2.0)
    fleet.restart([1], [Setting((0.0, 0.0, 0.0), Ground(changes=(Change(0.5, 0.3, 0.4),)))])
    fleet.advance(0.5)
    assert fleet.friction()[1] == pytest.approx([0.7, 0.778])
    fleet.advance(0.05)
    assert fleet.friction() == pytest.approx(np.array([[0.7, 0.778], [0.3, 0.4]]))
    fleet.restart([1], [Setting((0.0, 0.0, 0.0))])
    fleet.advance(1.0)
    assert fleet.friction()[1] == pytest.approx([0.7, 0.778])


def test_what_cannot_be_parked_is_refused(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    with pytest.raises(InvalidValueError, match="slope"):
        fleet.restart([0], [Setting((0.0, 0.0, 0.0), Ground(0.2, 0.2, slope=0.3))])
    with pytest.raises(InvalidValueError, match="start"):
        fleet.restart([0], [Setting((np.nan, 0.0, 0.0))])
