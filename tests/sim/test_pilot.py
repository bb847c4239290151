import numpy as np
import pytest

from sim.fleet import Fleet
from sim.pilot import Pilot
from sim.run_recorder import RunRecorder
from trackslip.controllers.dynamic_feedback import DynamicFeedback
from trackslip.controllers.error_feedback import Feedforward, LinearTimeVarying
from trackslip.kinematics import advance
from trackslip.laws.icr import ConstantIcr
from trackslip.online.compensation import FixedLaw, OnlineIcr
from trackslip.trajectory.segmented import paper_reference

START = np.array([[0.0, 0.0, 1.5], [0.05, 0.0, 1.6], [0.0, 0.1, 1.4], [-0.05, 0.1, 1.7]])
ROWS, PERIOD = 5, 0.05


@pytest.fixture(scope="module")
def fleet(robot):
    return Fleet(robot, START)


def commands(fleet, pilots, robots=range(4)):
    """Set points (T, R, 2) that pilots of the fleet give to some robots, which creep forwards."""
    record = RunRecorder(fleet, ROWS, PERIOD, None)
    record.pose[:] = START + np.arange(ROWS)[:, None, None] * [0.0, 0.004, 0.0]
    record.omega[:] = 1.0
    omega = np.zeros((ROWS, 4, 2))
    for pilot in pilots:
        pilot.begin(record)
        for k in range(ROWS):
            law = pilot.law(record, k)
            twist = pilot.twist(record, k, law, paper_reference())
            omega[k, pilot.robots] = law.sprocket_speeds(twist, fleet.robot.geometry)
    return omega[:, list(robots)]


@pytest.mark.parametrize("controller", [LinearTimeVarying, DynamicFeedback, Feedforward])
def test_a_pilot_of_many_robots_is_as_many_pilots_to_the_bit(fleet, controller):
    geometry = fleet.robot.geometry
    law = ConstantIcr(0.03, geometry.half_gauge, 0.006)
    for make in (lambda: FixedLaw(law), lambda: OnlineIcr(geometry, law)):
        together = commands(fleet, [Pilot(controller(), range(4), make(), 0.02)])
        alone = commands(fleet, [Pilot(controller(), [k], make(), 0.02) for k in range(4)])
        np.testing.assert_array_equal(together, alone)


class Counting(Feedforward):
    """A user's controller that counts the poses it is called with, and drives at a share of the reference's twist."""

    def __init__(self, share):
        self.share, self.calls, self.sensed = share, [], []

    def sense(self, omega):
        self.sensed.append(omega.tolist())

    def twist(self, time, pose, reference):
        self.calls.append(len(pose))
        return self.share * super().twist(time, pose, reference)


def test_each_pilots_controller_is_called_with_its_robots(fleet):
    whole, half = Counting(1.0), Counting(0.5)
    found = commands(fleet, [Pilot(whole, [0, 2]), Pilot(half, [1]), Pilot(Feedforward(), [3])])
    assert whole.calls == [2] * ROWS
    assert half.calls == [1] * ROWS
    assert half.sensed == [[[1.0, 1.0]]] * ROWS
    np.testing.assert_allclose(found[:, 1], found[:, 0] / 2)
    np.testing.assert_array_equal(found[:, 0], found[:, 3])
    assert np.abs(found[-1]).min() > 0


def test_a_preview_looks_ahead_of_the_motion_and_the_reference(fleet):
    geometry, controller, reference = fleet.robot.geometry, LinearTimeVarying(), paper_reference()
    law = ConstantIcr(0.03, geometry.half_gauge, 0.006)
    found = commands(fleet, [Pilot(controller, range(4), FixedLaw(law), 0.1)])
    ahead = advance(START, law.twist(np.ones((4, 2)), geometry), 0.1)
    expected = law.sprocket_speeds(controller.twist(0.1, ahead, reference), geometry)
    np.testing.assert_allclose(found[0], expected, rtol=1e-12)
